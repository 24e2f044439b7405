"""Andrews' squeezing mechanism: seven planar bodies, three loops through F, a constant driving torque, no gravity.

        B o                                 o C
          | ` .         spring        . '
          | K3  ` o D ' ' ' ' ' ' ' '
        E |
        o | K4       K2          K1
    K5/ ` o------------------o P---o O  <- torque
     /  . F
    o A' K6
     ` o H          F: three loops meet
     K7

    K1 O-P, K2 P-F, K3 B-F with the spring's point D, K4 E-F on K5 A-E, K6 H-F on K7 A-H; O, A, B, C on the ground

The seven angles of the benchmark are relative: theta_K2 = beta + Theta, theta_K4 = Phi + delta,
theta_K6 = Omega + epsilon. The motion is fast: the crank turns 2.5 times in 0.03 s.

Source: Test Set for IVP Solvers, Andrews' squeezing mechanism; IFToMM benchmark A03; Schiehlen (1990), Multibody
Systems Handbook; Hairer and Wanner (1996), Solving Ordinary Differential Equations II, section VII.7.
"""

import casadi as ca
import numpy as np

import symmb as mb


def scene() -> mb.Scene:
    """The mechanism over 0.03 s. Outputs are the benchmark's seven angles, their rates and six multipliers."""
    # fmt: off
    p = mb.Parameters(
        m1=0.04325, m2=0.00365, m3=0.02373, m4=0.00706, m5=0.07050, m6=0.00706, m7=0.05498,     # masses [kg]
        i1=2.194e-6, i2=4.410e-7, i3=5.255e-6, i4=5.667e-7, i5=1.169e-5, i6=5.667e-7, i7=1.912e-5,   # [kg m^2]
        xa=-0.06934, ya=-0.00227, xb=-0.03635, yb=0.03273, xc=0.014, yc=0.072,                  # A, B, C [m]
        d=0.028, da=0.0115, e=0.02, ea=0.01421, rr=0.007, ra=0.00092, ss=0.035, sa=0.01874, sb=0.01043,
        sc=0.018, sd=0.02, ta=0.02308, tb=0.00916, u=0.04, ua=0.01228, ub=0.00449, zf=0.02, zt=0.04, fa=0.01421,
        l0=0.07785, c0=4530.0, mom=0.033,                                     # spring [m], [N/m], torque [N m]
    )
    # fmt: on
    ground = mb.Ground()
    # Points of a body are measured from the joint that carries the body; `com` is the position of its mass centre.
    k1 = mb.Body("K1", mass=p.m1, inertia=p.i1, com=(p.ra, 0))
    k2 = mb.Body("K2", mass=p.m2, inertia=p.i2, com=(-p.da, 0))
    k3 = mb.Body("K3", mass=p.m3, inertia=p.i3, com=(p.sb, -p.sa))
    k4 = mb.Body("K4", mass=p.m4, inertia=p.i4, com=(0, p.ea - p.e))
    k5 = mb.Body("K5", mass=p.m5, inertia=p.i5, com=(p.ta, p.tb))
    k6 = mb.Body("K6", mass=p.m6, inertia=p.i6, com=(p.zf - p.fa, 0))
    k7 = mb.Body("K7", mass=p.m7, inertia=p.i7, com=(p.ub, -p.ua))
    a, b, f = ground.point(p.xa, p.ya), ground.point(p.xb, p.yb), k2.point(-p.d, 0)
    system = mb.System(
        k1,
        k2,
        k3,
        k4,
        k5,
        k6,
        k7,
        mb.Revolute("O", ground.point(0, 0), k1.point(0, 0)),
        mb.Revolute("P", k1.point(p.rr, 0), k2.point(0, 0)),
        mb.Revolute("B", b, k3.point(0, 0)),
        mb.Revolute("A5", a, k5.point(0, 0)),
        mb.Revolute("E", k5.point(p.zt, 0), k4.point(0, 0)),
        mb.Revolute("A7", a, k7.point(0, 0)),
        mb.Revolute("H", k7.point(0, -p.u), k6.point(0, 0)),
        mb.Revolute("F3", k3.point(0, -p.ss), f),
        mb.Revolute("F4", k4.point(0, -p.e), f),
        mb.Revolute("F6", k6.point(p.zf, 0), f),
        mb.Spring("spring", ground.point(p.xc, p.yc), k3.point(p.sd, -p.sc), p.c0, p.l0),
        mb.Torque("drive", k1, p.mom),
        parameters=p,
    )
    lam = ca.vertcat(*[system.lam(name) for name in ("F3", "F4", "F6")])
    beta = -0.0617138900142764496358948458001  # with this value Theta = 0 to all digits
    return mb.Scene(
        system,
        start={"K1.theta": beta},
        guess={
            "K2.theta": beta,
            "K3.theta": 0.455279819163070380255912382449,
            "K4.theta": 0.710033369709727,
            "K5.theta": 0.487364979543842550225598953530,
            "K6.theta": 1.00787905438393,
            "K7.theta": 1.23054744454982119249735015568,
        },
        times=np.linspace(0.0, 0.03, 301),
        outputs={
            "beta": k1.theta,
            "Theta": k2.theta - k1.theta,
            "gamma": k3.theta,
            "Phi": k4.theta - k5.theta,
            "delta": k5.theta,
            "Omega": k6.theta - k7.theta,
            "epsilon": k7.theta,
            "beta_dot": k1.omega,
            "Theta_dot": k2.omega - k1.omega,
            "gamma_dot": k3.omega,
            "Phi_dot": k4.omega - k5.omega,
            "delta_dot": k5.omega,
            "Omega_dot": k6.omega - k7.omega,
            "epsilon_dot": k7.omega,
            **{f"lam{i + 1}": lam[i] for i in range(6)},
        },
        box=mb.Box.around(p, 0.01, names=["c0", "mom"]),
        name="Andrews' squeezing mechanism",
    )
