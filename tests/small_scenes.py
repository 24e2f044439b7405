"""Scenes of one mass, one state or formulas alone, whose laws tests write; parameters are given by their intervals."""

import numpy as np

import symmb as mb


def _parameters(intervals):
    return mb.Parameters(**{name: (low + high) / 2 for name, (low, high) in intervals.items()})


def _box(intervals):
    return mb.Box(**intervals) if intervals else None


def particle(law, times, start, outputs=("x",), **intervals):
    """A mass of 1 kg under a force law(p, mass), along x or in components; nominal values are middles of intervals."""
    p, mass = _parameters(intervals), mb.Body("mass", 1.0, pose=mb.Particle())
    force = law(p, mass)
    push = mb.Force("push", mass.point(0, 0), force if isinstance(force, tuple) else (force, 0))
    named = {name: getattr(mass, name) for name in outputs}
    return mb.Scene(mb.System(mass, push, parameters=p), start, times, named, box=_box(intervals))


def state(rate, times, start, outputs=lambda z: {"z": z}, **intervals):
    """A state z of a given start, whose rate(p, z) is a law."""
    p = _parameters(intervals)
    z = mb.State("z", rate=lambda z: rate(p, z))
    return mb.Scene(mb.System(z, parameters=p), {"z": start}, times, outputs(z.value), box=_box(intervals))


def formulas(outputs, times=(0.0,), **intervals):
    """Outputs(p) that depend on parameters and time alone."""
    p = _parameters(intervals)
    return mb.Scene(mb.System(parameters=p), times=np.array(times), outputs=outputs(p), box=_box(intervals))


def two_masses(law, name="oscillators", box=None, **nominal):
    """Masses a and b of 1 kg under forces law(p, a, b)."""
    p = mb.Parameters(**nominal)
    a, b = bodies = [mb.Body(name, 1.0, pose=mb.Particle()) for name in "ab"]
    forces = zip(bodies, law(p, a, b), strict=True)
    pushes = [mb.Force(f"on_{body.name}", body.point(0, 0, 0), force) for body, force in forces]
    return mb.Scene(mb.System(*bodies, *pushes, parameters=p), outputs={"x": a.x, "y": b.y}, box=box, name=name)


def pushing_oscillator(**options):
    """A damped mass on a spring, whose speed pushes a second one: b'' + 9 b = 2 a'."""
    law = lambda p, a, b: ((-p.k * a.x - 0.4 * a.vx, 0, 0), (0, -9 * b.y + 2 * a.vx, 0))  # noqa: E731
    return two_masses(law, k=4.0, **options)
