"""Fixtures: recordings of poses that a tracker would measure on a UR10 whose geometry is known."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from identification.data.recording import Recording
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot
from tests.common.measured_poses import TrueRobot, measured, moved_joint, pose, quaternions, rotation

NOISE = 1e-4


@pytest.fixture(scope="session")
def ur10() -> Robot:
    return load_robot("example:ur10")


@pytest.fixture(scope="session")
def ur10_text() -> str:
    return Path(find_robot("example:ur10")).read_text()


@pytest.fixture
def tracked(ur10, ur10_text) -> Callable[..., Recording]:
    """Poses of ``tool0`` in the axes of a tracker that stands anywhere, with a target that sits anywhere.

    With ``base`` it stands at the root but for that shift and turn, and the target on the frame but for ``tool``.
    """

    def make(
        seed: int,
        *,
        poses: int = 60,
        zeros: Mapping[str, float] | None = None,
        compliance: Mapping[str, float] | None = None,
        moves: Sequence[tuple] = (),
        turned: bool = False,
        noise: float = NOISE,
        q: np.ndarray | None = None,
        t: np.ndarray | None = None,
        late: float = 0.0,
        misread: Callable[[np.ndarray], np.ndarray] = lambda q: q,
        base: Sequence[float] | None = None,
        tool: Sequence[float] = (0, 0, 0, 0, 0, 0),
    ) -> Recording:
        rng = np.random.default_rng(seed)
        q = rng.uniform(-1.5, 1.5, (poses, 6)) + np.array([0, -1.2, 0, 0, 0, 0]) if q is None else q
        t = 10.0 * np.arange(len(q)) if t is None else t
        at = q if late == 0 else np.column_stack([np.interp(t - late, t, column) for column in q.T])
        text = ur10_text
        for move in moves:
            text = moved_joint(text, *move)
        tracker = pose(rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3))
        target = pose(rng.uniform(-0.1, 0.1, 3), rng.uniform(-1, 1, 3))
        if base is not None:
            tracker, target = pose(base[:3], base[3:]), pose(tool[:3], tool[3:])
        readings = {joint: at[:, k] for k, joint in enumerate(ur10.joint_names)}
        robot = TrueRobot(text, zeros or {}, compliance or {})
        p, R = measured(robot, "tool0", readings, tracker=tracker, target=target)
        p = p + noise * rng.standard_normal(p.shape)
        R = np.array([each @ rotation(3 * noise * rng.standard_normal(3)) for each in R])
        turns = {"tool0": quaternions(R)} if turned else {}
        return Recording("poses.csv", ur10.joint_names, t, misread(q), None, positions={"tool0": p}, orientations=turns)

    return make


@pytest.fixture
def slow_motion() -> tuple[np.ndarray, np.ndarray]:
    """A minute of all joints at 20 Hz: times and positions."""
    rng = np.random.default_rng(7)
    t = np.arange(0, 60, 0.05)
    q = np.zeros((len(t), 6))
    for j in range(6):
        for k in (1, 2, 3):
            q[:, j] += rng.uniform(0.2, 0.5) * np.sin(2 * np.pi * k * t / 30 + rng.uniform(0, 6))
    return t, q + np.array([0, -1.2, 0, 0, 0, 0])
