"""Diagnoses of the planar arm, each made once for all tests that look at it."""

from collections.abc import Callable
from functools import cache

import pytest

from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose
from lab import Lab
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
