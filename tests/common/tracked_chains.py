"""Poses that a tracker would measure on closed chains whose geometry differs from their files, without Pinocchio.

Forward kinematics are those of `tests.common.measured_poses`; SciPy's ``least_squares`` closes a loop at its two pins.
Parallelograms that files state by formulas are closed at the pins of their true lengths.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from identification.data.recording import Recording
from phantom_dyn import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot
from tests.common.measured_poses import link_poses, masses_of, pose, quaternions, rotation
from tests.common.places import ROBOTS

Array = np.ndarray

NOISE = 1e-4  # [m], and three times that in radian


@dataclass(frozen=True)
class Linkage:
    """A closed chain to be measured.

    Attributes:
        source: Of the robot.
        config: Its ``robot.yaml``, where it is not beside the file.
        text: URDF with all pins as links.
        pins: Two links that stay together.
        passive: Joints that close the loop, with where to begin: factors of active joints, and a constant without name.
        frame: Link that carries the target.
        middle, span: Of each active joint's postures [rad].
        up: Direction against gravity.
        formulas: Joints that follow without a loop, likewise.
        names: By pin, what its frame is called in findings, where the file has none.
    """

    source: str
    config: str | None
    text: str
    pins: tuple[str, str]
    passive: Mapping[str, Mapping[str, float]]
    frame: str
    middle: Sequence[float]
    span: Sequence[float]
    up: Sequence[float] = (0.0, 0.0, 1.0)
    formulas: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)

    @property
    def robot(self) -> Robot:
        """The robot as its files state it."""
        return load_robot(self.source, config=self.config)


def _fixed(text: str, parent: str, child: str, at: Sequence[float]) -> str:
    """A URDF with one more link on a fixed joint of the name ``<parent>_to_<child>``."""
    xyz = " ".join(map(str, at))
    joint = (
        f'<link name="{child}"/><joint name="{parent}_to_{child}" type="fixed"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}"/></joint></robot>'
    )
    return text.replace("</robot>", joint)


def linkages() -> dict[str, Linkage]:
    """PHANToM 1.5, CEA branch, four-bar and five-bar."""
    phantom = Path(find_robot("phantom_1_5")).read_text()
    phantom = _fixed(phantom, "forearm", "pin_f", (0, -0.0325, 0))
    phantom = _fixed(phantom, "parallel_link", "pin_p", (0, 0, 0.215))
    fourbar, fivebar = (str(ROBOTS / f"{name}.urdf") for name in ("fourbar", "fivebar"))
    parallel = {"elbow": {"theta3": 1.0, "theta2": -1.0}, "crank": {"theta2": 1.0, "theta3": -1.0}}
    upper = {"q3": {"q5": 1.0, "q2": -1.0}, "q6": {"q2": 1.0, "q5": -1.0}}
    return {
        "phantom": Linkage(
            "phantom_1_5", None, phantom, ("pin_f", "pin_p"), parallel, "tip",
            (0, 0.2, 0.2), (0.8, 0.6, 0.6), (0, 1, 0), {},
            {"pin_f": "forearm_to_parallel_link", "pin_p": "parallel_link_to_forearm"},
        ),
        "cea": Linkage(
            "cea_branch", None, Path(find_robot("cea_branch")).read_text(), ("pin3", "pin6"), upper, "tip",
            (0, -0.3, -1.7), (0.8, 0.5, 0.5), (0, 1, 0), {"q4": {"": np.pi / 2, "q5": -1.0}},
        ),
        "fourbar": Linkage(
            fourbar, str(ROBOTS / "fourbar.yaml"), Path(fourbar).read_text(), ("coupler_pin", "rocker_pin"),
            {"coupler": {"": -0.6823108}, "rocker": {"": -0.18861639}}, "coupler_pin", (0.0,), (3.1,),
        ),
        "fivebar": Linkage(
            fivebar, str(ROBOTS / "fivebar.yaml"), Path(fivebar).read_text(), ("left_pin", "right_pin"),
            {"left_elbow": {"": 0.0}, "right_elbow": {"": 0.0}}, "tip", (0.0, 0.0), (0.5, 0.5),
        ),
    }  # fmt: skip


@dataclass(frozen=True)
class TrueChain:
    """A linkage as it is: its URDF, what encoders read too much [rad], and deflections under weight [rad/(N m)]."""

    linkage: Linkage
    text: str
    zeros: Mapping[str, float] = field(default_factory=dict)
    compliance: Mapping[str, float] = field(default_factory=dict)

    def frames(self, read: Mapping[str, float]) -> dict[str, Array]:
        """Pose of every link where encoders of the active joints say ``read``."""
        true = {joint: angle - self.zeros.get(joint, 0.0) for joint, angle in read.items()}
        if not self.compliance:
            return self._closed(true)
        bent = dict(true)
        for _ in range(3):  # the load changes a little with the deflection
            for joint, compliance in self.compliance.items():
                bent[joint] = true[joint] - compliance * self._load(bent, joint)
        return self._closed(bent)

    def _load(self, q: Mapping[str, float], joint: str) -> float:
        """Torque that holds the weights: slope of the energy while the loop stays closed, by central differences."""
        step = 1e-4
        up, down = (self._energy(dict(q) | {joint: q[joint] + sign * step}) for sign in (1, -1))
        return (up - down) / (2 * step)

    def _energy(self, q: Mapping[str, float]) -> float:
        places, up = self._closed(q), np.array(self.linkage.up)
        masses = masses_of(self.text)
        return sum(
            9.81 * mass * float(up @ (places[link] @ np.append(centre, 1.0))[:3]) for link, mass, centre in masses
        )

    def _closed(self, q: Mapping[str, float]) -> dict[str, Array]:
        """Poses of all links with the loop closed, in the way of assembly that leads from where it begins."""
        linkage, names = self.linkage, list(self.linkage.passive)
        follow = {joint: _sum(one, q) for joint, one in linkage.formulas.items()}
        leads = any(joint for one in linkage.passive.values() for joint in one)
        steps = 1 if leads else 1 + int(np.ceil(max(map(abs, q.values())) / 0.4))
        z = np.array([_sum(linkage.passive[name], q) for name in names])
        for part in np.linspace(0, 1, steps)[-max(steps - 1, 1) :]:
            there = dict(q) if leads else {joint: part * angle for joint, angle in q.items()}

            def apart(z: Array, there: dict[str, float] = there) -> Array:
                places = link_poses(self.text, there | follow | dict(zip(names, z, strict=True)))
                return (places[linkage.pins[0]] - places[linkage.pins[1]])[:3, 3]

            near = 1e-13 if part == 1.0 else 1e-6  # on the way it is enough to stay in the way of assembly
            z = least_squares(apart, z, method="lm", xtol=near, ftol=near, gtol=near).x
        return link_poses(self.text, dict(q) | follow | dict(zip(names, z, strict=True)))


def _sum(formula: Mapping[str, float], q: Mapping[str, float]) -> float:
    return sum(factor * (q[joint] if joint else 1.0) for joint, factor in formula.items())


def tracked_chain(
    true: TrueChain,
    seed: int,
    *,
    poses: int = 60,
    turned: bool = False,
    noise: float = NOISE,
    root_poses: tuple[Array, Array] | None = None,
    q: Array | None = None,
) -> Recording:
    """Poses of the linkage's frame in the axes of a tracker that stands anywhere, or at given poses of base and target.

    Args:
        true: The linkage as it is.
        seed: Of postures and noise.
        poses: Number of them.
        turned: True if orientations are measured.
        noise: Of each coordinate [m]; three times that in radian.
        root_poses: Pose of the root in the tracker's axes, and of the target on the frame.
        q: Readings, where they are not drawn.
    """
    rng, linkage = np.random.default_rng(seed), true.linkage
    middle, span = np.array(linkage.middle), np.array(linkage.span)
    q = middle + span * rng.uniform(-1, 1, (poses, len(middle))) if q is None else q
    tracker = pose(rng.uniform(-3, 3, 3).tolist(), rng.uniform(-2, 2, 3).tolist())
    target = pose(rng.uniform(-0.1, 0.1, 3).tolist(), rng.uniform(-1, 1, 3).tolist())
    tracker, target = (tracker, target) if root_poses is None else root_poses
    joints = linkage.robot.joint_names
    seen = [true.frames(dict(zip(joints, map(float, row), strict=True)))[linkage.frame] for row in q]
    out = tracker @ np.array(seen) @ target
    p = out[:, :3, 3] + noise * rng.standard_normal((len(q), 3))
    R = np.array([one[:3, :3] @ rotation(3 * noise * rng.standard_normal(3)) for one in out])
    turns = {linkage.frame: quaternions(R)} if turned else {}
    t = 10.0 * np.arange(len(q))
    return Recording("poses.csv", joints, t, q, None, positions={linkage.frame: p}, orientations=turns)
