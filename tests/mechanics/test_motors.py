"""DC motors against closed forms: a wheel and a current are a linear system."""

import casadi as ca
import numpy as np
from faults import refused
from numpy.testing import assert_allclose
from scipy.linalg import expm

import symmb as mb

TIMES = np.linspace(0.0, 1.0, 11)
GROUND = mb.Ground()


def driven(voltage=12.0, R=2.0, k=0.5, L=0.0, *, more=(), **options):
    """A wheel of 0.1 kg m^2 on a motor."""
    wheel = mb.Body("wheel", 1.0, 0.1)
    shaft = mb.Revolute("shaft", GROUND.point(0, 0), wheel.point(0, 0))
    motor = mb.Motor("motor", shaft, voltage, R, k, L, **options)
    outputs = {"w": shaft.angle_rate, "i": motor.current, "power": motor.power, "torque": motor.torque}
    return mb.Scene(mb.System(wheel, shaft, motor, *more), {"wheel.omega": 3.0}, TIMES, outputs)


def test_a_wheel_and_a_current():
    scene = driven(L=0.3, gear=3.0, friction=0.02, emf_constant=0.45)
    scene = mb.Scene(scene.system, {"wheel.omega": 3.0, "motor.current": 1.0}, TIMES, scene.outputs)
    run = mb.simulate(scene, mb.DormandPrince())
    A = np.array([[-0.02 * 9 / 0.1, 3 * 0.5 / 0.1], [-0.45 * 3 / 0.3, -2.0 / 0.3]])
    rest = -np.linalg.solve(A, [0.0, 12.0 / 0.3])
    expected = np.array([rest + expm(A * t) @ ([3.0, 1.0] - rest) for t in TIMES])
    assert_allclose(np.column_stack([run["w"], run["i"]]), expected, atol=1e-8)
    assert_allclose(run["power"], 12 * expected[:, 1], atol=1e-6)
    assert_allclose(run["torque"], 3 * (0.5 * expected[:, 1] - 0.02 * 3 * expected[:, 0]), atol=1e-6)
    assert run.energy_drift < 1e-8


def test_without_inductance_the_current_follows_at_once():
    run = mb.simulate(driven(gear=2.0), mb.DormandPrince())
    rate = (2 * 0.5) ** 2 / 2 / 0.1
    w = 12.0 + (3.0 - 12.0) * np.exp(-rate * TIMES)  # idle speed V / (n k)
    assert_allclose(run["w"], w, atol=1e-8)
    assert_allclose(run["i"], (12 - w) / 2, atol=1e-8)
    assert "motor.current" not in run.state_names[2]


def test_a_linear_motor():
    cart = mb.Body("cart", 2.0, 1.0)
    rail = mb.Prismatic("rail", GROUND.point(0, 0), cart.point(0, 0), axis=(1, 0, 0))
    motor = mb.Motor("motor", rail, 10.0, 5.0, 4.0)
    run = mb.simulate(mb.Scene(mb.System(cart, rail, motor), times=TIMES), mb.DormandPrince())
    assert_allclose(run["cart.vx"], 2.5 * (1 - np.exp(-16 / 5 / 2 * TIMES)), atol=1e-8)


def test_a_brake_stalls_a_motor():
    """The stalled current is V / R. The brake of 6 N m holds its torque until it is weaker than 3 N m, at 0.5 s."""
    wheel = mb.Body("wheel", 1.0, 0.1)
    shaft = mb.Revolute("shaft", GROUND.point(0, 0), wheel.point(0, 0))
    motor = mb.Motor("motor", shaft, 12.0, 2.0, 0.5)
    brake = mb.Clutch("brake", GROUND, wheel, 6.0 - 6 * mb.t)
    run = mb.simulate(mb.Scene(mb.System(wheel, shaft, motor, brake), times=TIMES, outputs={"i": motor.current}))
    assert_allclose([event.time for event in run.events], 0.5, atol=1e-12)
    assert_allclose(run["i"][run.t <= 0.5], 6.0, atol=1e-12)
    # 0.1 w' = 3 - k^2 w / R - 6 (1 - t): w' = -1.25 w + 60 (t - 0.5)
    u = np.maximum(run.t - 0.5, 0)
    assert_allclose(run(wheel.omega), 60 / 1.25 * (u - (1 - np.exp(-1.25 * u)) / 1.25), atol=1e-9)


def test_its_torque_is_a_force_and_its_voltage_the_input():
    scene = driven()
    run = mb.simulate(scene)
    assert_allclose(run(scene.system.force("motor")), run["torque"], rtol=0, atol=0)
    refused(r"the input of Motor 'motor' is its voltage\. .*u\.value", mb.linearize, scene, inputs=["motor"])


def test_faults_are_told():
    for arguments, text in (
        ({"R": 0.0}, "resistance is 0; it must be above 0"),
        ({"L": -1.0}, "inductance is -1; it must be at least 0"),
        ({"friction": -1.0}, "friction is -1; it must be at least 0"),
        ({"voltage": ca.SX.sym("u")}, "voltage: symbol 'u' does not belong to a parameter"),
    ):
        refused(f"Motor 'motor': {text}", driven, **arguments)
