"""The six-degree-of-freedom device around the CEA branch: loops, base parameters, motors, maps, rods, cable friction.

Needs no recording. Of the whole device only its make is published: platform, handle, rods and pretensions are inputs,
and round numbers here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from arguments import chosen_folder

from identification.experiments.cable_pretension import fit_pretension
from identification.export.log_and_map_files import write_map
from identification.regression.base_parameters import base_parameters_of_matrix
from phantom_dyn import load_robot
from phantom_dyn.devices.cable_friction import CableFriction, rescaled
from phantom_dyn.devices.cea import FRICTION_TESTS, LENGTHS, LinkLengths, tip_position
from phantom_dyn.devices.cea_two_branches import (
    PLATFORM,
    POSTURE,
    Platform,
    Rods,
    branch_with_rods_urdf,
    branch_with_rods_yaml,
    motor_slope,
    shared_torque,
    two_branches_urdf,
    two_branches_yaml,
)
from phantom_dyn.dynamics.dynamics import gravity_torque, rigid_body_regressor
from phantom_dyn.dynamics.kinematics import frame_pose
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.operational_map import operational_map
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

SEED = 3
GRID = "q.upper_q2=-0.5:0:21,q.lower_q2=-0.5:0:21"
QUANTITIES = ("manipulability", "apparent_mass", "coulomb_force", "gravity_force")


def written(folder: Path, urdf: str, yaml: str) -> Robot:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(urdf)
    (folder / "robot.yaml").write_text(yaml)
    return load_robot(folder / "robot.urdf")


def rank(robot: Robot, motion: Motion) -> tuple[int, list[str]]:
    """Number of inertial base parameters, and the equations in which what regroups stands."""
    W = rigid_body_regressor(robot, motion)
    base = base_parameters_of_matrix(W.reshape(-1, W.shape[2]), parameter_names(robot), parameter_units(robot))
    return base.rank, list(base.regroupings())


def within_reach(t: np.ndarray) -> np.ndarray:
    """Both branches move together, the lower one up to 0.12 rad apart, so that the platform reaches."""
    arm, forearm = POSTURE[0] + 0.3 * np.sin(2 * t), POSTURE[1] + 0.3 * np.sin(3 * t + 1)
    lower = arm + 0.12 * np.sin(5 * t), forearm + 0.12 * np.sin(4 * t + 2)
    return np.stack([*lower, 0.4 * np.sin(t + 0.5), arm, np.sin(6 * t), forearm], axis=1)


def show_device(robot: Robot, rng: np.random.Generator) -> None:
    q = within_reach(np.linspace(0.0, 40.0, 400))
    _, place = frame_pose(robot, q, "tip")
    print(f"{robot.nv} joints position it, {len(robot.passive_names)} follow; the handle moved within", end=" ")
    print(" x ".join(f"{1e3 * span:.0f}" for span in np.ptp(place, axis=0)), "mm")
    print("the platform turns by", ", ".join(f"{angle:.0f} degrees about {axis}" for axis, angle in turns().items()))
    found, equations = rank(robot, Motion(np.arange(400.0), q, *rng.normal(size=(2, 400, 6))))
    print(f"{found} inertial base parameters: 21 of each branch, {found - 42} of platform and handle; among them")
    print("  " + next(line for line in equations if line.startswith("lower_link1.IzzR")))
    at_posture = np.array([POSTURE])
    shared = shared_torque(motor_slope(robot, at_posture), gravity_torque(robot, at_posture))[0]
    print(
        "gravity at the posture, shared by the motors:", ", ".join(f"{1e3 * torque:.2g}" for torque in shared), "mN m"
    )


def turns(platform: Platform = PLATFORM) -> dict[str, float]:
    """How far the platform turns about x and z of the base while its upper end stays at the posture [deg].

    Counted from upright to either side until the lower branch does not reach its end, or comes within 10 degrees of a
    stretched or folded arm. Links and handle may pass through each other: neither shapes nor stops are published. About
    its own axis the handle turns without a limit.
    """
    arm, forearm = POSTURE[:2]
    place = tip_position(np.array([[0.0, arm, forearm]]))[0]
    down, out = np.array([0.0, -1.0, 0.0]), {}
    least, most = (np.hypot(*_triangle(LENGTHS, np.deg2rad(bend))) for bend in (170.0, 10.0))
    # Joint `swing` turns about x: its universal joint is singular at a quarter of a turn. Joint `tilt` turns about z.
    for name, axis, limit in (("x", np.array([1.0, 0.0, 0.0]), 90.0), ("z", np.array([0.0, 0.0, 1.0]), 180.0)):
        angles, reached = np.deg2rad(np.arange(0.0, limit + 0.25, 0.5)), []
        for side in (1, -1):
            cosine, sine = np.cos(angles)[:, None], np.sin(side * angles)[:, None]
            end = place + platform.length * ((cosine - 1) * down + sine * np.cross(axis, down))
            r = np.linalg.norm(end, axis=1)
            missed = np.flatnonzero((r < least) | (r > most))
            reached.append(angles[missed[0] - 1] if len(missed) else angles[-1])
        out[name] = float(np.rad2deg(sum(reached)))
    return out


def _triangle(lengths: LinkLengths, bend: float) -> tuple[float, float]:
    """Tip of a branch whose forearm is bent by an angle from its arm, in the axes of the arm [m]."""
    return lengths.d3 + lengths.d4 * float(np.cos(bend)), lengths.d4 * float(np.sin(bend))


def show_maps(robot: Robot, folder: Path) -> None:
    result = operational_map(map_model(robot, frame="tip"), read_grid(GRID, robot.joint_names), QUANTITIES)
    print(f"{result.grid.size} postures, {result.unreachable} beyond the platform's reach, {result.singular} singular")
    mass, friction = (result.values[name] for name in ("apparent_mass", "coulomb_force"))
    print(f"apparent mass {np.nanmin(mass):.2f} to {np.nanmax(mass):.2f} kg, Coulomb force", end=" ")
    print(f"{np.nanmin(friction):.2f} to {np.nanmax(friction):.2f} N")
    for path in write_map(result, folder):
        print(f"wrote {path}")


def rods_by_feet(folder: Path) -> dict[str, int]:
    """Inertial base parameters of the upper branch with the piece at its elbow, by where its rods have their feet."""
    rng, along, away = np.random.default_rng(SEED), (0.05, 0.0, 0.0), (0.0, 0.05, 0.0)
    found = {}
    for words, rods in (
        ("no rods", Rods(None, None)),
        ("one rod, 50 mm along X1", Rods(along, None)),
        ("both rods, 50 mm along X1", Rods(along, along)),
        ("both rods, 50 mm across X1", Rods(away, away)),
    ):
        robot = written(folder, branch_with_rods_urdf(rods), branch_with_rods_yaml(rods))
        found[words], _ = rank(robot, Motion(np.arange(150.0), *rng.uniform(-2.0, 2.0, (3, 150, 3))))
    return found


def show_rods(folder: Path) -> None:
    print("inertial base parameters of the upper branch with the piece at its elbow, by where its rods have their feet")
    for words, found in rods_by_feet(folder).items():
        print(f"  {words:<26} {found}")


def show_pretension(rng: np.random.Generator) -> None:
    published = FRICTION_TESTS["FC2t1"]
    print(f"Coulomb friction of joint 2, published {published.value} N m; at half the pretension of the cable", end=" ")
    print(f"{rescaled(published.value, pretension=2.0, new_pretension=1.0):.3f} N m")
    pulled, std = np.array([20.0, 30.0, 45.0, 60.0]), np.full(4, published.std)
    coulomb = CableFriction(published.value / 40.0).coulomb(pulled) + std * rng.normal(size=4)
    found = fit_pretension(pulled, coulomb, std)
    value, deviation = found.through_origin
    true = published.value / 40
    print(f"  simulated at 20 to 60 N: {1e3 * value:.3f} +- {1e3 * deviation:.3f} mm, true {1e3 * true:.3f} mm")
    print(f"  left at no pretension {found.rest[0]:.4f} +- {found.rest[1]:.4f} N m: proportional {found.proportional}")


def main(folder: Path) -> None:
    rng = np.random.default_rng(SEED)
    robot = written(folder / "two_branches", two_branches_urdf(), two_branches_yaml())
    show_device(robot, rng)
    show_maps(robot, folder)
    show_rods(folder / "with_rods")
    show_pretension(rng)


if __name__ == "__main__":
    main(chosen_folder(__doc__, "cea_two_branches"))
