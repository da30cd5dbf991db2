"""Torque ripple that grows with the load, diagnosed beside cogging. Oracle: the law that was put in."""

import numpy as np
import pytest

from by_night import by_night
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Diagnosis
from identification.export.corrected.corrected_yaml import known_effects, write_corrected
from identification.export.corrected.found_effects import effect_of
from identification.pipeline import diagnose
from phantom_dyn.motion import Motion

RIPPLE, COGGING = "torque_ripple", "cogging"
THETA = (23.0, 0.05, 0.7)


@pytest.fixture(scope="module")
def found(planar2, lacking) -> Diagnosis:
    return diagnose(planar2, (lacking((RIPPLE, "elbow", THETA)),))


def test_it_is_named_and_nothing_else_is(found):
    assert [(finding.effect, finding.joint, finding.rivals) for finding in found.findings] == [(RIPPLE, "elbow", ())]
    assert found.verdict == "explained"


@pytest.mark.parametrize(("name", "truth"), list(zip(("order", "amplitude", "phase"), THETA, strict=True)))
def test_its_sizes_lie_within_their_intervals(found, name, truth):
    parameter = found.findings[0].parameters[name]
    (value,), (std,) = parameter.value, parameter.std
    assert abs(value - truth) <= 2.0 * std + 1e-12
    assert std < 0.1 * truth


def test_the_one_wave_that_was_found_is_written_and_read_back(found, planar2, tmp_path):
    file = tmp_path / "corrected.yaml"
    file.write_text(write_corrected(found, planar2.source, planar2.sha256))
    (known,) = known_effects((file,), planar2)
    assert known == effect_of(planar2, found.findings[0])
    assert known.theta == pytest.approx(THETA, rel=0.1)


@pytest.mark.nightly
def test_a_model_that_has_it_leaves_no_gap(planar2, lacking):
    recording = lacking((RIPPLE, "elbow", THETA))
    again = diagnose(planar2, (recording,), known=(KnownEffect(RIPPLE, "elbow", THETA),))
    assert (again.verdict, again.findings) == ("no_gap", ())


def test_cogging_under_a_load_that_changes_is_not_called_ripple(planar2, lacking):
    # The same waves at any load: here as high as the ripple's mean.
    diagnosis = diagnose(planar2, (lacking((COGGING, "elbow", (23.0, 0.2, 0.7))),))
    (finding,) = diagnosis.findings
    assert (finding.effect, finding.joint, finding.rivals) == (COGGING, "elbow", ())


@pytest.mark.parametrize(("name", "theta"), by_night([(RIPPLE, (40.0, 0.003, 0.7)), (COGGING, (40.0, 0.028, 0.7))], 0))
def test_both_are_named_where_the_load_hardly_changes(lab, pendulum, name, theta):
    # A rod that moves slowly about the level has nearly its whole weight as load: 9.3 N m, give or take 0.4.
    t = np.arange(4000) / 200.0
    w = 2 * np.pi * np.array([0.11, 0.31])
    angle, size = np.outer(t, w), np.array([0.5, 0.1])
    q, v, a = 0.5 * np.pi + np.sin(angle) @ size, np.cos(angle) @ (size * w), -np.sin(angle) @ (size * w**2)
    motion = Motion(t, q[:, None], v[:, None], a[:, None])
    recording = lab.recording(pendulum, motion, lab.acting(pendulum, motion, name, "pin", *theta))
    (finding,) = diagnose(pendulum, (recording,)).findings
    named = {finding.effect} | {one.effect for rival in finding.rivals for one in rival.effects}
    assert {RIPPLE, COGGING} <= named
    assert finding.verdict == "one_of"
