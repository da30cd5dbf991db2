"""Diagnosis of the real recording of EMPS against its published values.

The UR10 and the double pendulum are diagnosed by their examples, in tests/examples.
"""

from pathlib import Path

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose
from phantom_dyn import load_robot


def places(diagnosis: Diagnosis) -> list[tuple[str, str | None]]:
    return [(finding.effect, finding.joint) for finding in diagnosis.findings]


@pytest.fixture(scope="module")
def emps(data_folder: Path) -> Diagnosis:
    data = np.load(data_folder / "emps" / "emps_train.npz")
    recording = Recording("emps", ("axis",), data["t"], data["q_meas"][:, None], data["force"][:, None])
    return diagnose(load_robot("emps"), (recording,))


def test_emps_has_direction_dependent_friction(emps):
    assert places(emps) == [("direction_dependent_friction", "axis")]
    assert emps.findings[0].probability > 0.5
    assert emps.findings[0].gap_closed > 0.9


def test_rivals_of_emps_are_friction_on_the_same_axis(emps):
    effects = {effect.effect for rival in emps.findings[0].rivals for effect in rival.effects}
    assert effects <= {"coulomb_friction", "viscous_friction", "torque_offset", "stribeck_friction"}


@pytest.mark.parametrize(
    ("name", "published", "accuracy"),
    [
        ("torque_positive", 20.1440, 0.03),
        ("torque_negative", 20.6277, 0.03),
        ("coefficient_positive", 166.7061, 0.02),
        ("coefficient_negative", 240.4236, 0.02),
    ],
)
def test_the_published_friction_of_emps_comes_back(emps, name, published, accuracy):
    # Janot, Gautier and Brunot 2019: direction-dependent friction of the axis.
    assert emps.findings[0].parameters[name].value == pytest.approx(published, rel=accuracy)
