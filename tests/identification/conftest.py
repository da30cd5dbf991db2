"""Small robots, recordings of them whose truth is known, and made-up diagnoses."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from identification.diagnosis.result import Diagnosis
from lab import Lab, Prepared
from made_up_diagnosis import made_up_diagnosis
from phantom_dyn import load_robot
from phantom_dyn.model.robot import Robot, Tolerance
from places import ROBOTS

TRUSTED = Tolerance(inertia=0.0, friction=0.0, rotor_inertia=0.0)


@pytest.fixture(scope="session")
def planar2() -> Robot:
    """Two links on shoulder and elbow, with modelled friction."""
    return load_robot(ROBOTS / "planar2.urdf")


@pytest.fixture(scope="session")
def made_up() -> Callable[..., Diagnosis]:
    """Builds a diagnosis: joint names, number of findings, samples and torque unit can be given."""
    return made_up_diagnosis


@pytest.fixture(scope="session")
def lab() -> Lab:
    return Lab()


@pytest.fixture(scope="module")
def two(lab: Lab, planar2: Robot) -> Prepared:
    """Two recordings of different length; no fit sees the second."""
    recordings = (
        lab.recording(planar2, lab.motion(2, 1, seconds=16.0)),
        lab.recording(planar2, lab.motion(2, 2, seconds=7.0), seed=1),
    )
    return lab.prepared(planar2, recordings, held_out=1)


@pytest.fixture(scope="session")
def trusted() -> Callable[[Robot], Robot]:
    """The same robot with a model that is trusted exactly."""
    return lambda robot: replace(robot, tolerance=TRUSTED)


@pytest.fixture(scope="session")
def quiet(lab: Lab, planar2: Robot) -> Prepared:
    """The planar arm without a gap, ready for fits."""
    return lab.prepared(planar2, (lab.recording(planar2, lab.motion(2)),))
