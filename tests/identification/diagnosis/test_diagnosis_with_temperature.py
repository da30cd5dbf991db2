"""Friction that changes as a drive warms up, diagnosed with its temperature. Oracle: the law that was put in."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose
from identification.reporting.page.diagnosis_report import report_html

WARM = "temperature_dependent_friction"
COULOMB, VISCOUS, TORQUE_SLOPE, SLOPE = 1.0, 0.4, -0.015, -0.008  # at 40 degrees, and per degree


@pytest.fixture(scope="module")
def motion(lab):
    """A pendulum swung for half a minute."""
    return lab.motion(1, 3, seconds=30.0, swing=1.5)


@pytest.fixture(scope="module")
def warming(motion) -> np.ndarray:
    """A drive that warms up from 25 to 51 degrees, read in whole degrees."""
    return np.round(25.0 + 30.0 * (1.0 - np.exp(-motion.t / 15.0)))[:, None]


@pytest.fixture(scope="module")
def rubbing(lab, pendulum, motion, warming) -> Recording:
    """Friction falls as the drive warms up."""
    d = warming - 40.0
    torque = -(COULOMB + TORQUE_SLOPE * d) * np.sign(motion.v) - (VISCOUS + SLOPE * d) * motion.v
    return replace(lab.recording(pendulum, motion, torque), temperature=warming)


@pytest.fixture(scope="module")
def found(pendulum, rubbing) -> Diagnosis:
    return diagnose(pendulum, (rubbing,))


@pytest.fixture(scope="module")
def plain(lab, pendulum, motion) -> Recording:
    """The same friction at every temperature."""
    return lab.recording(pendulum, motion, -COULOMB * np.sign(motion.v) - VISCOUS * motion.v)


@pytest.fixture(scope="module")
def without_temperature(pendulum, plain) -> Diagnosis:
    return diagnose(pendulum, (plain,))


def without_what_warms(diagnosis: Diagnosis) -> tuple[object, ...]:
    """Findings, figures and bounds beside those of the effect."""
    bounds = tuple(bound for bound in diagnosis.bounds if bound.effect != WARM)
    untested = tuple(one for one in diagnosis.not_testable if one.effect != WARM)
    return diagnosis.verdict, diagnosis.findings, diagnosis.joints, diagnosis.gap, bounds, untested


def test_it_is_named_and_nothing_else_is(found):
    assert [(finding.effect, finding.joint) for finding in found.findings] == [(WARM, "pin")]
    assert found.verdict == "explained"


@pytest.mark.parametrize(("name", "truth"), [("torque_slope", TORQUE_SLOPE), ("coefficient_slope", SLOPE)])
def test_its_slopes_lie_within_their_intervals(found, name, truth):
    value = found.findings[0].parameters[name]
    assert abs(value.value - truth) < 2.0 * value.std < 0.2 * abs(truth)


def test_its_levels_are_those_at_the_reference(found):
    parameters = found.findings[0].parameters
    d = parameters["reference_temperature"].value - 40.0
    for name, level, slope in (("coulomb_torque", COULOMB, TORQUE_SLOPE), ("coefficient", VISCOUS, SLOPE)):
        assert abs(parameters[name].value - (level + slope * d)) < 2.0 * parameters[name].std


def test_simulations_move_at_the_temperature_of_their_moment(found):
    # At one temperature it would stray ten times as far: at the beginning friction is half as large again.
    assert found.rollout is not None
    assert found.rollout["rms_after"]["pin"] < 0.05 * found.rollout["rms_before"]["pin"]


def test_the_report_says_it_in_its_words(found):
    page = report_html(found)
    assert "temperature-dependent friction of" in page
    assert "friction that changes as the drive warms up" in page


@pytest.mark.nightly
def test_a_model_that_has_it_leaves_no_gap(pendulum, rubbing, found):
    theta = tuple(float(value.value) for value in found.findings[0].parameters.values())
    again = diagnose(pendulum, (rubbing,), known=(KnownEffect(WARM, "pin", theta),))
    assert (again.verdict, again.findings) == ("no_gap", ())


def test_a_null_with_a_temperature_has_no_finding(lab, pendulum, motion, warming):
    null = replace(lab.recording(pendulum, motion), temperature=warming)
    diagnosis = diagnose(pendulum, (null,))
    assert (diagnosis.verdict, diagnosis.findings) == ("no_gap", ())
    assert [bound.parameter for bound in diagnosis.bounds if bound.effect == WARM] == ["torque_slope"]


def test_constant_friction_with_a_temperature_is_plain_friction(pendulum, plain, warming):
    diagnosis = diagnose(pendulum, (replace(plain, temperature=warming),))
    assert {finding.effect for finding in diagnosis.findings} == {"coulomb_friction", "viscous_friction"}


def test_a_temperature_that_does_not_change_changes_no_answer(pendulum, plain, without_temperature, warming):
    other = diagnose(pendulum, (replace(plain, temperature=0.0 * warming + 40.0),))
    assert without_what_warms(without_temperature) == without_what_warms(other)


def test_without_a_temperature_it_is_said_that_it_cannot_be_tested(without_temperature):
    (why,) = (one.why for one in without_temperature.not_testable if one.effect == WARM)
    assert why == "the temperature of its drive was not recorded (column temp.pin)"
