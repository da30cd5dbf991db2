"""No gap is stated only if other bands show none. Oracle: made-up judgements of each band."""

from dataclasses import replace

import pytest

from identification import pipeline
from identification.data import signals
from identification.data.signals import process_all
from identification.notes import Code
from identification.pipeline import DiagnosisWithoutPlan
from identification.scenarios.other_bands import are_distinct_bands, shows_gap, with_band_note
from identification.words.note_words import sentence


@pytest.mark.parametrize(("other", "expected"), [(2.5, True), (8.0, False), (10.0, False), (15.0, True)])
def test_two_bands_are_judged_separately_from_half_as_much_again(other, expected):
    assert are_distinct_bands(10.0, other) == expected


@pytest.mark.parametrize(("times", "expected"), [(1.9, False), (2.1, True)])
def test_a_residual_in_another_band_is_a_gap_from_twice_the_largest_noise(made_up, times, expected):
    found = replace(made_up(findings=0), verdict="unknown")
    joint = found.joints[0]
    quiet = (replace(one, rms_after=0.0) for one in found.joints[1:])
    assert shows_gap(replace(found, joints=(replace(joint, rms_after=times * joint.allowed), *quiet))) == expected


@pytest.mark.parametrize(("probability", "expected"), [(0.4, False), (0.6, True)])
def test_a_finding_in_another_band_is_a_gap_if_it_is_probable(made_up, probability, expected):
    found = made_up()
    joints = tuple(replace(one, rms_after=0.0) for one in found.joints)
    (finding,) = found.findings
    assert shows_gap(replace(found, joints=joints, findings=(replace(finding, probability=probability),))) == expected


def test_the_edge_of_another_band_is_two_octaves_below(lab, planar2):
    recording = lab.recording(planar2, lab.motion(2, 3))
    _, edge = process_all((recording,), planar2)
    _, other = process_all((recording,), planar2, 0.25)
    assert other == pytest.approx(max(0.25 * edge, 1.0))


@pytest.mark.parametrize(("gap_below_hz", "verdict"), [(3.0, "unknown"), (0.0, "no_gap")])
def test_no_gap_is_stated_only_if_no_other_band_shows_one(lab, planar2, made_up, monkeypatch, gap_below_hz, verdict):
    def judged(given, session, progress):
        gap = session.cutoff_hz < gap_below_hz
        found = replace(made_up(findings=0), verdict="unknown" if gap else "no_gap")
        joints = tuple(replace(one, rms_after=(3.0 if gap else 0.0) * one.allowed) for one in found.joints)
        return DiagnosisWithoutPlan(replace(found, joints=joints, band_hz=(0.0, session.cutoff_hz)))

    monkeypatch.setattr(pipeline, "_of_session", judged)
    monkeypatch.setattr(signals, "choose_cutoff", lambda _: 8.0)
    found = pipeline.diagnose(planar2, (lab.recording(planar2, lab.motion(2, 3)),))
    assert found.verdict == verdict
    assert any(getattr(note, "code", None) == Code.OTHER_BAND for note in found.notes) == (verdict == "unknown")


@pytest.mark.parametrize(("edge", "why"), [(2.0, "noise of higher frequencies hides it"), (32.0, "left out")])
def test_the_note_says_why_the_chosen_band_shows_no_gap(made_up, edge, why):
    found = with_band_note(replace(made_up(), band_hz=(0.0, edge)), replace(made_up(), band_hz=(0.0, 8.0)))
    assert why in sentence(found.notes[-1])
