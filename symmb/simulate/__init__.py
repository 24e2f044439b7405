"""Simulators: parameters in, trajectories out, whatever makes them."""

from symmb.simulate._ensemble import BLOCK as BLOCK
from symmb.simulate._ensemble import Ensemble as Ensemble
from symmb.simulate._ensemble import Indices as Indices
from symmb.simulate._ensemble import Jets as Jets
from symmb.simulate._ensemble import Kinked as Kinked
from symmb.simulate._ensemble import March as March
from symmb.simulate._ensemble import Mask as Mask
from symmb.simulate._ensemble import Plain as Plain
from symmb.simulate._ensemble import Progress as Progress
from symmb.simulate._ensemble import Reduction as Reduction
from symmb.simulate._ensemble import Samples as Samples
from symmb.simulate._ensemble import Simulator as Simulator
from symmb.simulate._ensemble import blocks as blocks
from symmb.simulate._ensemble import run_blocks as run_blocks
from symmb.simulate._ensemble import stream as stream
from symmb.simulate._function import FunctionSimulator as FunctionSimulator
