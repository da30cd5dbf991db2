"""Diagnoses of the planar arm, each made once for all tests that look at it."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose
from lab import Lab, Prepared
from phantom_dyn.model.robot import Robot

Effect = tuple[str, str | None, tuple[float, ...]]


@pytest.fixture(scope="session")
def lacking(lab: Lab, planar2: Robot) -> Callable[..., Recording]:
    """A recording of the arm, 20 s long, with effects (name, joint, parameters) that its model lacks."""

    def record(*effects: Effect, seed: int = 3) -> Recording:
        motion = lab.motion(2, seed, seconds=20.0, swing=1.5)
        torque = sum(lab.acting(planar2, motion, name, joint, *theta) for name, joint, theta in effects)
        return lab.recording(planar2, motion, torque, seed=seed)

    return record


@pytest.fixture(scope="session")
def diagnosed(planar2: Robot, lacking: Callable[..., Recording]) -> Callable[..., Diagnosis]:
    """The diagnosis of such a recording, made once."""
    return cache(lambda *effects, seed=3: diagnose(planar2, (lacking(*effects, seed=seed),)))


@pytest.fixture(scope="session")
def rough(lab: Lab, planar2: Robot) -> Prepared:
    """The planar arm with Coulomb and viscous friction that the model lacks, and its term on each joint."""
    motion = lab.motion(2, 3)
    torque = -np.sign(motion.v) * [0.0, 0.25] - motion.v * [0.15, 0.0]
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
