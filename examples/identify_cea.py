"""The CEA LIST haptic branch, simulated from its published tables: friction, stiffness, 16 parameters, link lengths.

Needs no recording. Published values stand beside what is found; the link lengths are not published and are free.
"""

from __future__ import annotations

import numpy as np

from identification.experiments.cea_identification import simulate_identification
from identification.experiments.constant_speed_friction import fit_steady
from identification.experiments.linear_fit import LinearFit
from identification.experiments.parallelogram_friction import (
    MOVING,
    Friction,
    fit_friction_test,
    friction_test_motion,
    loop_friction,
    passive_friction,
)
from identification.experiments.transmission import Loop, blocked_arm_loop, fit_transmission, triangular_torque
from identification.regression.base_parameters import BaseParameters, base_parameters_of_matrix
from phantom_dyn import load_robot
from phantom_dyn.devices.cea import FRICTION_TESTS, STIFFNESS_UNITS, TRANSMISSION_STIFFNESS, LinkLengths
from phantom_dyn.devices.cea_dynamics import NAMES, STIFFNESS_OF_RANGES, VALUES, nearest_posture, regressor
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.motion import Motion

SEED = 2
TORQUE_NOISE = 0.02  # N m
LENGTHS = ((0.20, 0.20), (0.30, 0.30), (0.35, 0.30), (0.40, 0.311), (0.479, 0.334), (0.592, 0.310))


def base_parameters() -> BaseParameters:
    """Inertial base parameters of the branch, from random states."""
    robot = load_robot("cea_branch")
    rng = np.random.default_rng(SEED)
    motion = Motion(np.arange(200.0), *rng.uniform(-2.0, 2.0, (3, 200, robot.nv)))
    W = rigid_body_regressor(robot, motion)
    return base_parameters_of_matrix(W.reshape(-1, W.shape[2]), parameter_names(robot), parameter_units(robot))


def show_regroupings() -> None:
    base = base_parameters()
    print(f"cea_branch: {base.rank} of {len(base.names)} inertial parameters show in the torque of the motors")
    for equation in base.regroupings():
        print("  " + equation)


def friction_test(test: str, rng: np.random.Generator) -> dict[int, LinearFit]:
    """One of the three tests on a branch with the friction that the first of them found."""
    motion = friction_test_motion(test)
    arm, forearm = (Friction(FRICTION_TESTS[f"FV{k}t1"].value, FRICTION_TESTS[f"FC{k}t1"].value) for k in (2, 5))
    tau = without_friction(motion) + TORQUE_NOISE * rng.normal(size=motion.q.shape)
    rubbing = loop_friction(motion.v[:, 1], motion.v[:, 2], arm=arm, forearm=forearm, passive=Friction())
    tau[:, 1:] += np.stack(rubbing, axis=1)
    return fit_friction_test(test, motion, tau)


def friction_test_of_joint_1(rng: np.random.Generator) -> LinearFit:
    """Joint 1 in the triangles of the other tests, the arm held still; its friction is that of Table 3."""
    moved = friction_test_motion("t2")
    motion = Motion(moved.t, *(np.roll(x, -1, axis=1) for x in (moved.q - moved.q[0], moved.v, moved.a)))
    friction = Friction(FRICTION_TESTS["FV1"].value, FRICTION_TESTS["FS1"].value)
    tau = without_friction(motion)[:, 0] + friction.torque(motion.v[:, 0])
    tau += TORQUE_NOISE * rng.normal(size=len(tau))
    names, units = ("FV1", "FS1"), ("N m s/rad", "N m")
    return fit_steady(motion.q[:, 0], motion.v[:, 0], motion.a[:, 0], tau, names, units)[0]


def without_friction(motion: Motion) -> np.ndarray:
    """Torque of the motors by Table 4, the friction left out [N m]."""
    rigid = np.where([name.startswith(("FV", "FS")) for name in NAMES], 0.0, VALUES)
    return regressor(motion) @ rigid


def friction_tests() -> tuple[LinearFit, dict[str, dict[int, LinearFit]]]:
    """Joint 1, and the tests t1, t2 and t3 of joints 2 and 5."""
    rng = np.random.default_rng(SEED)
    return friction_test_of_joint_1(rng), {test: friction_test(test, rng) for test in MOVING}


def show_friction() -> None:
    first, tests = friction_tests()
    for fit in (first, *(fit for test in tests.values() for fit in test.values())):
        for name, unit in zip(fit.names, fit.units, strict=True):
            value, std = fit.value(name)
            print(f"  {name:<6} {value:8.4f} +- {std:.4f} {unit:<9} published {FRICTION_TESTS[name].value:.3f}")
    condition = tests["t1"][1].condition
    print(f"  condition number {condition:.1f}, published about 6; friction of the passive joints:")
    for name, (value, std) in passive_friction(tests).items():
        verdict = "not distinguished from zero" if abs(value) < 2 * std else "there"
        print(f"  {name:<6} {value:8.4f} +- {std:.4f}: {verdict}")


def blocked_arm() -> LinearFit:
    """Transmission of 2 N m/mrad from three hysteresis loops of the blocked arm."""
    rng, loops = np.random.default_rng(SEED), []
    for frequency in (0.05, 0.2, 0.8):
        t = np.arange(0, 3 / frequency, 0.002)
        torque = triangular_torque(t, 1.5, frequency)
        loop = blocked_arm_loop(t, torque, stiffness=2.0 * STIFFNESS_UNITS["N m/mrad"], damping=0.0, coulomb=0.12)
        noise = rng.normal(size=(2, len(t)))
        loops.append(Loop(t, loop.torque + 0.01 * noise[0], loop.position + 1e-6 * noise[1]))
    return fit_transmission(loops, cutoff_hz=10.0)


def show_stiffness() -> None:
    unit = STIFFNESS_UNITS["N m/mrad"]
    value, std = blocked_arm().value("K")
    published = TRANSMISSION_STIFFNESS["K1"]
    stands = f"published {published.value} (printed as {published.unit})"
    print(f"  K {value / unit:.4f} +- {std / unit:.4f} N m/mrad, {stands}")


def show_lengths() -> None:
    print(f"  joints of {STIFFNESS_OF_RANGES:g} N m/rad; published: at most 0.65 kg, 0.3 to 0.4 N, 2000 to 5000 N/m")
    for d3, d4 in LENGTHS:
        q, felt = nearest_posture(lengths=LinkLengths(d3, d4))
        print(
            f"  d3 {d3:.3f} m, d4 {d4:.3f} m: {felt.mass[0]:.2f} kg, {felt.coulomb[0]:.2f} N, "
            f"{felt.stiffness.min():.0f} to {felt.stiffness.max():.0f} N/m "
            f"at q2 {np.rad2deg(q[1]):.0f}, q5 {np.rad2deg(q[2]):.0f} degrees"
        )


def main() -> None:
    show_regroupings()
    print("\nfriction tests (Table 3)")
    show_friction()
    print("\nstiffness of a transmission from hysteresis loops of the blocked arm (Table 2)")
    show_stiffness()
    print("\nidentification with exciting motion (Table 4; published condition number about 50)")
    print(simulate_identification(np.random.default_rng(SEED)).summary())
    print("\nwhat a hand feels, by link lengths, at the posture nearest to what is published")
    show_lengths()


if __name__ == "__main__":
    main()
