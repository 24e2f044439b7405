"""How wide are the bounds of x^3 - 2 x^2 + x for x in [0, 1] by five methods?

The true range is [0, 4/27]. Source: eq. (13) of Wang & Yang (2021), Nonlinear Dynamics.
"""

import warnings

import symmb as mb

x = mb.Parameters(x=0.5)
cubic = mb.Scene(mb.System(parameters=x), outputs={"f": x.x**3 - 2 * x.x**2 + x.x}, box=mb.Box(x=(0, 1)))

METHODS = [
    mb.IntervalArithmetic(),
    mb.Taylor(order=3),
    mb.PolynomialChaos.paper(order=3),
    mb.PolynomialChaos(order=3),
    mb.MonteCarlo(1000),
]
with warnings.catch_warnings():
    warnings.simplefilter("ignore", mb.SymmbWarning)  # warnings about ranges that are too wide
    ranges = {repr(method): mb.propagate(cubic, method)["f"] for method in METHODS}

expected = [(-2, 2), (-1 / 4, 3 / 8), (-1 / 10, 9 / 40), (0, 4 / 27)]
for (name, (lower, upper)), (low, high) in zip(ranges.items(), expected, strict=False):
    assert abs(lower[0] - low) < 1e-6 and abs(upper[0] - high) < 1e-6, name
sampled = ranges["MonteCarlo(1000)"]
assert 0 <= sampled[0][0] and sampled[1][0] <= 4 / 27  # samples are inside the true range

if __name__ == "__main__":
    for name, (lower, upper) in ranges.items():
        print(f"{name:34s} [{lower[0]:8.5f}, {upper[0]:8.5f}]")
