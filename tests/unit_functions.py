"""Functions of parameters from -1 to 1, as simulators with their boxes."""

import numpy as np

import symmb as mb


def unit_function(f, d, times=(0.0,), outputs=("y",), noise=None):
    """That of f(x) with n_t n_y values of d parameters x (d,), named x0, x1, ..."""
    names = [f"x{i}" for i in range(d)]

    def response(**p):
        return np.reshape(f(np.array(list(p.values()))), (len(times), len(outputs)))

    simulator = mb.FunctionSimulator(response, dict.fromkeys(names, 0.0), times, outputs, noise=noise)
    return simulator, mb.Box(**dict.fromkeys(names, (-1.0, 1.0)))
