"""A load with an inertia of its own beside wrong inertial parameters; bodies of closed form are the oracle."""

import numpy as np
import pytest

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.judge.findings.possible_load import possible_load_notes
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.inertia import body_parameters
from phantom_dyn.model.loading import load_robot
from places import ROBOTS

BAR = np.diag([1e-4, 0.02, 0.02])  # 1.5 kg of 0.4 m along x
SMALL = np.diag(np.array([1e-3, 1e-4, 1e-4, 1e-4, *[1e-5] * 6]) ** 2)


def notes(joint: str, mass: float, inertia: np.ndarray, cov: np.ndarray = SMALL):
    robot = load_robot(ROBOTS / "planar2.urdf")
    effect = effect_named("inertial_parameters")
    term = Term(effect, joint, (), tuple(range(10)), 10, (-np.inf,) * 10, (np.inf,) * 10)
    return possible_load_notes(robot, term, body_parameters(mass, np.array([0.0, 0.0, 0.1]), inertia), cov)


def test_changes_that_a_clamped_bar_makes_are_said_to_be_a_load_too():
    (note,) = notes("elbow", 1.5, BAR)
    assert note.numbers["mass"] == 1.5
    np.testing.assert_allclose(note.numbers["center"], (0.0, 0.0, 0.1), atol=1e-12)


@pytest.mark.parametrize(
    ("joint", "mass", "inertia", "cov"),
    [
        ("shoulder", 1.5, BAR, SMALL),  # no link that carries a load
        ("elbow", -1.5, BAR, SMALL),  # a body that is missing
        ("elbow", 1.5, BAR - 0.03 * np.eye(3), SMALL),  # no body has this inertia
        ("elbow", 1.5, BAR, 1e6 * SMALL),  # the mass is not known
    ],
)
def test_changes_that_no_load_makes_for_sure_are_not(joint, mass, inertia, cov):
    assert notes(joint, mass, inertia, cov) == []
