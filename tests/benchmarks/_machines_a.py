"""Twelve everyday machines with the tolerances of drawings and data sheets: doors, presses, cars, arms.

Each is a function of a random generator. None gives the machine as it is drawn, and a generator one of its neighbours.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

import symmb as mb

G = 9.81
"""Gravity [m/s^2]."""


class Variation:
    """Nominal values and tolerances of a machine, or of a random neighbour of it.

    Parameters
    ----------
    rng : Generator
        draws the neighbour; None for the machine itself
    """

    def __init__(self, rng: np.random.Generator | None) -> None:
        self._rng = rng

    def values(self, *, geometry: tuple[str, ...] = (), **nominal: float) -> dict[str, float]:
        """Nominal values times 0.85 to 1.2, those named in `geometry` times 0.98 to 1.02."""
        return {
            name: value * (self._between(0.98, 1.02, 1.0) if name in geometry else self._between(0.85, 1.2, 1.0))
            for name, value in nominal.items()
        }

    def box(self, values: dict[str, float], **half_widths: float) -> mb.Box:
        """Intervals of a half width to both sides of the values, which is 0.5 to 2 times as wide in neighbours."""
        widths = {name: width * 2 ** self._between(-1.0, 1.0, 0.0) for name, width in half_widths.items()}
        return mb.Box(**{name: (values[name] - width, values[name] + width) for name, width in widths.items()})

    def _between(self, lowest: float, highest: float, nominal: float) -> float:
        """A random number between two, or the nominal one of the machine itself."""
        return nominal if self._rng is None else float(self._rng.uniform(lowest, highest))


def rod(name: str, length: ca.SX, mass: float | ca.SX) -> mb.Body:
    """A slender rod along x. Its points count from its end."""
    return mb.Body(name, mass=mass, inertia=mass * length**2 / 12, pose=mb.Planar(), com=(length / 2, 0))


def door_closer(rng: np.random.Generator | None) -> mb.Scene:
    """A door is shut by a spring in its closer; its valve changes at 15 degrees, and the leaf hits the frame."""
    vary = Variation(rng)
    lengths = {"main": 0.24, "fore": 0.33, "bracket": 0.45}
    v = vary.values(
        geometry=tuple(lengths), **lengths, mass=45.0, preload=7.0, spring=4.0, sweep=9.0, latch=4.0, seal=0.6
    )
    p = mb.Parameters(**v)
    width, shut = 0.9, 1.55
    ground = mb.Ground()
    leaf = mb.Body("leaf", p.mass, p.mass * width**2 / 12, mb.Planar(), com=(width / 2, 0))
    main, fore = rod("main", p.main, 0.6), rod("fore", p.fore, 0.5)
    hinge = mb.Revolute("hinge", ground.point(0, 0), leaf.point(0, 0))
    pinion = mb.Revolute("pinion", leaf.point(0.22, 0.06), main.point(0, 0))
    oil = ca.if_else(hinge.angle > np.radians(15), p.sweep, p.latch)
    torque = p.preload + p.spring * (shut - pinion.angle) - oil * pinion.angle_rate
    system = mb.System(
        leaf, main, fore, hinge, pinion,
        mb.Revolute("elbow", main.point(p.main, 0), fore.point(0, 0)),
        mb.Revolute("shoe", fore.point(p.fore, 0), ground.point(p.bracket, 0.06)),
        mb.Actuator("closer", pinion, torque),
        mb.Actuator("bearing", hinge, -p.seal * ca.tanh(hinge.angle_rate / 0.02)),
        mb.Stop("frame", hinge, 0.0, None, mb.KelvinVoigt(6e4, 150.0)),
        parameters=p,
    )  # fmt: skip
    return mb.Scene(
        system,
        start={"hinge.angle": 1.4},
        guess={"main.theta": 0.25, "fore.theta": -0.76},
        times=np.linspace(0, 6, 151),
        outputs={
            "angle": hinge.angle,
            "speed": hinge.angle_rate,
            "slam": mb.maximum(system.force("frame")),
            "shut after": mb.first_time(hinge.angle <= 0),
        },
        box=vary.box(v, main=3e-4, fore=3e-4, mass=1.0, preload=0.7, spring=0.2, sweep=0.6, latch=0.3, seal=0.12),
        name="door closer",
    )


def windshield_wiper(rng: np.random.Generator | None) -> mb.Scene:
    """A geared motor swings a wiper by a four-bar; the friction of the blade turns over at both ends of the sweep."""
    vary = Variation(rng)
    lengths = {"crank": 0.04, "link": 0.3, "rocker": 0.065, "base": 0.3}
    v = vary.values(geometry=tuple(lengths), **lengths, press=11.0, mu=0.8, voltage=13.0, resistance=0.5)
    p = mb.Parameters(**v)
    gear = 60.0
    ground = mb.Ground()
    crank, link = mb.Body("crank", 0.15, gear**2 * 6e-6, mb.Planar()), rod("link", p.link, 0.3)
    arm = mb.Body("arm", 0.5, 0.04, mb.Planar(), com=(0, 0.25))
    shaft = mb.Revolute("shaft", ground.point(0, 0), crank.point(0, 0))
    pivot = mb.Revolute("pivot", ground.point(p.base, 0), arm.point(0, 0))
    motor = mb.Motor("motor", shaft, p.voltage, p.resistance, 0.025, gear=gear, friction=1e-5)
    blade = 0.45  # m from the pivot to the middle of the blade
    drag = -p.mu * p.press * blade * ca.tanh(pivot.angle_rate * blade / 0.05)
    system = mb.System(
        crank, link, arm, shaft, pivot, motor,
        mb.Revolute("ball_a", crank.point(p.crank, 0), link.point(0, 0)),
        mb.Revolute("ball_b", link.point(p.link, 0), arm.point(0, p.rocker)),
        mb.Actuator("glass", pivot, drag),
        parameters=p,
    )  # fmt: skip
    pull = system.reaction("ball_b")
    return mb.Scene(
        system,
        start={"shaft.angle": 0.9},
        guess={"link.theta": 0.1, "arm.theta": 0.1},
        times=np.linspace(0, 2, 201),
        outputs={
            "sweep": pivot.angle,
            "current": motor.current,
            "peak pull": mb.maximum(ca.sqrt(pull.fx**2 + pull.fy**2), window=(0.1, None)),
            "outer end": mb.maximum(pivot.angle),
        },
        box=vary.box(
            v, crank=2e-4, link=4e-4, rocker=2e-4, base=4e-4, press=1.0, mu=0.16, voltage=0.4, resistance=0.02
        ),
        name="windshield wiper",
    )


def toggle_latch(rng: np.random.Generator | None) -> mb.Scene:
    """A hand turns a latch over its dead centre against the spring of the hook, on to a stop, and lets go at 0.35 s."""
    vary = Variation(rng)
    lengths = {"throw": 0.02, "link": 0.06}
    v = vary.values(geometry=tuple(lengths), **lengths, grip=4e-3, spring=9e4, hand=3.4, drag=0.25, behind=0.07, mu=0.1)
    reach = v["link"] - v["throw"] + v["grip"]
    v["reach"] = reach  # where the hook meets its catch
    p = mb.Parameters(**{name: value for name, value in v.items() if name != "grip"})
    ground = mb.Ground()
    handle = mb.Body("handle", 0.3, 1.2e-3, mb.Planar(), com=(0.02, 0.0))
    link = rod("link", p.link, 0.05)
    hook = mb.Body("hook", 0.08, 1e-5, mb.Planar())
    pivot = mb.Revolute("pivot", ground.point(0, 0), handle.point(0, 0))
    slide = mb.Prismatic("slide", ground.point(0, 0), hook.point(0, 0), axis=(1, 0, 0))
    clamp = p.spring * ca.fmax(p.reach - slide.displacement, 0)
    hand = p.hand * (1 - 1 / (1 + ca.exp(-(mb.t - 0.35) / 0.005)))
    pin = p.mu * clamp * 5e-3 * ca.tanh(pivot.angle_rate / 0.3)  # dry friction in a pin of 10 mm
    system = mb.System(
        handle, link, hook, pivot, slide,
        mb.Revolute("pin", handle.point(-p.throw, 0), link.point(0, 0)),
        mb.Revolute("eye", link.point(p.link, 0), hook.point(0, 0)),
        mb.Actuator("hand", pivot, -hand - p.drag * pivot.angle_rate - pin),
        mb.Actuator("catch", slide, clamp),
        mb.Stop("body", pivot, -p.behind, None, mb.KelvinVoigt(600.0, 0.5)),
        parameters=p,
    )  # fmt: skip
    return mb.Scene(
        system,
        start={"pivot.angle": 1.7},
        guess={"link.theta": 0.33, "slide.displacement": 0.06},
        times=np.linspace(0, 0.6, 151),
        outputs={
            "angle": pivot.angle,
            "clamp": clamp,
            "knock": mb.maximum(system.force("body")),
            "over centre": mb.first_time(pivot.angle <= 0),
        },
        box=vary.box(v, throw=1e-4, link=1e-4, reach=3e-4, spring=6e3, hand=0.15, drag=0.02, behind=0.01, mu=0.02),
        name="toggle latch",
    )


def toggle_press(rng: np.random.Generator | None) -> mb.Scene:
    """A flywheel drives a knuckle joint that coins a sheet: tool and sheet touch for a quarter of a second."""
    vary = Variation(rng)
    lengths = {"crank": 0.05, "pitman": 0.4, "upper": 0.25, "lower": 0.28}
    v = vary.values(geometry=tuple(lengths), **lengths, gap=0.02, bite=3e-3, stiffness=5e7, speed=6.0, wheel=55.0)
    top = 0.6
    base = v["crank"] + v["pitman"] + v["gap"]
    knee = top - np.sqrt(v["upper"] ** 2 - v["gap"] ** 2)
    v["base"] = base  # from the crank shaft to the slide's axis
    v["sheet"] = knee - np.sqrt(v["lower"] ** 2 - v["gap"] ** 2) + v["bite"]
    p = mb.Parameters(**{name: value for name, value in v.items() if name not in ("gap", "bite")})
    ground = mb.Ground()
    crank = mb.Body("crank", 60.0, p.wheel, mb.Planar())
    pitman, upper, lower = rod("pitman", p.pitman, 25.0), rod("upper", p.upper, 20.0), rod("lower", p.lower, 20.0)
    ram = mb.Body("ram", 180.0, 4.0, mb.Planar())
    shaft = mb.Revolute("shaft", ground.point(-p.base, knee), crank.point(0, 0))
    slide = mb.Prismatic("slide", ground.point(0, 0), ram.point(0, 0), axis=(0, 1, 0))
    tool = p.stiffness * ca.fmax(p.sheet - slide.displacement, 0)
    system = mb.System(
        crank, pitman, upper, lower, ram, shaft, slide,
        mb.Revolute("crown", ground.point(0, top), upper.point(0, 0)),
        mb.Revolute("knee", upper.point(p.upper, 0), lower.point(0, 0)),
        mb.Revolute("crank_pin", crank.point(p.crank, 0), pitman.point(0, 0)),
        mb.Revolute("knee_pin", pitman.point(p.pitman, 0), upper.point(p.upper, 0)),
        mb.Revolute("ram_pin", lower.point(p.lower, 0), ram.point(0, 0)),
        mb.Actuator("motor", shaft, 60.0 * (p.speed - shaft.angle_rate)),
        mb.Actuator("tool", slide, tool),
        mb.Gravity(0, -G),
        parameters=p,
    )  # fmt: skip
    return mb.Scene(
        system,
        start={"shaft.angle": -2.5, "shaft.angle_rate": p.speed},
        guess={"pitman.theta": 0.1, "upper.theta": -2.0, "lower.theta": -1.15, "ram.y": 0.1},
        times=np.linspace(0, 1, 201),
        outputs={
            "stroke": slide.displacement,
            "force": tool * 1e-3,
            "peak force": mb.maximum(tool * 1e-3),
            "slowest": mb.minimum(shaft.angle_rate),
        },
        box=vary.box(
            v, crank=5e-5, pitman=1e-4, upper=1e-4, lower=1e-4, base=1e-4, sheet=1e-4, stiffness=2.5e6, speed=0.15
        ),
        name="toggle press",
    )


def quarter_car(rng: np.random.Generator | None) -> mb.Scene:
    """A wheel runs over a threshold: its damper has two rates, it meets a bump stop, and the tyre may take off."""
    vary = Variation(rng)
    v = vary.values(
        body=320.0, wheel=42.0, spring=21e3, tyre=2e5, bump=900.0, rebound=2200.0, travel=0.05, rubber=2.5e5,
        height=0.09, speed=7.0,
    )  # fmt: skip
    p = mb.Parameters(**v)
    body, wheel = mb.Body("body", p.body, pose=mb.Particle()), mb.Body("wheel", p.wheel, pose=mb.Particle())
    length = 0.8  # m of the threshold
    way = (p.speed * mb.t - 0.5) / length
    road = p.height * ca.if_else(ca.fabs(way - 0.5) < 0.5, (1 - ca.cos(2 * np.pi * way)) / 2, 0)
    squeeze, rate = wheel.y - body.y, wheel.vy - body.vy  # from the length without load
    static = p.body * G / p.spring
    damper = ca.if_else(rate > 0, p.bump, p.rebound) * rate
    stop = p.rubber * ca.fmax(squeeze - static - p.travel, 0)
    strut = p.spring * squeeze + damper + stop
    tyre = ca.fmax(p.tyre * (road - wheel.y), 0)
    system = mb.System(
        body, wheel,
        mb.Force("strut_up", body.point(0, 0), (0, strut)),
        mb.Force("strut_down", wheel.point(0, 0), (0, -strut)),
        mb.Force("tyre", wheel.point(0, 0), (0, tyre)),
        mb.Gravity(0, -G),
        parameters=p,
    )  # fmt: skip
    sink = (p.body + p.wheel) * G / p.tyre
    box = vary.box(
        v, body=12.0, wheel=1.0, spring=1e3, tyre=1.2e4, bump=90.0, rebound=200.0,
        travel=2e-3, rubber=2e4, height=2e-3, speed=0.2,
    )  # fmt: skip
    return mb.Scene(
        system,
        start={"wheel.y": -sink, "body.y": -sink - static},
        times=np.linspace(0, 1.5, 201),
        outputs={
            "body": body.y,
            "tyre": tyre * 1e-3,
            "stop": mb.maximum(stop * 1e-3),
            "acceleration": mb.maximum(system.ddt(body.vy)),
        },
        box=box,
        name="quarter car",
    )


def half_car(rng: np.random.Generator | None) -> mb.Scene:
    """A car pitches on a washboard road, which begins gently; springs, dampers and tyres are linear, all is smooth."""
    vary = Variation(rng)
    v = vary.values(
        geometry=("ahead", "wave"), mass=620.0, inertia=950.0, ahead=1.15, front=19e3, rear=21e3, oil_front=1300.0,
        oil_rear=1500.0, tyre=1.8e5, speed=9.0, height=0.012, wave=4.5,
    )  # fmt: skip
    p = mb.Parameters(**v)
    wheelbase = 2.55
    body = mb.Body("body", p.mass, p.inertia, mb.Planar())
    parts: list[Any] = [body]
    outputs: dict[str, Any] = {"bounce": body.y, "pitch": body.theta}
    for name, x, stiffness, damping in (
        ("front", p.ahead, p.front, p.oil_front),
        ("rear", p.ahead - wheelbase, p.rear, p.oil_rear),
    ):
        axle = mb.Body(name, 38.0, pose=mb.Particle())
        road = p.height * (1 - ca.exp(-((mb.t / 0.25) ** 2))) * ca.sin(2 * np.pi * (p.speed * mb.t + x) / p.wave)
        seat = body.point(x, 0)
        strut = stiffness * (axle.y - seat.y) + damping * (axle.vy - seat.vy)
        tyre = p.tyre * (road - axle.y)
        parts += [
            axle,
            mb.Force(f"{name}_up", seat, (0, strut)),
            mb.Force(f"{name}_down", axle.point(0, 0), (0, tyre - strut)),
        ]
        if name == "rear":
            outputs["rear tyre"] = tyre
    system = mb.System(*parts, parameters=p)
    outputs["acceleration"] = mb.maximum(system.ddt(body.vy))
    box = vary.box(
        v, mass=25.0, inertia=40.0, ahead=0.01, front=1e3, rear=1e3, oil_front=120.0,
        oil_rear=120.0, tyre=9e3, speed=0.25, height=5e-4,
    )  # fmt: skip
    return mb.Scene(system, times=np.linspace(0, 2.5, 201), outputs=outputs, box=box, name="half car")


def full_car(rng: np.random.Generator | None) -> mb.Scene:
    """A car of seven degrees of freedom passes a round bump with its left wheels; dampers give way, all is smooth."""
    vary = Variation(rng)
    v = vary.values(
        geometry=("track",), mass=1250.0, roll=480.0, pitch=2000.0, front=20e3, rear=23e3, oil=1600.0, bar=9e3,
        tyre=1.9e5, speed=8.0, height=0.05, track=0.74,
    )  # fmt: skip
    p = mb.Parameters(**v)
    wheelbase, ahead = 2.6, 1.2
    body = mb.Body("body", p.mass, (p.roll, p.pitch, 0.9 * (p.roll + p.pitch)), mb.Spatial())
    parts: list[Any] = [
        body,
        mb.Motion("no_x", body.x, 0),
        mb.Motion("no_y", body.y, 0),
        mb.Motion("no_yaw", body.point(1, 0, 0).y - body.y, 0),
    ]
    squeezes, tyres = {}, {}
    for axle, x, stiffness in (("front", ahead, p.front), ("rear", ahead - wheelbase, p.rear)):
        wheels = {}
        for side, y in (("left", p.track), ("right", -p.track)):
            name = f"{axle}_{side}"
            wheel, corner = mb.Body(name, 44.0, pose=mb.Particle()), body.point(x, y, 0)
            way = (p.speed * mb.t + x - ahead - 1.2) / 0.35
            road = p.height * ca.exp(-(way**2)) if side == "left" else 0.0
            rate = wheel.vz - corner.vz
            squeezes[name] = wheel.z - corner.z
            strut = stiffness * squeezes[name] + p.oil * 0.3 * ca.tanh(rate / 0.3)
            tyres[name] = p.tyre * (road - wheel.z)
            parts += [
                wheel,
                mb.Motion(f"{name}_x", wheel.x, x),
                mb.Motion(f"{name}_y", wheel.y, y),
                mb.Force(f"{name}_tyre", wheel.point(0, 0, 0), (0, 0, tyres[name])),
            ]
            wheels[side] = (wheel, corner, strut)
        twist = p.bar * (squeezes[f"{axle}_left"] - squeezes[f"{axle}_right"])
        for side, sign in (("left", 1), ("right", -1)):
            wheel, corner, strut = wheels[side]
            push = strut + sign * twist
            parts += [
                mb.Force(f"{axle}_{side}_up", corner, (0, 0, push)),
                mb.Force(f"{axle}_{side}_down", wheel.point(0, 0, 0), (0, 0, -push)),
            ]
    system = mb.System(*parts, parameters=p)
    box = vary.box(
        v, mass=40.0, roll=20.0, pitch=80.0, front=1e3, rear=1.2e3, oil=150.0,
        bar=700.0, tyre=9e3, speed=0.2, height=1e-3,
    )  # fmt: skip
    return mb.Scene(
        system,
        times=np.linspace(0, 1.5, 151),
        outputs={
            "heave": body.z,
            "roll": body.point(0, 1, 0).z - body.z,
            "pitch": body.z - body.point(1, 0, 0).z,
            "tyre": mb.maximum(tyres["rear_left"] * 1e-3),
        },
        box=box,
        name="full car",
    )


def seat_rail(rng: np.random.Generator | None) -> mb.Scene:
    """A driver pushes the seat back along its inclined rails against friction; it hits the end stop and rebounds."""
    vary = Variation(rng)
    v = vary.values(mass=88.0, mu=0.14, rise=0.06, push=380.0, assist=300.0, stroke=0.21, rebound=0.35, preload=25.0)
    p = mb.Parameters(**v)
    ground = mb.Ground()
    seat = mb.Body("seat", p.mass, 6.0, mb.Planar())
    along = (ca.cos(p.rise), ca.sin(p.rise))
    rail = mb.Prismatic("rail", ground.point(0, 0), seat.point(0, 0), axis=along, axis_b=(1, 0, 0))
    legs = p.push * ca.fmax(1 - mb.t / 1.5, 0)
    helper = p.assist * (p.stroke - rail.displacement)
    system = mb.System(
        seat, rail,
        mb.Actuator("legs", rail, legs + helper),
        mb.Friction(
            "shoes", ground.point(0, 0), seat.point(0, 0), along, p.mass * G * ca.cos(p.rise) + p.preload,
            mb.Coulomb(p.mu, 0.02),
        ),
        mb.Stop("end", rail, None, p.stroke, restitution=p.rebound),
        mb.Gravity(0, -G),
        parameters=p,
    )  # fmt: skip
    return mb.Scene(
        system,
        start={"rail.displacement": 0.0},
        times=np.linspace(0, 1.2, 121),
        outputs={
            "way": rail.displacement,
            "speed": rail.displacement_rate,
            "arrival": mb.first_time(rail.displacement >= p.stroke),
            "knock": mb.maximum(rail.displacement_rate),
        },
        box=vary.box(v, mass=2.0, mu=0.02, rise=3e-3, push=8.0, assist=15.0, stroke=5e-4, rebound=0.05, preload=2.5),
        name="seat rail",
    )


def parallel_gripper(rng: np.random.Generator | None) -> mb.Scene:
    """Two coupled jaws close by air pressure on a work piece off their centre, which the first one pushes along."""
    vary = Variation(rng)
    v = vary.values(
        geometry=("width", "open"), width=0.04, open=0.06, off=8e-4, area=3.1e-4, pressure=5e5, fill=0.04, jaw=0.35,
        piece=0.5, pad=2.5e5, mu=0.2, seal=12.0,
    )  # fmt: skip
    p = mb.Parameters(**v)
    ground = mb.Ground()
    left, right = mb.Body("left", p.jaw, 1e-3, mb.Planar()), mb.Body("right", p.jaw, 1e-3, mb.Planar())
    piece = mb.Body("piece", p.piece, 1e-3, mb.Planar())
    rails = [
        mb.Prismatic(f"rail_{body.name}", ground.point(0, 0), body.point(0, 0), axis=(1, 0, 0))
        for body in (left, right, piece)
    ]
    air = mb.State("air", rate=lambda pressure: (p.pressure - pressure) / p.fill)
    drive = p.area * air.value - p.seal * ca.tanh(left.vx / 0.01) - 60.0 * left.vx
    law = mb.KelvinVoigt(p.pad, 120.0)
    system = mb.System(
        left, right, piece, *rails, air,
        mb.Motion("pinion", left.x + right.x, 0),
        mb.Force("piston", left.point(0, 0), (drive, 0)),
        mb.Contact("left_pad", piece.point(-p.width / 2, 0), left.point(0, 0), (1, 0), law),
        mb.Contact("right_pad", piece.point(p.width / 2, 0), right.point(0, 0), (-1, 0), law),
        mb.Friction(
            "table", ground.point(0, 0), piece.point(0, 0), (1, 0, 0), p.piece * G, mb.Coulomb(p.mu, 0.01)
        ),
        parameters=p,
    )  # fmt: skip
    grip = system.force("right_pad")
    return mb.Scene(
        system,
        start={"left.x": -p.open / 2, "piece.x": p.off},
        times=np.linspace(0, 0.25, 126),
        outputs={"jaw": left.x * 1e3, "piece": piece.x * 1e3, "grip": grip, "peak grip": mb.maximum(grip)},
        box=vary.box(
            v, width=1e-4, off=4e-4, pressure=2e4, fill=3e-3, jaw=5e-3, piece=0.02, pad=2e4, mu=0.04, seal=2.0
        ),
        name="parallel gripper",
    )


def scissor_lift(rng: np.random.Generator | None) -> mb.Scene:
    """A cylinder raises a platform on a pair of scissors; a bore off the middle tilts it, and all is smooth."""
    vary = Variation(rng)
    v = vary.values(
        geometry=("bar", "low", "high", "shut"), bar=1.6, bore=0.0, low=0.55, high=0.2, shut=0.4, stroke=0.15,
        load=500.0, place=0.6, platform=120.0, beam=25.0,
    )  # fmt: skip
    p = mb.Parameters(**v)
    ground = mb.Ground()
    first = mb.Body("first", p.beam, p.beam * p.bar**2 / 12, mb.Planar())
    second = mb.Body("second", p.beam, p.beam * p.bar**2 / 12, mb.Planar())
    deck = mb.Body("deck", p.platform, p.platform * 1.6**2 / 12, mb.Planar(), com=(0.8, 0.1))
    load = mb.Body("load", p.load, p.load * 0.1, mb.Planar())
    a, b = first.point(-p.low, 0), second.point(p.high, 0)
    s = mb.t / 4.0
    law = p.shut + p.stroke * s**3 * (10 - 15 * s + 6 * s**2)
    system = mb.System(
        first, second, deck, load,
        mb.Revolute("foot", ground.point(0, 0), first.point(-p.bar / 2, 0)),
        mb.Revolute("middle", first.point(0, 0), second.point(p.bore, 0)),
        mb.PointOnLine("track", ground.point(0, 0), second.point(-p.bar / 2, 0), axis=(1, 0, 0)),
        mb.Revolute("head", second.point(p.bar / 2, 0), deck.point(0, 0)),
        mb.PointOnLine("slot", deck.point(0, 0), first.point(p.bar / 2, 0), axis=(1, 0, 0)),
        mb.Weld("strap", deck.point(p.place, 0.1), load.point(0, -0.3)),
        mb.Motion("cylinder", ca.sqrt((a.x - b.x) ** 2 + (a.y - b.y) ** 2), law),
        mb.Gravity(0, -G),
        parameters=p,
    )  # fmt: skip
    thrust = -system.lam("cylinder")[0] * 1e-3
    return mb.Scene(
        system,
        guess={"first.theta": 0.3, "second.theta": np.pi - 0.3, "second.x": 0.76, "second.y": 0.23, "deck.y": 0.5},
        times=np.linspace(0, 4, 101),
        outputs={"height": load.y, "tilt": deck.theta * 1e3, "thrust": thrust, "greatest thrust": mb.maximum(thrust)},
        box=vary.box(
            v, bar=3e-4, bore=3e-4, low=3e-4, high=3e-4, shut=5e-4, stroke=5e-4, load=10.0, place=5e-3, beam=0.5
        ),
        name="scissor lift",
    )


def robot_arm(rng: np.random.Generator | None) -> mb.Scene:
    """An arm swings a load over by two joints with dry friction, and its motors reach their largest torques."""
    vary = Variation(rng)
    v = vary.values(
        geometry=("upper", "fore"), upper=0.45, fore=0.38, load=4.0, first=3.0, second=1.5, stiff=900.0, damp=75.0,
        limit=125.0, rise=0.7,
    )  # fmt: skip
    p = mb.Parameters(**v)
    ground = mb.Ground()
    upper, fore = rod("upper", p.upper, 7.0), rod("fore", p.fore, 4.0)
    load = mb.Body("load", p.load, 0.01, mb.Planar())
    shoulder = mb.Revolute("shoulder", ground.point(0, 0), upper.point(0, 0))
    elbow = mb.Revolute("elbow", upper.point(p.upper, 0), fore.point(0, 0))
    s = ca.fmin(mb.t / p.rise, 1)
    ramp = s**2 * (3 - 2 * s)

    def motor(joint: mb.Revolute, begin: float, turn: float, share: float) -> ca.SX:
        wanted = share * (p.stiff * (begin + turn * ramp - joint.angle) - p.damp * joint.angle_rate)
        largest = share * p.limit
        return ca.fmin(ca.fmax(wanted, -largest), largest)

    torques = motor(shoulder, -0.6, 1.7, 1.0), motor(elbow, 1.2, -0.9, 0.45)
    drags = p.first * ca.tanh(shoulder.angle_rate / 0.03), p.second * ca.tanh(elbow.angle_rate / 0.03)
    tip = fore.point(p.fore, 0)
    system = mb.System(
        upper, fore, load, shoulder, elbow,
        mb.Weld("grip", tip, load.point(0, 0)),
        mb.Actuator("shoulder_motor", shoulder, torques[0] - drags[0]),
        mb.Actuator("elbow_motor", elbow, torques[1] - drags[1]),
        mb.Gravity(0, -G),
        parameters=p,
    )  # fmt: skip
    return mb.Scene(
        system,
        start={"shoulder.angle": -0.6, "elbow.angle": 1.2},
        times=np.linspace(0, 1.6, 161),
        outputs={"x": tip.x, "y": tip.y, "torque": torques[0], "overshoot": mb.maximum(tip.y)},
        box=vary.box(
            v, upper=3e-4, fore=3e-4, load=0.1, first=0.6, second=0.3, stiff=45.0, damp=4.0, limit=3.0, rise=0.02
        ),
        name="robot arm",
    )


def paper_feeder(rng: np.random.Generator | None) -> mb.Scene:
    """A sampled controller turns a roller through backlash; its rubber drags a sheet that slips against the stack."""
    vary = Variation(rng)
    v = vary.values(
        geometry=("radius",), radius=0.012, rotor=3e-5, roller=6e-5, backlash=0.03, nip=3.0, rubber=1.1, stack=0.25,
        sheet=0.005, gain=0.08, memory=0.9, speed=0.3,
    )  # fmt: skip
    p = mb.Parameters(**v)
    ground = mb.Ground()
    rotor, roller = mb.Body("rotor", 0.1, p.rotor, mb.Planar()), mb.Body("roller", 0.2, p.roller, mb.Planar())
    sheet = mb.Body("sheet", p.sheet, pose=mb.Particle())
    motor_shaft = mb.Revolute("motor_shaft", ground.point(0, 0), rotor.point(0, 0))
    roller_shaft = mb.Revolute("roller_shaft", ground.point(0, 0), roller.point(0, 0))
    wanted = p.speed / p.radius * ca.fmin(mb.t / 0.08, 1)
    error = wanted - motor_shaft.angle_rate
    total = mb.Sampled("total", 0.01, lambda held: held + 0.01 * error)
    voltage = mb.Sampled("voltage", 0.01, ca.fmin(ca.fmax(p.gain * error + p.memory * total.value, -6), 6))
    motor = mb.Motor("motor", motor_shaft, voltage.value + 0.02 * wanted, 3.0, 0.02)
    slip = p.radius * roller.omega - sheet.vx
    grip = p.rubber * p.nip * ca.tanh(slip / 0.08)
    drag = p.stack * p.nip * ca.tanh(sheet.vx / 0.02)
    system = mb.System(
        rotor, roller, sheet, motor_shaft, roller_shaft, total, voltage, motor,
        mb.TorsionContact("coupling", rotor, roller, p.backlash, mb.KelvinVoigt(8.0, 4e-3)),
        mb.Actuator("bearing", roller_shaft, -5e-3 * ca.tanh(roller.omega / 0.3) - p.radius * grip),
        mb.Force("nip", sheet.point(0, 0), (grip - drag, 0)),
        parameters=p,
    )  # fmt: skip
    return mb.Scene(
        system,
        start={"motor_shaft.angle": 0.0, "roller_shaft.angle": 0.0},
        times=np.linspace(0, 0.5, 101),
        outputs={
            "sheet": sheet.x * 1e3,
            "roller": roller.omega,
            "voltage": voltage.value,
            "at sensor": mb.first_time(sheet.x >= 0.05),
        },
        box=vary.box(
            v, radius=1e-4, rotor=1e-6, roller=2e-6, backlash=0.01, nip=0.3, rubber=0.2, stack=0.05, speed=6e-3
        ),
        name="paper feeder",
    )


MACHINES: dict[str, Callable[[np.random.Generator | None], mb.Scene]] = {
    "door closer": door_closer,
    "windshield wiper": windshield_wiper,
    "toggle latch": toggle_latch,
    "toggle press": toggle_press,
    "quarter car": quarter_car,
    "half car": half_car,
    "full car": full_car,
    "seat rail": seat_rail,
    "parallel gripper": parallel_gripper,
    "scissor lift": scissor_lift,
    "robot arm": robot_arm,
    "paper feeder": paper_feeder,
}
