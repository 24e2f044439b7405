"""Functions of parameters as simulators, studies of them, and results that are saved and loaded."""

import warnings

import numpy as np

import symmb as mb


def unit_function(f, d, times=(0.0,), outputs=("y",), noise=None):
    """That of f(x) with n_t n_y values of d parameters x (d,), named x0, x1, ..."""
    names = [f"x{i}" for i in range(d)]

    def response(**p):
        return np.reshape(f(np.array(list(p.values()))), (len(times), len(outputs)))

    simulator = mb.FunctionSimulator(response, dict.fromkeys(names, 0.0), times, outputs, noise=noise)
    return simulator, mb.Box(**dict.fromkeys(names, (-1.0, 1.0)))


def black_box(f, /, times=(0.0,), outputs="y", noise=None, nominal=None, **intervals):
    """A simulator of f(**parameters) with n_t n_y values, and its box. Nominal values are middles, unless given.

    Output names are divided by spaces.
    """
    names, times = outputs.split(), np.asarray(times)
    start = {name: (low + high) / 2 for name, (low, high) in intervals.items()} | (nominal or {})
    shaped = lambda **p: np.reshape(f(**p), (len(times), len(names)))  # noqa: E731
    return mb.FunctionSimulator(shaped, start, times, names, noise=noise), mb.Box(**intervals)


def black_box_bounds(f, /, method=None, times=(0.0,), outputs="y", noise=None, nominal=None, **intervals):
    """Bounds of a black box, by PolynomialChaos() unless a method is given."""
    simulator, box = black_box(f, times, outputs, noise, nominal, **intervals)
    return mb.propagate(simulator, method or mb.PolynomialChaos(), box)


def unit_bounds(f, d, method=None, *args, **options):
    """Bounds of f(x) for d parameters x (d,) from -1 to 1; further arguments are those of `unit_function`."""
    simulator, box = unit_function(f, d, *args, **options)
    return mb.propagate(simulator, method or mb.PolynomialChaos(), box)


def quietly(call, *arguments, **options):
    """What a call returns, whose warnings are ignored."""
    with warnings.catch_warnings(action="ignore", category=mb.SymmbWarning):
        return call(*arguments, **options)


def reloaded(result, path):
    """A result that is saved and loaded."""
    result.save(path)
    return type(result).load(path)


def rms(values, axis=None):
    """The root of the mean square."""
    return np.sqrt(np.mean(np.square(values), axis=axis))


def errors_of(bounds, lower, upper):
    """Distances of bounds from true ones."""
    return np.maximum(np.abs(bounds.lower - lower), np.abs(bounds.upper - upper))
