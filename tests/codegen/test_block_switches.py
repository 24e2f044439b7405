"""Switches behind a pass, at states that a projection moves."""

import numpy as np
import pytest

from symmb.codegen.block_switches import BlockSwitches
from symmb.codegen.engine import StepEnds


@pytest.mark.parametrize("moved", [1e-9, 1e-13, 0.0, -1e-13, -1e-9])
def test_a_projection_does_not_turn_a_motion_back_at_a_switch(moved):
    """A motion is in a stiff wall for a part of a step. Its gap and its force are two switches at one place."""

    def switches(x, c, _t):
        gap, force = x, 1e6 * np.where(c[-2] > 0, x, 0 * x)
        return np.concatenate([gap[:1], force[:1], gap[1:], force[1:]])

    def bounds(box, c, _t):
        (gap_low, _), (gap_high, _), (fall, _), (rise, _), *_ = box[:8].reshape(4, 2, -1)
        stiffness = 1e6 * (c[-2] > 0)
        gap = np.array([gap_low, gap_high, fall, rise])
        return np.stack([gap, stiffness * gap], axis=1).reshape(8, -1)

    rest = np.zeros((7, 2, 1))
    every, at, h, lanes = np.array([True]), np.zeros(1), np.ones(1), np.zeros(1, dtype=int)
    ends = StepEnds((1e-12, 1e-6))
    inside, out, before, end, x = (
        np.array([[gap], [rate]]) for gap, rate in ((1.0, -5.0), (0.0, -5.0), (-1.0, 5.0), (0.0, 5.0), (moved, 5.0))
    )
    block = BlockSwitches(
        lambda x, p, t: p, switches, bounds, ends, np.array([0.0, 9.0]), inside, np.ones((1, 1)), 1, 1
    )
    c = block.settle(inside, block.parameters, at, lanes)
    block.first_pass(inside, inside, rest, c, at, h, lanes)
    c, _ = block.change_sides(out, out, c, at, h, lanes, every, lanes)
    for _ in range(2):  # the gap is raised no more
        block.first_pass(before, before, rest, c, at, h, lanes)
    c, sticks = block.change_sides(end, x, c, at, h, lanes, every, lanes)
    assert not sticks.any()
    F = np.zeros((7, 2, 1))
    F[:2, 0, 0], F[0, 1, 0] = (-95.0, 100.0), -200.0  # the gap is 5 z - 100 z^2
    share, _, _ = block.first_pass(x, x + F[0], F, c, at, h, lanes)
    assert share[0] == pytest.approx(0.05, abs=1e-6)
