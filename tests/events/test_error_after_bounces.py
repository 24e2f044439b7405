"""The error that `simulate(check=True)` tells of a ball that bounces often, beside the parabolas of its flights."""

from decimal import Decimal, localcontext

import numpy as np
import pytest

import symmb as mb


def heights(times, g, height, restitution):
    """Of a ball that falls from a height, in arithmetic of 40 digits."""
    with localcontext() as context:
        context.prec = 40
        g, low, e = Decimal(g), Decimal(height), Decimal(restitution)
        start, end, speed = Decimal(0), (2 * low / g).sqrt(), Decimal(0)
        rebound, values = e * (2 * g * low).sqrt(), []
        for t in map(Decimal, times.tolist()):
            while t >= end:
                start, low, speed = end, Decimal(0), rebound
                end, rebound = start + 2 * speed / g, e * speed
            values.append(float(low + speed * (t - start) - g * (t - start) ** 2 / 2))
        return np.array(values)


@pytest.mark.parametrize(
    ("g", "height", "restitution", "end"),
    [
        (9.81, 1.0, 1.0, 5.0), (9.81, 1.0, 1.0, 60.0), (9.81, 0.7, 1.0, 90.0), (1.62, 2.3, 1.0, 50.0),
        (9.81, 1.3, 0.99, 40.0),
    ],
)  # fmt: skip
def test_the_error_after_many_bounces_is_told(g, height, restitution, end):
    """Flights are parabolas, on which steps of all tolerances are exact: errors are those of rounding."""
    ball = mb.Body("ball", 1.0, pose=mb.Particle())
    system = mb.System(ball, mb.Gravity(0, -g), mb.Impact("floor", ball.y, restitution))
    run = mb.simulate(mb.Scene(system, {"ball.y": height}, np.linspace(0, end, 51), {"y": ball.y}), check=True)
    error = np.abs(run["y"] - heights(run.t, g, height, restitution)).max()
    assert error < 1e-7 and error / 3 < run.error.max() < 10 * error
