"""Runs and their derivatives with respect to parameters: as arrays, and as functions of JAX and PyTorch."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np

from symmb._errors import DeclarationError, SimulationError, warn_of
from symmb._interrupts import kept_interrupts
from symmb._magnitudes import SAME
from symmb._names import ByName, counted
from symmb._options import optional_package, shown
from symmb._types import Array, Expr
from symmb._units import units_of_parameters
from symmb.connect import Jets, Kinked, Simulator
from symmb.equations.model import Scene
from symmb.run.integrate import Solver
from symmb.run.simulation.differences import differences
from symmb.run.simulation.subject import Subject, chosen_parameters

_SIZE, _UNCERTAIN = 0.1, 0.02
"""Direction for differences, divided by the value of the parameter. Largest error of a derivative without a warning,
divided by the largest derivative of the output over time."""


def has_exact_jets(simulator: Simulator, p: Array) -> bool:
    """Whether `jets` of the simulator gives derivatives of the run at p (d,), which then meets no kink or event."""
    return isinstance(simulator, Jets) and not (isinstance(simulator, Kinked) and simulator.kink(p))


class Differentiable:
    """Runs as a function of some parameters, with first derivatives.

    Attributes
    ----------
    simulator : Simulator
    parameters : dict
        n_p nominal values by name
    """

    def __init__(
        self,
        owner: str,
        scene: Scene | Simulator,
        parameters: Sequence[str] | None,
        solver: Solver | str | None,
        times: Sequence[float] | Array | None,
        outputs: Mapping[str, Expr] | None,
    ) -> None:
        simulator = Subject.of(scene, solver, times, outputs, owner=owner).simulator
        nominal = dict(simulator.parameters)
        some = chosen_parameters(owner, parameters, nominal)
        self._owner, self._nominal = owner, np.array(list(nominal.values()))
        self._columns = np.array([[*nominal].index(name) for name in some])
        self.simulator = simulator
        units = units_of_parameters(simulator.parameters)
        self.parameters = ByName({name: nominal[name] for name in some}, units)

    @property
    def shape(self) -> tuple[int, int]:
        """The shape (n_t, n_y) of the outputs of a run."""
        return len(self.simulator.times), len(self.simulator.outputs)

    def values(self, P: Array) -> Array:
        """Outputs (..., n_t, n_y) for parameters (..., n_p).

        Raises
        ------
        SimulationError
            If a run fails
        """
        samples = self.simulator.run(self._samples(P))
        if samples.messages:
            raise SimulationError(f"{self._owner}: a run fails: {samples.messages[0]}.")
        return samples.Y.reshape(*np.shape(P)[:-1], *self.shape)

    def at_nominal(self) -> tuple[Array, Array]:
        """The nominal outputs (n_t, n_y) and derivatives (n_t, n_y, n_p), with the warning of `slopes`."""
        return self.slopes(self._nominal[self._columns])

    def slopes(self, P: Array) -> tuple[Array, Array]:
        """Outputs (..., n_t, n_y) and derivatives (..., n_t, n_y, n_p) for parameters (..., n_p).

        Derivatives are integrated along with the motion. If a run meets a kink, a jump or an event, or the simulator
        has no derivatives, they are differences of runs. If differences are uncertain, a warning is issued.

        Raises
        ------
        SimulationError
            If a run fails
        """
        batch, n_p, points = np.shape(P)[:-1], len(self._columns), self._samples(P)
        directions = np.eye(len(self._nominal))[self._columns]
        Y, dY = np.zeros((len(points), *self.shape)), np.zeros((len(points), n_p, *self.shape))
        smooth = np.array([has_exact_jets(self.simulator, p) for p in points], dtype=bool)
        if smooth.any():
            at = np.repeat(points[smooth], n_p, axis=0)
            along = np.tile(directions, (len(at) // n_p, 1))
            jets = np.asarray(cast(Jets, self.simulator).jets(at, along, 1), dtype=float)
            Y[smooth], dY[smooth] = jets[0, ::n_p], jets[1].reshape(-1, *dY.shape[1:])
        doubts = list[str]()
        for k in np.flatnonzero(~smooth):
            sizes = _SIZE * np.where(points[k], np.abs(points[k]), 1.0)[self._columns, None]
            coefficients, errors = differences(self.simulator, points[k], sizes * directions)
            Y[k], dY[k] = coefficients[0, 0], coefficients[1] / sizes[..., None]
            doubts += self._doubts(coefficients[0], coefficients[1], errors[1])
        if doubts:
            warn_of(doubts[:1], self._owner)
        if not (np.isfinite(Y).all() and np.isfinite(dY).all()):
            raise SimulationError(f"{self._owner}: the derivatives are not finite, because runs fail.")
        return Y.reshape(*batch, *self.shape), np.moveaxis(dY, 1, -1).reshape(*batch, *self.shape, n_p)

    def _doubts(self, values: Array, slopes: Array, errors: Array) -> list[str]:
        """The warning about slopes (n_p, n_t, n_y) with large errors; empty if they are certain. Errors of a slope that
        are rounding errors of the values, each of the same shape, do not count."""
        largest, scales = (np.abs(each).max(axis=1, keepdims=True) for each in (slopes, values))
        is_far = errors > np.maximum(_UNCERTAIN * largest, SAME * scales)
        if not is_far.any():
            return []
        names = [name for name, one in zip(self.parameters, is_far.any(axis=(1, 2)), strict=True) if one]
        times = self.simulator.times[is_far.any(axis=(0, 2))]
        return [
            f"Derivatives with respect to {', '.join(names)} are uncertain at {counted(len(times), 'time')}, first at "
            f"t = {times[0]:g} s. There, the outputs have a kink or jump with respect to the parameters, or the errors "
            "of the runs are too large."
        ]

    def require_shape(self, shape: Sequence[int]) -> None:
        """Raise a DeclarationError unless the shape is (..., n_p)."""
        if not shape or shape[-1] != len(self._columns):
            raise DeclarationError(
                f"{self._owner}: expected an array of shape (..., {len(self._columns)}), with the values of "
                f"{', '.join(self.parameters)} along the last axis, got an array of shape {tuple(shape)}."
            )

    def _samples(self, P: Array) -> Array:
        """All parameters (N, d) of the simulator for values P (..., n_p) of the chosen parameters."""
        P = np.asarray(P, dtype=float)
        self.require_shape(P.shape)
        samples = np.tile(self._nominal, (int(np.prod(P.shape[:-1])), 1))
        samples[:, self._columns] = P.reshape(-1, len(self._columns))
        return samples


_NO_SECOND = "symmb computes first derivatives of runs only. Second derivatives are not available."


@kept_interrupts()
def jax_function(
    scene: Scene | Simulator,
    parameters: Sequence[str] | None = None,
    solver: Solver | str | None = None,
    *,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> Callable[[Any], Any]:
    """The runs of a scene as a function that JAX can differentiate, map and compile.

    The function has parameters (..., n_p) and returns outputs (..., n_t, n_y). The compiled code of symmb makes all
    runs of a call together, on the host. First derivatives are those of `sensitivities`, so that `jax.jvp` and
    `jax.grad` work. There are no second derivatives. Outputs are
    rounded to single precision unless double precision is switched on: `jax.config.update("jax_enable_x64", True)`.
    The function needs JAX: `pip install 'symmb[jax]'`.

    Parameters
    ----------
    scene : Scene
        scene or simulator
    parameters : list of str
        names of the parameters of the function, in this order; default: all. Other parameters have nominal values
    solver, times, outputs
        solver, times and outputs of the runs, if they differ from those of the scene

    Raises
    ------
    DeclarationError
        If a parameter is unknown or listed twice, or there are no parameters
    ImportError
        If JAX is not installed
    AssemblyError
        If the scene cannot be started
    SimulationError
        If the nominal run fails, or second derivatives are required. If a later run
        fails, JAX raises its own error with the reason

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(speed=1.0)
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> start, outputs = {"ball.vx": p.speed}, {"x": ball.x}
    >>> scene = mb.Scene(mb.System(ball, parameters=p), start, times=[0.0, 2.0], outputs=outputs)
    >>> import jax  # doctest: +SKIP
    >>> f = mb.jax_function(scene)  # doctest: +SKIP
    >>> jax.grad(lambda u: f(u)[-1, 0])(jax.numpy.array([1.5]))  # doctest: +SKIP
    Array([2.], dtype=float32)
    """
    return _function("jax", _of_jax, scene, parameters, solver, times, outputs)


@kept_interrupts()
def torch_function(
    scene: Scene | Simulator,
    parameters: Sequence[str] | None = None,
    solver: Solver | str | None = None,
    *,
    times: Sequence[float] | Array | None = None,
    outputs: Mapping[str, Expr] | None = None,
) -> Callable[[Any], Any]:
    """The runs of a scene as a function that PyTorch can differentiate.

    The function has a tensor of parameters (..., n_p) and returns outputs (..., n_t, n_y) of the same type. The
    compiled code of symmb makes all runs of a call together, on the CPU. First derivatives are those of
    `sensitivities`. There are no second derivatives, and `torch.func` is not supported. The function needs PyTorch:
    `pip install 'symmb[torch]'`.

    Parameters
    ----------
    scene, parameters, solver, times, outputs
        arguments of the same names in `jax_function`

    Raises
    ------
    DeclarationError, ImportError, AssemblyError, SimulationError
        In the same cases as `jax_function`. If a later run fails, SimulationError is raised

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(speed=1.0)
    >>> ball = mb.Body("ball", mass=1.0, pose=mb.Particle())
    >>> start, outputs = {"ball.vx": p.speed}, {"x": ball.x}
    >>> scene = mb.Scene(mb.System(ball, parameters=p), start, times=[0.0, 2.0], outputs=outputs)
    >>> import torch  # doctest: +SKIP
    >>> u = torch.tensor([1.5], dtype=torch.float64, requires_grad=True)  # doctest: +SKIP
    >>> mb.torch_function(scene)(u)[-1, 0].backward()  # doctest: +SKIP
    >>> u.grad  # doctest: +SKIP
    tensor([2.], dtype=torch.float64)
    """
    return _function("torch", _of_torch, scene, parameters, solver, times, outputs)


def _function(
    package: str, wrapped: Callable[[Any, Differentiable], Callable[[Any], Any]], *subject: Any
) -> Callable[[Any], Any]:
    """The runs of a scene or simulator as a function of arrays of the given package."""
    owner = f"{package}_function"
    module, runs = optional_package(package, owner, package), Differentiable(owner, *subject)
    runs.at_nominal()
    return wrapped(module, runs)


def _of_jax(jax: Any, runs: Differentiable) -> Callable[[Any], Any]:
    def called(f: Callable[[Array], Any], shapes: Sequence[tuple[int, ...]], u: Any) -> Any:
        results = [jax.ShapeDtypeStruct((*u.shape[:-1], *shape), u.dtype) for shape in shapes]
        own = lambda u: [np.asarray(a, dtype=u.dtype) for a in f(np.asarray(u))]  # noqa: E731
        if not isinstance(u, jax.core.Tracer):  # outside of compiled functions, JAX would wrap our errors in its own
            return [jax.numpy.asarray(a) for a in own(u)]
        return jax.pure_callback(own, results, u, vmap_method="broadcast_all")

    @jax.custom_jvp
    def function(u: Any) -> Any:
        return called(lambda u: [runs.values(u)], [runs.shape], u)[0]

    @jax.custom_jvp
    def slopes(u: Any) -> Any:
        return tuple(called(runs.slopes, [runs.shape, (*runs.shape, len(runs.parameters))], u))

    @slopes.defjvp
    def second(point: Sequence[Any], tangent: Sequence[Any]) -> Any:
        raise SimulationError(f"jax_function: {_NO_SECOND}")

    @function.defjvp
    def jvp(point: Sequence[Any], tangent: Sequence[Any]) -> tuple[Any, Any]:
        y, dy = slopes(*point)
        return y, jax.numpy.einsum("...typ,...p->...ty", dy, *tangent)

    def checked(u: Any) -> Any:
        try:
            u = jax.numpy.asarray(u)
        except (TypeError, ValueError):
            raise DeclarationError(f"jax_function: expected an array of numbers, got {shown(u)}.") from None
        if u.dtype == bool or jax.numpy.issubdtype(u.dtype, jax.numpy.complexfloating):
            raise DeclarationError(f"jax_function: expected real numbers, got {u.dtype}.")
        runs.require_shape(u.shape)
        return function(u.astype(jax.dtypes.canonicalize_dtype(float)))

    return checked


def _of_torch(torch: Any, runs: Differentiable) -> Callable[[Any], Any]:
    class Runs(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, u: Any) -> Any:
            P = u.detach().cpu().double().numpy()
            if not ctx.needs_input_grad[0]:
                return torch.as_tensor(runs.values(P)).to(u)
            y, dy = runs.slopes(P)
            ctx.save_for_backward(torch.as_tensor(dy).to(u))
            return torch.as_tensor(y).to(u)

        @staticmethod
        def backward(ctx: Any, of_y: Any) -> Any:
            if torch.is_grad_enabled():  # create_graph=True enables it, for second derivatives
                raise SimulationError(f"torch_function: {_NO_SECOND}")
            return torch.einsum("...ty,...typ->...p", of_y, *ctx.saved_tensors)

    def checked(u: Any) -> Any:
        if not (isinstance(u, torch.Tensor) and u.is_floating_point() and u.layout == torch.strided):
            raise DeclarationError(f"torch_function: expected a dense tensor of real numbers, got {shown(u)}.")
        return Runs.apply(u)

    return checked
