"""What several test files share: one tuple for each family, so that a new member is tested by one line."""

from joints import ALL_JOINTS as ALL_JOINTS
from joints import ALL_POSES as ALL_POSES

from models import (
    andrews,
    bouncing_ball,
    car_axis,
    chain,
    cubic,
    double_pendulum,
    flexible_pendulum,
    four_bar,
    half_car,
    heavy_top,
    n_four_bar,
    rolling_disc,
    slider_crank,
    slider_crank_flexible,
    slider_crank_spatial,
    spherical_pendulum,
    spin_up_beam,
    stick_slip,
)
from symmb import (
    BDFI3,
    CVODES,
    HHT,
    IDAS,
    NSTIFFSI2,
    ChebyshevGauss,
    ClenshawCurtis,
    Collocation,
    DormandPrince,
    Gauss,
    GeneralizedAlpha,
    HyperbolicCross,
    IntervalArithmetic,
    LatinHypercube,
    Leja,
    MonteCarlo,
    Newmark,
    Optimization,
    PolynomialChaos,
    Rosenbrock,
    RungeKutta,
    Scanning,
    Sobol,
    SparseGrid,
    StabilizedIndex2,
    Swarm,
    Taylor,
    TensorDegree,
    TotalDegree,
    Vertex,
)

ALL_SOLVERS = (
    DormandPrince(rtol=1e-11),
    CVODES(rtol=1e-11),
    CVODES(rtol=1e-11, stiff=True),
    IDAS(rtol=1e-11),
    RungeKutta(steps=2000),
    Collocation(steps=100),
    NSTIFFSI2(step=1e-3),
    GeneralizedAlpha(step=1e-3),
    HHT(step=1e-3),
    Newmark(step=2e-4),
    BDFI3(step=1e-3),
    Rosenbrock(rtol=1e-9),
    StabilizedIndex2(rtol=1e-9),
)

ALL_RULES = (Gauss(), ClenshawCurtis(), ChebyshevGauss(), Leja())

ALL_NODES = (*ALL_RULES, *(SparseGrid(rule) for rule in ALL_RULES))

ALL_BASES = (TotalDegree(), TensorDegree(), HyperbolicCross(), HyperbolicCross(q=0.75))

ALL_METHODS = (
    PolynomialChaos(),
    PolynomialChaos(budget=30),
    PolynomialChaos(order=4),
    PolynomialChaos(order=4, nodes=Gauss(), basis=TotalDegree()),
    PolynomialChaos(order=4, nodes=Leja()),
    PolynomialChaos(order=6, nodes=ChebyshevGauss(), basis=HyperbolicCross(q=0.75)),
    PolynomialChaos.paper(order=2),
    PolynomialChaos.paper(order=4, lockstep=True),
    PolynomialChaos.paper(order=3, nodes=SparseGrid()),
    Taylor(order=2),
    Taylor(order=5),
    Taylor(order=2, subintervals=4),
    MonteCarlo(2000),
    MonteCarlo(500, sampler=Sobol()),
    MonteCarlo(500, sampler=LatinHypercube()),
    Scanning(21),
    Vertex(),
    Optimization(),
    Optimization(budget=30),
    Swarm(particles=5, steps=10),
    IntervalArithmetic(),
)

ALL_MODELS = (
    cubic,
    double_pendulum,
    slider_crank,
    four_bar,
    n_four_bar,
    andrews,
    bouncing_ball,
    chain,
    spherical_pendulum,
    heavy_top,
    car_axis,
    rolling_disc,
    slider_crank_spatial,
    slider_crank_flexible,
    flexible_pendulum,
    spin_up_beam,
    stick_slip,
    half_car,
)

SMOOTH_MODELS = tuple(model for model in ALL_MODELS if not model.scene().system.collected.impacts)
"""Those that any solver runs."""
