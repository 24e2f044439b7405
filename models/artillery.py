"""Towed gun of the 155-mm class while it fires: rigid carriage and trails on soil, flexible top carriage, cradle, barrel.

                                              _ . - ~ '[#]  muzzle brake
                          front bush  _ . - ~ ' barrel
           breech  _ . [=] - ~ ' [=] - ~ '
         [####] - ~ ' (o) - - - ~ '   cradle         y
            rear bush /|\\ trunnion                   |
                     / | \\ top carriage              +-- x
             \\      [#####]---- bottom carriage     /
               ` - .  |+|  rotating hinge           z
        trails      ` [___] base plate
      __V____________/////______________________________  soil
      spades

Fixed hinges (welds) hold base plate and trails to the bottom carriage; the rotating hinge is locked by a torsion spring
(traversing gear), the trunnion by one tooth of the toothed sector (elevating gear), which the muzzle's overweight that
the equilibrator leaves presses on one flank. The barrel lies in two bushes with clearance and recoils in them against
an absorber and a recuperator, whose gas holds it on a stop before the shot. The breech pressure is a given curve; the
muzzle brake pulls while the gases leave. Two eccentricities, of a rigid mass fixed to the breech, are uncertain.

Source: Wang and Yang, Nonlinear Dynamics (2021), section 5, for the topology and the targets; all values are our own,
generic ones of a gun of that size. Tuned were

    TODO
    PRESSURE, its scale                 largest breech pressure 366.56 MPa               366.56 MPa
    OPENING, the throttling ring        recoil length of 1001 to 1072 mm                 TODO
    BALANCE, the equilibrator's force   muzzle 0.01382 deg up at 14 ms, within 10 %      TODO
"""

import casadi as ca
import numpy as np

import symmb as mb

ELEVATION = np.radians(15.0)
TRUNNION = np.array([-0.4, 1.55, 0.0])
STEEL = mb.Material(E=2.1e11, nu=0.3, density=7850.0)
GRAVITY = 9.81

# Along the bore, from the trunnion [m]
BREECH, REAR, FRONT, MUZZLE = -1.2, -0.5, 2.3, 5.8
BORE = np.pi / 4 * 0.155**2  # [m^2]
BREECH_MASS, BRAKE_MASS, RECOILING_MASS = 900.0, 120.0, 500.0

EXIT = 13e-3  # of the projectile [s]
PRESSURE = mb.Table(
    1e-3 * np.array([0, 1, 2, 3, 4, 5, 5.6, 6.5, 7.5, 9, 11, 13, 15, 18, 22, 30, 40]),
    366.56e6 * np.array([0, 0.02, 0.09, 0.27, 0.62, 0.94, 1, 0.92, 0.75, 0.53, 0.34, 0.22, 0.12, 0.05, 0.02, 0.003, 0]),
)
BRAKE = mb.Table([EXIT, EXIT + 1e-3, 0.04], [0.0, 1.6, 1.6])
"""Pull of the muzzle brake by the breech force."""

# Of the absorber, by the stroke [m], [m^2]
OPENING = mb.Table(
    [0.0, 0.1, 0.3, 0.5, 0.7, 0.85, 0.95, 1.05],
    1e-4 * np.array([5.7, 5.5, 4.9, 4.2, 3.3, 2.4, 1.6, 0.9]),
)
RETURN = mb.Table([0.0, 0.1, 0.25, 0.5], 1e-4 * np.array([0.35, 0.9, 1.6, 1.9]))

BALANCE, PISTON, ROD = 24e3, (0.1, 0.9), (0.8, -0.25)  # of the equilibrator [N], [m]
HUNG = -0.03  # height of the rigid mass above the bore [m]
RODS = -0.295  # height of the rods of absorber and recuperator above the bore [m]
CLEARANCE, BACKLASH = 1e-4, 1e-4  # of the bushes, radial, and from flank to flank [m]


def barrel_modes(count: int) -> mb.Modes:
    """Tube of tapering wall with breech and muzzle brake, in the axes of the bore from the trunnion."""
    corners, radii = [BREECH, REAR, 0.6, FRONT, MUZZLE], [0.16, 0.155, 0.15, 0.13, 0.10]
    tube = mb.Beam([(x, 0, 0) for x in corners], [mb.Section.circle(r, 0.0775) for r in radii], STEEL, elements=6)
    mesh = mb.FiniteElements.beams(tube)
    mesh = mesh.with_mass(mesh.nearest(BREECH, 0), BREECH_MASS, (40.0, 30.0, 30.0))
    mesh = mesh.with_mass(mesh.nearest(MUZZLE, 0), BRAKE_MASS, (2.0, 4.0, 4.0))
    return mesh.modes(count=count, damping=0.01)


def cradle_modes(count: int) -> mb.Modes:
    """Box girder below the barrel, with risers to the bushes and the trunnion and the arm of the toothed sector."""
    box = mb.Section(area=0.024, Iy=4.0e-4, Iz=3.5e-4, J=4.0e-4)
    riser = mb.Section.rectangle(0.25, 0.20).without_shear()
    girder = mb.Beam([(x, -0.25, 0) for x in (REAR, 0.0, 1.0, FRONT)], box, STEEL, elements=4)
    risers = [mb.Beam([(x, -0.25, 0), (x, 0, 0)], riser, STEEL, elements=1) for x in (REAR, 0.0, FRONT)]
    sector = mb.Beam([(0, -0.25, 0), (0, -SECTOR, 0)], riser, STEEL, elements=1)
    return mb.FiniteElements.beams(girder, *risers, sector).modes(count=count, damping=0.02)


SECTOR = 0.55  # radius of the toothed sector [m]


def tilted(x: float, y: float, elevation: float = ELEVATION) -> np.ndarray:
    """World position (3,) of a place in the axes of the bore from the trunnion."""
    c, s = np.cos(elevation), np.sin(elevation)
    return TRUNNION + np.array([c * x - s * y, s * x + c * y, 0.0])


def carriage_modes(count: int) -> mb.Modes:
    """Portal of two cheeks that carry the trunnion, and the seat of the elevating gear's pinion, in world axes."""
    cheek = mb.Section.rectangle(0.10, 0.30)
    seat, foot = tuple(tilted(0, -SECTOR)), (0.0, 0.85, 0.0)
    top = TRUNNION[:2]
    corners = [(0, 0.85, -0.4), (*top, -0.4), (*top, 0), (*top, 0.4), (0, 0.85, 0.4)]
    beams = [
        mb.Beam([(0, 0.75, 0), foot], mb.Section.rectangle(0.5, 0.5), STEEL, elements=1),
        mb.Beam([(0, 0.85, -0.4), foot, (0, 0.85, 0.4)], mb.Section.rectangle(0.20, 0.35), STEEL, elements=3),
        mb.Beam(corners, cheek, STEEL, elements=3),
        mb.Beam([foot, seat], mb.Section.rectangle(0.2, 0.2), STEEL, elements=2),
    ]
    return mb.FiniteElements.beams(*beams).modes(count=count, damping=0.02)


def scene(*, modes: int = 20, end: float = 0.014) -> mb.Scene:
    """One shot out of static equilibrium.

    Parameters
    ----------
    modes : int        of the three flexible parts in all, seven tenths of them in the barrel
    end : float        [s], 14 ms for the muzzle's vibration, 0.9 s for the whole recoil cycle
    """
    p = mb.Parameters(e_y=0.0, e_z=0.0)
    rest = 3 * modes // 10
    ground = mb.Ground()
    # Points of rigid parts are those of the gun before the shot, in world axes.
    bottom = mb.Body("bottom", 1500.0, (300.0, 350.0, 300.0), mb.Spatial(), com=(0.0, 0.55, 0.0))
    plate = mb.Body("plate", 400.0, (30.0, 60.0, 30.0), mb.Spatial(), com=(0.0, 0.1, 0.0))
    left, right = (
        mb.Body(f"{side}_trail", 900.0, (150.0, 1450.0, 1400.0), mb.Spatial(), com=(-2.5, 0.35, z))
        for side, z in (("left", -1.1), ("right", 1.1))
    )
    carriage = mb.FlexibleBody("carriage", carriage_modes(rest // 2))
    cradle = mb.FlexibleBody("cradle", cradle_modes(rest - rest // 2))
    barrel = mb.FlexibleBody("barrel", barrel_modes(modes - rest))
    load = mb.Body("load", RECOILING_MASS, (20.0, 40.0, 40.0), mb.Spatial(), com=(BREECH + 0.2, HUNG + p.e_y, p.e_z))

    breech, muzzle = barrel.point(BREECH, 0), barrel.point(MUZZLE, 0)
    bore, gas = breech.body.rotation[:, 0], BORE * PRESSURE(mb.t)
    lug = cradle.point(REAR, 0)
    bush = mb.HuntCrossley(2e11, restitution=0.8, speed=0.1)
    stroke = -(lug.body.rotation.T @ (barrel.point(REAR, 0).r - lug.r))[0]
    absorber = mb.Orifice(8e-3, lambda x, v: ca.if_else(v > 0, OPENING(x), RETURN(x)), length=1.0 - BREECH)
    recuperator = mb.GasSpring(5e6, 0.0215, -8e-3, length=1.0 - BREECH)
    equilibrator = mb.GasSpring(BALANCE / 5e-3, 5e-3, 5e-3, length=np.linalg.norm(tilted(*ROD) - [*PISTON, 0]))
    soil = {"stiffness": (2e7, 0, 2e7), "damping": (2e5, 0, 2e5)}
    elements = [
        mb.Weld("plate_bolts", bottom.point(0, 0.2), plate.point(0, 0.2)),
        mb.Weld("left_hinge", bottom.point(-0.4, 0.5, -0.4), left.point(-0.4, 0.5, -0.4)),
        mb.Weld("right_hinge", bottom.point(-0.4, 0.5, 0.4), right.point(-0.4, 0.5, 0.4)),
        mb.Revolute("rotating_hinge", bottom.point(0, 0.75), carriage.point(0, 0.75), axis=(0, 1, 0)),
        mb.TorsionSpring("traversing_gear", bottom, carriage.point(0, 0.75).body, 5e7, 1e5, axis=(0, 1, 0)),
        mb.Revolute("trunnion", carriage.point(*TRUNNION), cradle.point(0, 0), axis=(0, 0, 1)),
        mb.ToothContact(
            "elevating_gear",
            carriage.point(*tilted(0, -SECTOR)),
            cradle.point(0, -SECTOR),
            (np.cos(ELEVATION), np.sin(ELEVATION), 0),
            BACKLASH,
            mb.HuntCrossley(1e11, restitution=0.7, speed=0.1),
        ),
        mb.NonlinearSpring("equilibrator", carriage.point(*PISTON), cradle.point(*ROD), equilibrator),
        mb.BushContact("rear_bush", barrel.point(REAR, 0), cradle.point(REAR, 0), (1, 0, 0), CLEARANCE, bush),
        mb.BushContact("front_bush", barrel.point(FRONT, 0), cradle.point(FRONT, 0), (1, 0, 0), CLEARANCE, bush),
        mb.Bushing("key", lug, barrel.point(REAR, 0), 0.0, 0.0, (1e7, 0, 0), (1e4, 0, 0)),
        mb.NonlinearSpring("absorber", cradle.point(1.0, RODS), barrel.point(BREECH, RODS), absorber),
        mb.NonlinearSpring("recuperator", cradle.point(1.0, RODS), barrel.point(BREECH, RODS), recuperator),
        mb.Contact(
            "stop", barrel.point(REAR, 0), lug, (-1, 0, 0), mb.HuntCrossley(1e10, restitution=0.3, speed=0.5)
        ),
        mb.Weld("lugs", breech, load.point(BREECH, 0)),
        mb.Soil("soil_plate", ground.point(0, 0), plate.point(0, 0), (0, 1, 0), mb.KelvinVoigt(8e7, 4e5),
                **soil, rotational_stiffness=(5e6, 5e6, 5e6), rotational_damping=(5e4, 5e4, 5e4)),
        mb.Soil("soil_left", ground.point(-4.5, 0, -1.8), left.point(-4.5, 0, -1.8), (0, 1, 0), mb.KelvinVoigt(4e7, 2e5), **soil),
        mb.Soil("soil_right", ground.point(-4.5, 0, 1.8), right.point(-4.5, 0, 1.8), (0, 1, 0), mb.KelvinVoigt(4e7, 2e5), **soil),
        mb.Force("shot", breech, tuple(ca.vertsplit(-gas * bore))),
        mb.Force("muzzle_brake", muzzle, tuple(ca.vertsplit(gas * BRAKE(mb.t) * muzzle.body.rotation[:, 0]))),
        mb.Gravity(0, -GRAVITY),
    ]
    system = mb.System(bottom, plate, left, right, carriage, cradle, barrel, load, *elements, parameters=p)

    # What touches in equilibrium has to do so in the guess: the gun is a little lower, and its muzzle, than it is drawn.
    aimed = ELEVATION - 0.7 * BACKLASH / SECTOR
    guess = {}
    for body, place in (
        *((part, np.array(part.com)) for part in (bottom, plate, left, right)),
        (carriage, carriage.modes.origin),
        (cradle, tilted(*cradle.modes.origin[:2], aimed)),
        (barrel, tilted(barrel.modes.origin[0] + 3e-4, -1.3 * CLEARANCE, aimed)),
        (load, tilted(BREECH + 0.2 + 3e-4, HUNG - 1.3 * CLEARANCE, aimed)),
    ):
        guess |= {f"{body.name}.{axis}": float(x) for axis, x in zip("xyz", place - [0, 1e-3, 0], strict=True)}
    turned = mb.rotation(axis=(0, 0, 1), angle=aimed)
    guess |= {f"{part.name}.rotation": turned for part in (cradle, barrel, load)}
    aim = muzzle.body.rotation[:, 0]
    vertical, horizontal = ca.asin(aim[1]), ca.atan2(-aim[2], aim[0])
    displacements = {
        "recoil": stroke,
        "D_Y": bottom.y,
        "Omega_t": ca.asin(bottom.rotation[1, 0]),
        "muzzle_vertical": vertical,
        "muzzle_horizontal": horizontal,
    }
    return mb.Scene(
        system,
        guess=guess,
        times=np.linspace(0.0, end, 141 if end < 0.1 else 451),
        outputs={
            **{name: x - mb.initial(x) for name, x in displacements.items()},
            "recoil_velocity": mb.ddt(stroke),
            "muzzle_vertical_velocity": mb.ddt(vertical),
            "muzzle_horizontal_velocity": mb.ddt(horizontal),
            "muzzle_x": muzzle.x,
            "muzzle_y": muzzle.y,
            "muzzle_z": muzzle.z,
        },
        box=mb.Box(e_y=(-5e-3, 5e-3), e_z=(-3e-3, 3e-3)),
        equilibrium=True,
        name="artillery",
    )
