"""Twelve everyday machines with tolerances: engines, gears, brakes, cranes, presses, buffers and testers.

Each is a function of a random generator. Without one it is the machine of the drawing, else a random neighbour of it.
"""

from collections.abc import Callable

import casadi as ca
import numpy as np
from _machines_a import Variation

import symmb as mb

G = 9.81
"""Gravity [m/s^2]."""


def valve_train(rng: np.random.Generator | None) -> mb.Scene:
    """A cam opens a valve by a push rod and a rocker; near the nose the rod lifts off, and the valve hits its seat."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("lift", "short", "long"),
        mass=0.13,  # of the valve with its plate [kg]
        spring=32e3,
        preload=260.0,
        rod=9e6,  # stiffness of the push rod and its contacts [N/m]
        seat=3e7,
        rpm=2900.0,  # of the camshaft
        lift=6.0e-3,
        lash=0.25e-3,
        short=0.030,  # arms of the rocker [m]
        long=0.045,
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    rocker, valve = mb.Body("rocker", 0.12, 4e-5, mb.Planar()), mb.Body("valve", p.mass, 1e-5, mb.Planar())
    guide = mb.Prismatic("guide", ground.point(p.long, 0), valve.point(0, 0), axis=(0, 1, 0))
    turned = (p.rpm * np.pi / 30 * mb.t - 0.5) / 2.4  # share of the cam's flank that has passed
    cam = ca.if_else(ca.logic_and(turned > 0, turned < 1), p.lift * 64 * (turned * (1 - turned)) ** 3, 0)
    rod = ground.point(-p.short, cam - p.lash)
    system = mb.System(
        rocker,
        valve,
        guide,
        mb.Revolute("shaft", ground.point(0, 0), rocker.point(0, 0)),
        mb.PointOnLine("tip", valve.point(0, 0), rocker.point(p.long, 0), axis=(1, 0, 0)),
        mb.Contact("rod", rocker.point(-p.short, 0), rod, (0, 1), mb.KelvinVoigt(p.rod, 150.0)),
        mb.Stop("seat", guide, None, 0.0, mb.KelvinVoigt(p.seat, 600.0)),
        mb.Force("spring", valve.point(0, 0), (0, p.preload - p.spring * valve.y)),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"guide.displacement": p.preload / p.seat},
        times=np.linspace(0.0, 0.016, 161),
        outputs={
            "lift": -1e3 * valve.y,
            "rod force": system.force("rod"),
            "jump": mb.maximum(1e3 * (-valve.y / p.long - (cam - p.lash) / p.short) * p.short),
            "closing speed": mb.maximum(valve.vy),
        },
        box=vary.box(
            values, mass=2e-3, spring=1.6e3, preload=20.0, rod=0.9e6, rpm=60.0, lift=0.05e-3, lash=0.05e-3, long=0.1e-3
        ),
        name="valve train",
    )


def gear_train(rng: np.random.Generator | None) -> mb.Scene:
    """A DC motor reverses at 0.35 s and turns a wheel by two pairs of gears, whose teeth cross their backlash."""
    vary = Variation(rng)
    values = vary.values(
        voltage=24.0,
        resistance=0.8,
        constant=0.05,  # of the motor [N m/A]
        stiffness=6e5,  # of a pair of teeth [N/m]
        fast=0.15e-3,  # backlash of the first pair [m]
        slow=0.25e-3,
        inertia=0.02,  # of the wheel [kg m^2]
        drag=1.2,  # of the load [N m]
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    pinion, idler = mb.Body("pinion", 0.3, 2e-4), mb.Body("idler", 1.0, 1e-3)
    wheel = mb.Body("wheel", 6.0, p.inertia)
    shafts = [
        mb.Revolute(f"{body.name}_shaft", ground.point(x, 0), body.point(0, 0))
        for body, x in ((pinion, 0.0), (idler, 0.06), (wheel, 0.135))
    ]
    law = mb.KelvinVoigt(p.stiffness, 150.0)
    forces, torques = [], []
    for (a, b), (radius_a, radius_b), play in (
        (shafts[:2], (0.015, 0.045), p.fast),
        (shafts[1:], (0.015, 0.060), p.slow),
    ):
        way = radius_a * a.angle + radius_b * b.angle
        rate = radius_a * a.angle_rate + radius_b * b.angle_rate
        forces.append(law.force(way - play / 2, rate) - law.force(-way - play / 2, -rate))
        torques += [
            mb.Actuator(f"{a.name}_drives", a, -radius_a * forces[-1]),
            mb.Actuator(f"{b.name}_driven", b, -radius_b * forces[-1]),
        ]
    voltage = ca.if_else(mb.t < 0.35, p.voltage, -p.voltage)
    motor = mb.Motor("motor", shafts[0], voltage, p.resistance, p.constant)
    load = mb.Actuator("load", shafts[2], -p.drag * ca.tanh(wheel.omega / 0.5) - 0.02 * wheel.omega)
    return mb.Scene(
        mb.System(pinion, idler, wheel, *shafts, *torques, motor, load, parameters=p),
        times=np.linspace(0.0, 0.8, 161),
        outputs={
            "wheel": wheel.omega,
            "current": motor.current,
            "tooth force": mb.maximum(ca.fabs(forces[1])),
            "reversal": mb.first_time(wheel.omega < 0, window=(0.35, None)),
        },
        box=vary.box(
            values, voltage=0.5, constant=2e-3, stiffness=5e4, fast=0.05e-3, slow=0.08e-3, inertia=6e-4, drag=0.24
        ),
        name="gear train",
    )


def drum_brake(rng: np.random.Generator | None) -> mb.Scene:
    """A drum brake with a leading and a trailing shoe stops a winch, and sticks while its shaft goes on to twist."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("radius", "lever", "arm"),
        friction=0.35,
        push=3200.0,  # at the end of a shoe [N]
        fill=0.12,  # time in which the push grows [s]
        radius=0.150,
        lever=0.240,  # from a shoe's pivot to the push [m]
        arm=0.120,  # from a shoe's pivot to the middle of its lining [m]
        drum=4.0,  # inertias [kg m^2]
        winch=8.0,
        shaft=18e3,  # stiffness [N m/rad]
        load=70.0,  # that drives the winch [N m]
        speed=30.0,
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    drum, winch = mb.Body("drum", 40.0, p.drum), mb.Body("winch", 120.0, p.winch)
    servo = 0.1 * p.friction  # by friction at 0.1 m from the pivots, which pulls one shoe in and pushes one off
    shoes = p.friction * p.lever * (1 / (p.arm - servo) + 1 / (p.arm + servo))
    brake = mb.Clutch("brake", ground, drum, p.push * ca.fmin(mb.t / p.fill, 1) * p.radius * shoes, static_ratio=1.15)
    shaft = mb.TorsionSpring("shaft", drum, winch, p.shaft, damping=40.0)
    system = mb.System(
        drum,
        winch,
        mb.Revolute("drum_bearing", ground.point(0, 0), drum.point(0, 0)),
        mb.Revolute("winch_bearing", ground.point(0, 0), winch.point(0, 0)),
        brake,
        shaft,
        mb.Torque("load", winch, p.load),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"drum.omega": p.speed, "winch.omega": p.speed},
        times=np.linspace(0.0, 3.0, 151),
        outputs={
            "speed": winch.omega,
            "shaft": p.shaft * (drum.theta - winch.theta),
            "stop": mb.first_time(brake.closed > 0.5),
            "turned": mb.final(drum.theta / (2 * np.pi)),
        },
        box=vary.box(
            values,
            friction=0.035,
            push=160.0,
            fill=0.01,
            radius=0.2e-3,
            lever=0.5e-3,
            arm=0.5e-3,
            winch=0.2,
            shaft=900.0,
            load=4.0,
            speed=0.6,
        ),
        name="drum brake",
    )


def crane(rng: np.random.Generator | None) -> mb.Scene:
    """A trolley carries a load on hook and sling; its drive gathers and loses speed evenly: smooth but for kinks."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("rope", "sling"),
        rope=7.0,
        sling=1.8,
        hook=250.0,
        load=3500.0,
        speed=0.9,
        acceleration=0.35,
        drag=60.0,  # of the air on the load [N s/m]
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    trolley, hook, load = (
        mb.Body(name, mass, inertia)
        for name, mass, inertia in (("trolley", 1200.0, 300.0), ("hook", p.hook, 8.0), ("load", p.load, 900.0))
    )
    rail = mb.Prismatic("rail", ground.point(0, 0), trolley.point(0, 0), axis=(1, 0, 0))
    rope = mb.Revolute("rope", trolley.point(0, 0), hook.point(0, p.rope))
    sling = mb.Revolute("sling", hook.point(0, 0), load.point(0, p.sling))
    ramp, brakes = p.speed / p.acceleration, 8.0  # duration of a ramp, and when the second one begins [s]
    way = [ca.fmax(mb.t - kink, 0) ** 2 for kink in (ramp, brakes, brakes + ramp)]
    system = mb.System(
        trolley,
        hook,
        load,
        rail,
        rope,
        sling,
        mb.Motion("drive", rail.displacement, p.acceleration / 2 * (mb.t**2 - way[0] - way[1] + way[2])),
        mb.Force("air", load.point(0, 0), (-p.drag * load.vx, 0)),
        mb.Gravity(0, -G),
        parameters=p,
    )
    pull = system.reaction("rope")
    return mb.Scene(
        system,
        times=np.linspace(0.0, 18.0, 181),
        outputs={
            "load": load.x,
            "sway": load.x - trolley.x,
            "pull": 1e-3 * ca.sqrt(pull.fx**2 + pull.fy**2),
            "swing": mb.maximum(ca.fabs(load.x - trolley.x), window=(13.0, None)),
        },
        box=vary.box(values, rope=0.02, sling=0.01, hook=5.0, load=100.0, speed=0.02, acceleration=0.015, drag=12.0),
        name="crane",
    )


def compressor(rng: np.random.Generator | None) -> mb.Scene:
    """A slider-crank compresses air; its suction and delivery valves open and close by themselves in every turn."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("crank", "rod", "bore"),
        crank=0.040,
        rod=0.145,
        bore=0.070,
        gap=2.5e-3,  # between piston and head at the top [m]
        piston=0.45,
        flywheel=0.25,
        speed=152.0,  # of the motor without load [rad/s]
        slope=6.0,  # torque over slip of the motor [N m s/rad]
        exponent=1.3,
        delivery=6.0,  # [bar]
        inlet=1.0e-6,  # flow of the suction valve over its pressure [m^3/(s Pa)]
        outlet=4.0e-7,
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    crank, rod = mb.Body("crank", 6.0, p.flywheel), mb.Body("rod", 0.6, 1.6e-3)
    piston = mb.Body("piston", p.piston, 1e-3)
    area = np.pi / 4 * p.bore**2
    volume = area * (p.crank + p.rod + p.gap - piston.x)

    def rate(pressure: ca.SX) -> ca.SX:
        """By polytropic compression, and by the flow through the valves, which is positive into the cylinder."""
        flow = p.inlet * ca.fmax(1.0 - pressure, 0) - p.outlet * pressure * ca.fmax(pressure - p.delivery, 0)
        return p.exponent * (1e5 * flow + pressure * area * piston.vx) / volume

    pressure = mb.State("pressure", rate)
    system = mb.System(
        crank,
        rod,
        piston,
        pressure,
        mb.Revolute("main", ground.point(0, 0), crank.point(0, 0)),
        mb.Revolute("pin", crank.point(p.crank, 0), rod.point(-p.rod / 2, 0)),
        mb.Revolute("wrist", rod.point(p.rod / 2, 0), piston.point(0, 0)),
        mb.Prismatic("cylinder", ground.point(0, 0), piston.point(0, 0), axis=(1, 0, 0)),
        mb.Torque("motor", crank, p.slope * (p.speed - crank.omega)),
        mb.Force("gas", piston.point(0, 0), (-1e5 * (pressure.value - 1.0) * area, 0)),
        parameters=p,
    )
    sine = p.crank / p.rod * np.sin(0.3)
    return mb.Scene(
        system,
        start={"crank.theta": 0.3, "crank.omega": 0.97 * p.speed, "pressure": 1.0},
        guess={
            "rod.theta": -ca.arcsin(sine),
            "rod.x": p.crank * np.cos(0.3) + p.rod / 2,
            "piston.x": p.crank * np.cos(0.3) + p.rod * ca.sqrt(1 - sine**2),
        },
        times=np.linspace(0.0, 0.085, 171),
        outputs={
            "pressure": pressure.value,
            "speed": crank.omega,
            "pin force": system.reaction("pin").fx,
            "peak": mb.maximum(pressure.value),
        },
        box=vary.box(
            values,
            crank=0.05e-3,
            rod=0.05e-3,
            bore=0.02e-3,
            gap=0.15e-3,
            piston=5e-3,
            speed=3.0,
            exponent=0.03,
            delivery=0.2,
            inlet=1e-7,
            outlet=4e-8,
        ),
        name="compressor",
    )


def belt_tensioner(rng: np.random.Generator | None) -> mb.Scene:
    """A belt drives an alternator from a shaft with ripple, and a spring arm keeps its slack span taut: smooth."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("arm",),
        belt=1.5e5,  # stiffness of a span [N/m]
        spring=40.0,  # of the arm [N m/rad]
        preload=12.0,  # of the arm [N m]
        damping=1.2,  # of the arm [N m s/rad]
        arm=0.085,
        rotor=3e-3,
        torque=5.0,  # of the alternator [N m]
        speed=95.0,
        ripple=0.02,  # of the shaft's angle, twice a turn [rad]
    )
    p = mb.Parameters(**values)
    radius, small, level = 0.08, 0.03, 0.069  # of the pulleys, and of the idler at rest [m]
    ground = mb.Ground()
    arm, rotor = mb.Body("arm", 0.6, 1.2e-3), mb.Body("rotor", 2.0, p.rotor)
    pivot = mb.Revolute("pivot", ground.point(0.1, level + 0.061), arm.point(-p.arm / 2, 0))
    bearing = mb.Revolute("bearing", ground.point(0.3, 0.1), rotor.point(0, 0))
    idler = arm.point(p.arm / 2, 0)
    spans = [ca.vertcat(x - idler.x, y - idler.y) for x, y in ((0.0, 0.08), (0.3, 0.13))]
    lengths = [ca.norm_2(span) for span in spans]
    rest = 0.1 + p.arm * np.cos(0.8), level + 0.061 - p.arm * np.sin(0.8)
    free = sum(ca.sqrt((x - rest[0]) ** 2 + (y - rest[1]) ** 2) for x, y in ((0.0, 0.08), (0.3, 0.13)))
    shaft = p.speed * mb.t + p.ripple * (1 - ca.exp(-mb.t / 0.04)) * ca.sin(2 * p.speed * mb.t)
    fed = radius * shaft - small * bearing.angle  # into the slack span [m]
    rates = radius * mb.ddt(shaft) - small * rotor.omega
    slack = 350.0 + p.belt * (sum(lengths) - free - fed) + 60.0 * (mb.ddt(sum(lengths)) - rates)
    tight = 350.0 + p.torque / small + p.belt * fed + 60.0 * rates
    along = sum(span / length for span, length in zip(spans, lengths, strict=True))
    system = mb.System(
        arm,
        rotor,
        pivot,
        bearing,
        mb.Force("belt", idler, (slack * along[0], slack * along[1])),
        mb.Torque("pulley", rotor, small * (tight - slack)),
        mb.Torque("alternator", rotor, -p.torque * rotor.omega / (radius / small * p.speed)),
        mb.Actuator("spring", pivot, -p.preload - p.spring * (pivot.angle + 0.8) - p.damping * pivot.angle_rate),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"pivot.angle": -0.8, "bearing.angle": 0.0, "rotor.omega": radius / small * p.speed},
        times=np.linspace(0.0, 0.3, 201),
        outputs={"arm": pivot.angle, "slack span": slack, "alternator": rotor.omega, "tight span": mb.maximum(tight)},
        box=vary.box(
            values,
            belt=1e4,
            spring=2.0,
            preload=1.2,
            damping=0.2,
            arm=0.2e-3,
            rotor=6e-5,
            torque=0.25,
            speed=2.0,
            ripple=1.5e-3,
        ),
        name="belt tensioner",
    )


def crank_press(rng: np.random.Generator | None) -> mb.Scene:
    """A press blanks a sheet, which breaks suddenly; the clutch of its flywheel slips where the force is high."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("crank", "rod"),
        crank=0.060,
        rod=0.420,
        sheet=6.0e-3,
        blanking=350e3,  # largest force [N]
        breaks=0.35,  # share of the sheet at which it breaks
        capacity=5.9e3,  # of the clutch [N m]
        flywheel=26.0,
        speed=13.0,
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    wheel, crank = mb.Body("flywheel", 700.0, p.flywheel), mb.Body("crank", 80.0, 4.0)
    rod, ram = mb.Body("rod", 40.0, 0.6), mb.Body("ram", 220.0, 2.0)
    shaft = mb.Revolute("shaft", ground.point(0, 0), crank.point(0, 0))  # its angle counts from the top
    clutch = mb.Clutch("clutch", wheel, crank, p.capacity, static_ratio=1.1)
    way = (p.sheet - 0.5e-3 - p.crank - p.rod - ram.y) / p.sheet  # share of the sheet behind the punch
    cuts = ca.logic_and(ca.logic_and(way > 0, way < p.breaks), shaft.angle < np.pi)
    push = ca.if_else(cuts, p.blanking * ca.fmin(way / 0.1, 1) * (1 - way), 0)
    system = mb.System(
        wheel,
        crank,
        rod,
        ram,
        mb.Revolute("bearing", ground.point(0, 0), wheel.point(0, 0)),
        shaft,
        mb.Revolute("crank_pin", crank.point(0, p.crank), rod.point(0, p.rod / 2)),
        mb.Revolute("wrist_pin", rod.point(0, -p.rod / 2), ram.point(0, 0)),
        mb.Prismatic("guide", ground.point(0, 0), ram.point(0, 0), axis=(0, 1, 0)),
        clutch,
        mb.Torque("motor", wheel, 120.0 * (p.speed - wheel.omega)),
        mb.Force("blanking", ram.point(0, 0), (0, push)),
        mb.Gravity(0, -G),
        parameters=p,
    )
    angle = np.radians(110.0)
    lean = ca.arcsin(p.crank * np.sin(angle) / p.rod)
    return mb.Scene(
        system,
        start={"shaft.angle": angle, "shaft.angle_rate": p.speed, "flywheel.omega": p.speed},
        guess={"rod.theta": -lean, "ram.y": p.crank * np.cos(angle) - p.rod * ca.cos(lean)},
        times=np.linspace(0.0, 0.2, 161),
        outputs={
            "ram": 1e3 * ram.y,
            "crank": crank.omega,
            "slowest": mb.minimum(wheel.omega),
            "main bearing": mb.maximum(1e-3 * ca.fabs(system.reaction("shaft").fy)),
        },
        box=vary.box(
            values,
            crank=0.1e-3,
            rod=0.2e-3,
            sheet=0.2e-3,
            blanking=25e3,
            breaks=0.03,
            capacity=600.0,
            flywheel=0.5,
            speed=0.3,
        ),
        name="crank press",
    )


def elevator_buffer(rng: np.random.Generator | None) -> mb.Scene:
    """A car with a cabin on rubber falls onto a buffer whose second spring begins later, and rebounds."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("second",),
        car=750.0,
        cabin=450.0,
        height=0.50,
        friction=700.0,  # of the guide rails [N]
        first=120e3,  # stiffness of the springs [N/m]
        more=200e3,
        second=0.150,  # way to the second spring [m]
        oil=5e3,  # damping beside the first spring [N s/m]
        rubber=7e5,
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    car, cabin = mb.Body("car", p.car, 300.0), mb.Body("cabin", p.cabin, 200.0)
    rails = mb.Prismatic("rails", ground.point(0, 0), car.point(0, 0), axis=(0, 1, 0))
    mounts = mb.Prismatic("mounts", car.point(0, 0), cabin.point(0, 0), axis=(0, 1, 0))
    system = mb.System(
        car,
        cabin,
        rails,
        mounts,
        mb.Stop("buffer", rails, 0.0, None, mb.KelvinVoigt(p.first, p.oil)),
        mb.Stop("spring", rails, -p.second, None, mb.KelvinVoigt(p.more)),
        mb.Friction("shoes", ground.point(0, 0), car.point(0, 0), (0, 1, 0), p.friction, mb.Coulomb(1.0, 0.02)),
        mb.Actuator("rubber", mounts, -p.rubber * mounts.displacement - 3e3 * mounts.displacement_rate),
        mb.Gravity(0, -G),
        parameters=p,
    )
    felt = system.ddt(cabin.vy) / G
    return mb.Scene(
        system,
        start={"rails.displacement": p.height, "mounts.displacement": 0.0},
        times=np.linspace(0.0, 1.5, 151),
        outputs={
            "car": car.y,
            "felt": felt,
            "stroke": mb.maximum(-car.y),
            "buffer force": mb.maximum(1e-3 * (system.force("buffer") + system.force("spring"))),
        },
        box=vary.box(
            values,
            car=15.0,
            cabin=40.0,
            height=0.01,
            friction=140.0,
            first=8e3,
            more=14e3,
            second=1e-3,
            oil=500.0,
            rubber=5e4,
        ),
        name="elevator buffer",
    )


def impact_tester(rng: np.random.Generator | None) -> mb.Scene:
    """A Charpy hammer swings down, breaks a specimen within 2 ms, and rises to an angle that tells what this took."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("centre", "strike", "release"),
        mass=20.0,
        centre=0.70,  # from the axle to the centre of mass [m]
        strike=0.78,  # from the axle to the blow [m]
        release=2.6,  # angle [rad]
        bearing=0.15,  # friction [N m]
        peak=17e3,
        deflection=8.0e-3,  # of the specimen when it is broken [m]
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    hammer = mb.Body("hammer", p.mass, 0.025 * p.mass, com=(0, -p.centre))
    axle = mb.Revolute("axle", ground.point(0, 0), hammer.point(0, 0))
    shape = mb.Table([0.0, 0.08, 0.25, 0.5, 0.75, 1.0], [0.0, 0.75, 1.0, 0.7, 0.25, 0.0])
    bent = p.strike * axle.angle / p.deflection
    hits = ca.logic_and(ca.logic_and(bent > 0, bent < 1), axle.angle_rate > 0)
    push = ca.if_else(hits, p.peak * shape(bent), 0)
    blow = (-push * ca.cos(axle.angle), -push * ca.sin(axle.angle))
    system = mb.System(
        hammer,
        axle,
        mb.Force("blow", hammer.point(0, -p.strike), blow),
        mb.Actuator("bearing", axle, -p.bearing * ca.tanh(axle.angle_rate / 0.05)),
        mb.Gravity(0, -G),
        parameters=p,
    )
    energy = p.mass * (0.025 + p.centre**2) * axle.angle_rate**2 / 2
    return mb.Scene(
        system,
        start={"axle.angle": -p.release},
        times=np.linspace(0.0, 1.4, 141),
        outputs={
            "angle": axle.angle,
            "energy": energy,
            "rise": mb.maximum(180 / np.pi * axle.angle),
            "axle force": mb.maximum(ca.fabs(system.reaction("axle").fx)),
        },
        box=vary.box(
            values, mass=0.2, centre=0.5e-3, strike=0.5e-3, release=0.01, bearing=0.03, peak=1.2e3, deflection=0.4e-3
        ),
        name="impact tester",
    )


def wiper(rng: np.random.Generator | None) -> mb.Scene:
    """A crank at an even speed swings a wiper by a four-bar linkage whose four lengths are uncertain: smooth."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("crank", "coupler", "rocker", "base"),
        crank=0.045,
        coupler=0.320,
        rocker=0.065,
        base=0.325,
        blade=0.55,  # mass [kg]
        drag=1.5,  # of the blade on the glass [N m s/rad]
        speed=6.5,
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    crank, coupler = mb.Body("crank", 0.15, 4e-5), mb.Body("coupler", 0.35, 3e-3)
    arm = mb.Body("arm", p.blade, p.blade * 0.6**2 / 12, com=(0, 0.3))
    motor = mb.Revolute("motor", ground.point(0, 0), crank.point(0, 0))
    pivot = mb.Revolute("pivot", ground.point(p.base, 0), arm.point(0, 0))
    system = mb.System(
        crank,
        coupler,
        arm,
        motor,
        pivot,
        mb.Revolute("ball_a", crank.point(p.crank, 0), coupler.point(-p.coupler / 2, 0)),
        mb.Revolute("ball_b", coupler.point(p.coupler / 2, 0), arm.point(0, p.rocker)),
        mb.Motion("drive", motor.angle, p.speed * mb.t),
        mb.Actuator("glass", pivot, -p.drag * pivot.angle_rate),
        mb.Gravity(0, -G),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"motor.angle": 0.0},
        guess={"arm.theta": -0.6, "coupler.theta": 0.2, "coupler.x": 0.2, "coupler.y": 0.03},
        times=np.linspace(0.0, 1.5, 151),
        outputs={
            "wiper": 180 / np.pi * arm.theta,
            "rate": arm.omega,
            "torque": -system.lam("drive")[0],
            "reach": mb.maximum(180 / np.pi * arm.theta),
        },
        box=vary.box(
            values, crank=0.1e-3, coupler=0.3e-3, rocker=0.1e-3, base=0.3e-3, blade=0.015, drag=0.3, speed=0.2
        ),
        name="wiper",
    )


def vibrating_conveyor(rng: np.random.Generator | None) -> mb.Scene:
    """An unbalanced motor shakes a trough on leaf springs and runs up through its resonance: smooth and sensitive."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("rise",),
        trough=45.0,
        goods=12.0,
        spring=150e3,
        damping=260.0,
        unbalance=0.06,  # mass of the rotor times its distance from the axis [kg m]
        growth=30.0,  # of the motor's speed [rad/s^2]
        rise=0.5,  # angle of the motion against the horizontal [rad]
    )
    p = mb.Parameters(**values)
    ground = mb.Ground()
    trough = mb.Body("trough", p.trough + p.goods, 5.0)
    rotor = mb.Body("rotor", 2.0, 1e-3)
    springs = mb.Prismatic("springs", ground.point(0, 0), trough.point(0, 0), axis=(ca.cos(p.rise), ca.sin(p.rise), 0))
    shaft = mb.Revolute("shaft", trough.point(0, 0), rotor.point(-p.unbalance / 2.0, 0))
    system = mb.System(
        trough,
        rotor,
        springs,
        shaft,
        mb.Motion("motor", shaft.angle, p.growth * mb.t**2 / 2),
        mb.Actuator("leaves", springs, -p.spring * springs.displacement - p.damping * springs.displacement_rate),
        mb.Gravity(0, -G),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"springs.displacement": 0.0},
        times=np.linspace(0.0, 3.0, 201),
        outputs={
            "way": 1e3 * springs.displacement,
            "speed": springs.displacement_rate,
            "amplitude": mb.maximum(1e3 * springs.displacement),
            "torque": mb.maximum(-system.lam("motor")[0]),
        },
        box=vary.box(
            values, trough=0.5, goods=1.0, spring=7.5e3, damping=50.0, unbalance=1.5e-3, growth=0.9, rise=0.01
        ),
        name="vibrating conveyor",
    )


def landing_gear(rng: np.random.Generator | None) -> mb.Scene:
    """A leg with gas and oil, whose damping grows with the square of its speed, drops on its tyre and may rebound."""
    vary = Variation(rng)
    values = vary.values(
        geometry=("height",),
        mass=900.0,
        wheel=38.0,
        height=0.45,  # below the tyre [m]
        pressure=14e5,  # of the gas at full length [Pa]
        volume=1.15e-3,
        oil=9.0e3,  # [N s^2/m^2] on the way in; four times as much on the way out
        tyre=3.2e5,  # [N/m]
    )
    p = mb.Parameters(**values)
    area, full, radius = 3.2e-3, 0.9, 0.3  # of the piston [m^2], length of the leg, of the tyre [m]
    ground = mb.Ground()
    airframe, wheel = mb.Body("airframe", p.mass, 100.0), mb.Body("wheel", p.wheel, 1.5)
    tower = mb.Prismatic("tower", ground.point(0, 0), airframe.point(0, 0), axis=(0, 1, 0))
    leg = mb.Prismatic("leg", airframe.point(0, -full), wheel.point(0, 0), axis=(0, 1, 0))  # displaced by the stroke
    rate = leg.displacement_rate
    gas = p.pressure * area * (1 - area * leg.displacement / p.volume) ** -1.25
    oil = ca.if_else(rate > 0, p.oil, 4 * p.oil) * rate * ca.fabs(rate)
    tyre = mb.Contact(
        "tyre", wheel.point(0, 0), ground.point(0, 0), (0, 1), mb.KelvinVoigt(p.tyre, damping=800.0), radius=radius
    )
    system = mb.System(
        airframe,
        wheel,
        tower,
        leg,
        mb.Actuator("strut", leg, -gas - oil),
        mb.Stop("full", leg, 0.0, None, mb.KelvinVoigt(8e6, 8e3)),
        tyre,
        mb.Gravity(0, -G),
        parameters=p,
    )
    return mb.Scene(
        system,
        start={"tower.displacement": p.height + full + radius, "leg.displacement": -p.pressure * area / 8e6},
        times=np.linspace(0.0, 1.2, 201),
        outputs={
            "stroke": leg.displacement,
            "ground": 1e-3 * system.force("tyre"),
            "strut": mb.maximum(1e-3 * (gas + oil)),
            "longest stroke": mb.maximum(1e3 * leg.displacement),
        },
        box=vary.box(values, mass=18.0, wheel=0.5, height=0.01, pressure=0.7e5, volume=2e-5, oil=1.2e3, tyre=2e4),
        name="landing gear",
    )


MACHINES: dict[str, Callable[[np.random.Generator | None], mb.Scene]] = {
    "valve train": valve_train,
    "gear train": gear_train,
    "drum brake": drum_brake,
    "crane": crane,
    "compressor": compressor,
    "belt tensioner": belt_tensioner,
    "crank press": crank_press,
    "elevator buffer": elevator_buffer,
    "impact tester": impact_tester,
    "wiper": wiper,
    "vibrating conveyor": vibrating_conveyor,
    "landing gear": landing_gear,
}
