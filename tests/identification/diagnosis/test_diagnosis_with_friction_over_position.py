"""Friction that depends on the position, diagnosed beside its neighbours. Oracle: the law that was put in."""

import numpy as np
import pytest

from by_night import by_night
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose

NAME = "position_dependent_friction"
PLACES = np.linspace(-1.5, 1.5, 13)
TORQUES = 0.6 * np.exp(-(((PLACES - 0.2) / 0.4) ** 2))
THETA = tuple(map(float, (*PLACES, *TORQUES)))


@pytest.fixture(scope="module")
def found(diagnosed) -> Diagnosis:
    return diagnosed((NAME, "elbow", THETA), seed=1)


def test_it_is_named_and_nothing_else_is(found):
    assert [(finding.effect, finding.joint, finding.rivals) for finding in found.findings] == [(NAME, "elbow", ())]
    assert found.verdict == "explained"


def test_its_table_is_the_law_at_its_places(found):
    # Within three deviations of a place, and what a straight line between places misses of the bump.
    parameters = found.findings[0].parameters
    places, torques, std = (np.array(x) for x in (
        parameters["position"].value, parameters["torque"].value, parameters["torque"].std,
    ))  # fmt: skip
    truth = np.interp(places, PLACES, TORQUES)
    assert np.all(np.abs(torques - truth) < 3.0 * std + 0.05)
    assert np.median(std) < 0.03
    assert torques.max() > 0.5


def test_a_model_that_has_it_leaves_no_gap(planar2, lacking):
    again = diagnose(planar2, (lacking((NAME, "elbow", THETA), seed=1),), known=(KnownEffect(NAME, "elbow", THETA),))
    assert (again.verdict, again.findings) == ("no_gap", ())


OTHERS = [
    ("coulomb_friction", (0.4,)),
    ("load_dependent_friction", (0.1,)),
    ("presliding_friction", (0.5, 0.1)),
    ("stribeck_friction", (0.3, 0.8, 0.3)),
]


@pytest.mark.parametrize(("name", "theta"), by_night(OTHERS, 0, 3))
def test_other_friction_is_not_taken_for_it(diagnosed, name, theta):
    findings = diagnosed((name, "elbow", theta)).findings
    assert NAME not in {finding.effect for finding in findings}
    assert name in {finding.effect for finding in findings}
