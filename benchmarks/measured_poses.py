"""Measure how often measured poses of a UR10 or a closed chain blame a correct robot, and find the error of another.

    python -m benchmarks.measured_poses --seeds 3000:3100
    python -m benchmarks.measured_poses --seeds 3100:3200 --in-root-frame  # base and target, too
    python -m benchmarks.measured_poses --seeds 5300:5340 --chains  # PHANToM 1.5, CEA branch, four-bar, five-bar

Each seed gives a correct robot and a robot with one error, measured to 0.1 mm: 20 to 100 poses at rest, with or
without orientations. Errors are encoder zeros, frames and elasticity; of closed chains zeros and link lengths, and half
of the seeds have their poses in the root frame. The generator (``tests/common``) has forward kinematics and loop
closure of its own.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from identification.data.recording import Recording
from identification.geometry.diagnose_poses import diagnose_poses
from identification.geometry.result import GeometryResult
from phantom_dyn import load_robot
from phantom_dyn.model.robot_files import find_robot
from tests.common.measured_poses import TrueRobot, measured, moved_joint, pose, quaternions, rotation
from tests.common.tracked_chains import Linkage, TrueChain, linkages, tracked_chain

NOISE = 1e-4  # noise of positions [m], and three times that of orientations [rad]
Key = tuple[str, str | None, str]


def recording(
    seed: int, robot: TrueRobot, joints: tuple[str, ...], root_poses: tuple[np.ndarray, np.ndarray] | None = None
) -> Recording:
    """Poses of ``tool0`` in the axes of a tracker at a random or given place."""
    rng = np.random.default_rng(seed)
    poses = (20, 40, 60, 100)[seed % 4]
    q = rng.uniform(-1.5, 1.5, (poses, 6)) + np.array([0, -1.2, 0, 0, 0, 0])
    tracker = pose(rng.uniform(-3, 3, 3).tolist(), rng.uniform(-2, 2, 3).tolist())
    target = pose(rng.uniform(-0.1, 0.1, 3).tolist(), rng.uniform(-1, 1, 3).tolist())
    tracker, target = (tracker, target) if root_poses is None else root_poses
    read = {joint: q[:, k] for k, joint in enumerate(joints)}
    p, R = measured(robot, "tool0", read, tracker=tracker, target=target)
    R = np.array([each @ rotation(3 * NOISE * rng.standard_normal(3)) for each in R])
    turns = {"tool0": quaternions(R)} if seed % 2 else {}
    p = p + NOISE * rng.standard_normal(p.shape)
    return Recording("poses.csv", joints, 10.0 * np.arange(poses), q, None, positions={"tool0": p}, orientations=turns)


def wrong_robot(seed: int, text: str, joints: tuple[str, ...]) -> tuple[TrueRobot, Key, float]:
    """A robot with one error, the name of the error, and its size."""
    rng = np.random.default_rng([seed, 1])
    size = float(rng.choice([-1, 1]) * rng.uniform(1e-3, 8e-3))
    kind = int(rng.integers(3))
    if kind == 0:
        joint = joints[int(rng.integers(1, 5))]
        return TrueRobot(text, {joint: size}), ("encoder_offset", joint, "offset"), size
    if kind == 1:
        joint, axis = joints[int(rng.integers(1, 6))], int(rng.integers(3))
        shift = size * np.eye(3)[axis]
        return TrueRobot(moved_joint(text, joint, shift.tolist())), ("link_geometry", joint, "xyz"[axis]), size
    joint, size = joints[int(rng.integers(1, 3))], 1 / float(rng.uniform(1e4, 6e4))
    return TrueRobot(text, {}, {joint: size}), ("joint_elasticity", joint, "compliance"), size


def poses_off_in_root(seed: int) -> tuple[tuple[np.ndarray, np.ndarray], Key, float]:
    """Poses of base and target near those in the log's file, with one wrong number, and its size."""
    rng = np.random.default_rng([seed, 2])
    part, of_tool = int(rng.integers(6)), bool(rng.integers(2))
    part = part % 3 if of_tool and seed % 2 == 0 else part  # without orientations, the target's orientation is not used
    size = float(rng.choice([-1, 1]) * rng.uniform(1e-3, 8e-3))
    numbers = (size * np.eye(6)[part]).tolist()
    wrong = pose(numbers[:3], numbers[3:])
    both = (np.eye(4), wrong) if of_tool else (wrong, np.eye(4))
    parameter = ("x", "y", "z", "rx", "ry", "rz")[part]
    return both, ("tool_pose", "tool0", parameter) if of_tool else ("base_pose", None, parameter), size


@dataclass
class Score:
    """Counts over the seeds, and the errors of the sizes by effect.

    Attributes:
        robots: Seeds, each with a correct robot and a robot with one error.
        blamed: Correct robots for which the verdict is not ``no_gap``.
        testable: Errors that are found, or that the poses can show.
        named: Errors among the findings.
        listed: Errors among the rivals of other findings.
        not_shown: Errors without any finding, too small for the poses.
        missed: All other errors.
        extra: Robots with one error and more than one finding.
        errors: Errors of the sizes; of elasticity relative to the size.
    """

    robots: int = 0
    blamed: int = 0
    testable: int = 0
    named: int = 0
    listed: int = 0
    not_shown: int = 0
    missed: int = 0
    extra: int = 0
    errors: dict[str, list[float]] = field(default_factory=dict)

    def add(self, right: GeometryResult | None, said: GeometryResult | None, key: Key, size: float) -> None:
        """Count a correct robot and a robot with one error."""
        assert right is not None
        assert said is not None
        self.robots += 1
        self.blamed += bool(right.findings or right.verdict != "no_gap")
        self.extra += len(said.findings) > 1
        sizes, rivals = named_and_rivals(said)
        below = {(one.effect, one.joint, one.parameter): one.below for one in said.bounds}
        unseen = not said.findings and key in {(one.effect, one.joint, one.parameter) for one in said.not_testable}
        self.testable += not unseen
        if key in sizes:
            self.named += 1
            error = abs(sizes[key] - size)
            self.errors.setdefault(key[0], []).append(error / size if key[0] == "joint_elasticity" else error)
        elif key in rivals:
            self.listed += 1
        elif unseen or (not said.findings and below.get(key, 0.0) > abs(size)):
            self.not_shown += 1
        else:
            self.missed += 1

    def words(self) -> str:
        """All counts in one line."""
        errors = ", ".join(
            f"{effect}: median error {np.median(values):.2g}, largest {max(values):.2g}"
            for effect, values in self.errors.items()
        )
        return (
            f"{self.robots} robots, right ones blamed {self.blamed}; single errors named {self.named}, listed as a "
            f"rival {self.listed}, said to be too small for these poses {self.not_shown}, missed {self.missed}, with "
            f"more findings {self.extra}; {errors}"
        )


def named_and_rivals(said: GeometryResult) -> tuple[dict[Key, float], set[Key]]:
    """The numbers of the findings with their sizes, and the numbers of their rivals."""
    sizes = {(f.effect, f.joint, name): x.value for f in said.findings for name, x in f.parameters.items()}
    places = [place for f in said.findings for rival in f.rivals for place in rival.places]
    return sizes, {(place.effect, place.joint, name) for place in places for name in place.parameters}


LENGTHS = {
    "phantom": (("elbow", "elbow", 2), ("crank", "crank", 1), ("forearm_to_pin_f", "forearm_to_parallel_link", 1),
                ("parallel_link_to_pin_p", "parallel_link_to_forearm", 2)),
    "cea": (("q3", "q3", 0), ("q6", "q6", 0), ("q8", "pin3", 0), ("q7", "pin6", 0)),
    "fourbar": (("rocker", "rocker", 0), ("coupler", "coupler", 0), ("coupler_to_pin", "coupler_pin", 0),
                ("rocker_to_pin", "rocker_pin", 2)),
    "fivebar": (("right", "right", 0), ("left_elbow", "left_elbow", 2), ("right_elbow", "right_elbow", 2),
                ("left_to_pin", "left_pin", 2), ("right_to_pin", "right_pin", 2)),
}  # fmt: skip
"""Joints of the URDF, their names in findings, and the axis along which the link length is measured."""


def wrong_chain(seed: int, name: str, linkage: Linkage) -> tuple[TrueChain, Key, float]:
    """A closed chain with one error, the name of the error, and its size."""
    rng = np.random.default_rng([seed, 3, *name.encode()])
    size = float(rng.choice([-1, 1]) * rng.uniform(1e-3, 5e-3))
    if rng.integers(2):
        joint = str(rng.choice(linkage.robot.joint_names))
        return TrueChain(linkage, linkage.text, {joint: size}), ("encoder_offset", joint, "offset"), size
    moved, joint, axis = LENGTHS[name][int(rng.integers(len(LENGTHS[name])))]
    text = moved_joint(linkage.text, moved, (size * np.eye(3)[axis]).tolist())
    return TrueChain(linkage, text), ("link_geometry", joint, "xyz"[axis]), size


def chains(seeds: range) -> None:
    """Print the score of each linkage."""
    for name, linkage in linkages().items():
        scores = {True: Score(), False: Score()}
        for seed in seeds:
            poses, turned, in_root = (20, 40, 60, 100)[seed % 4], bool(seed // 4 % 2), bool(seed // 2 % 2)
            at_root = (np.eye(4), np.eye(4)) if in_root else None
            true, key, size = wrong_chain(seed, name, linkage)
            right, said = (
                diagnose_poses(
                    linkage.robot,
                    (tracked_chain(one, number, poses=poses, turned=turned, root_poses=at_root),),
                )
                for one, number in ((TrueChain(linkage, linkage.text), seed), (true, seed + 100_000))
            )
            scores[in_root].add(right, said, key, size)
        print(f"{name}, in the root frame: {scores[True].words()}")
        print(f"{name}, tracker and target anywhere: {scores[False].words()}")


def main() -> None:
    """Print false claims, truths among findings and rivals, other findings, and the largest errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0:100")
    parser.add_argument("--in-root-frame", action="store_true")
    parser.add_argument("--chains", action="store_true")
    given = parser.parse_args()
    first, last = map(int, given.seeds.split(":"))
    if given.chains:
        chains(range(first, last))
        return
    at_root = (np.eye(4), np.eye(4)) if given.in_root_frame else None
    robot, text = load_robot("example:ur10"), Path(find_robot("example:ur10")).read_text()
    score = Score()
    for seed in range(first, last):
        right = diagnose_poses(robot, (recording(seed, TrueRobot(text), robot.joint_names, at_root),))
        true, key, size = wrong_robot(seed, text, robot.joint_names)
        root_poses = at_root
        if given.in_root_frame and seed % 3:
            true = TrueRobot(text)
            root_poses, key, size = poses_off_in_root(seed)
        said = diagnose_poses(robot, (recording(seed, true, robot.joint_names, root_poses),))
        score.add(right, said, key, size)
    print(f"right robots that are blamed: {score.blamed} of {score.robots}")
    print(
        f"single errors that the poses can show: {score.testable}, in the set: {score.named + score.listed}, "
        f"with more findings: {score.extra}"
    )
    for effect, values in score.errors.items():
        print(f"{effect}: {len(values)}, median error {np.median(values):.2g}, largest {max(values):.2g}")


if __name__ == "__main__":
    main()
