"""Diagnoses of two recordings with what is known of them, against what each truth was."""

from __future__ import annotations

import json

import numpy as np
import pytest

from identification.data.changes import Change, KnownPayload, robot_in
from identification.diagnosis.columns.own_effects import differences_of
from identification.diagnosis.result import EffectAt
from identification.export.corrected.corrected_yaml import write_corrected
from identification.pipeline import diagnose
from identification.reporting.stored.diagnosis_files import json_text
from identification.words.diagnosis_words import finding_words
from identification.words.ledger_words import why
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import LogError

# Whole diagnoses: what they call is checked beside the functions.
pytestmark = pytest.mark.whole

LOADED = Change("b.csv", KnownPayload(1.5, (0.0, 0.0, -0.9)))


@pytest.fixture(scope="module")
def grown(pendulum, swing, recorded):
    """The pin has 0.3 N m more friction than modelled, in b 1.2 N m more, and nobody knows how much."""
    extra = ((1, 0.3, "a.csv"), (2, 1.2, "b.csv"))
    recordings = tuple(recorded(pendulum, swing(k), size * np.sign(swing(k).v), file, k) for k, size, file in extra)
    return diagnose(pendulum, recordings, changes=(Change("a.csv"), Change("b.csv", changed=("friction",))))


def in_b(diagnosis):
    return next(finding for finding in diagnosis.findings if finding.recording == "b.csv")


def test_friction_that_grew_is_named_with_its_ratio(grown):
    # Known truth: 0.7 modelled and 0.3 more in a, 1.2 more in b.
    ratio = in_b(grown).parameters["ratio"]
    assert [(f.effect, f.recording) for f in grown.findings] == [
        ("coulomb_friction", "b.csv"),
        ("coulomb_friction", None),
    ]
    assert abs(ratio.value - 1.9 / 1.0) < 3 * ratio.std < 0.4
    assert grown.verdict == "explained"


def test_friction_that_grew_is_said_with_its_recording(grown):
    said = finding_words(in_b(grown))
    assert "times what it is in the other recordings: friction torque" in said.what
    assert " on joint pin in b.csv, where it is" in said.what


def test_only_what_one_recording_has_names_it_in_the_json(grown):
    found = json.loads(json_text(grown))["findings"]
    assert [finding.get("recording") for finding in found] == ["b.csv", None]


def test_the_ledger_names_the_recording_of_a_claim(grown):
    claimed = {claim.effects for claim in grown.ledger if claim.outcome == "claimed"}
    assert claimed == {(EffectAt(one.effect, one.joint, one.recording),) for one in grown.findings}
    names = [answer.name for answer in why(grown, "coulomb_friction")]
    assert sorted(names) == ["Coulomb friction on joint pin", "Coulomb friction on joint pin in b.csv"]


def test_what_one_recording_has_is_not_part_of_the_corrected_model(grown):
    assert write_corrected(grown, "pendulum", "0").count("coulomb_friction") == 1


def test_no_effect_of_one_recording_is_left_in_bounds(grown):
    entries = (*grown.bounds, *grown.not_testable)
    assert not [entry for entry in entries if "@" in entry.effect]


def test_friction_that_stayed_is_not_said_to_have_changed(pendulum, swing, recorded):
    recordings = tuple(recorded(pendulum, swing(k), 0.4 * np.sign(swing(k).v), f"{k}.csv", k) for k in (1, 2))
    found = diagnose(pendulum, recordings, changes=(Change("1.csv"), Change("2.csv", changed=("friction",))))
    assert [(finding.effect, finding.recording) for finding in found.findings] == [("coulomb_friction", None)]


def test_payloads_without_a_value_in_two_recordings_are_refused(pendulum):
    changes = (Change("a.csv"), Change("b.csv", changed=("payload",)), Change("c.csv", changed=("payload",)))
    with pytest.raises(LogError, match=r"b\.csv and c\.csv each have a payload without a value"):
        differences_of(changes, pendulum, 3)


def test_a_known_mass_alone_is_no_gap(pendulum, swing, recorded):
    recordings = (
        recorded(pendulum, swing(1), 0.0, "a.csv"),
        recorded(robot_in(pendulum, LOADED), swing(2), 0.0, "b.csv", 2),
    )
    assert diagnose(pendulum, recordings, changes=(Change("a.csv"), LOADED)).verdict == "no_gap"


@pytest.mark.parametrize("truth", ["payload", "torque_constant"])
def test_a_known_mass_parts_a_payload_and_a_torque_constant(frictionless, swing, recorded, truth):
    # Known truth. Without the mass both say the same torque: the effects are exact twins on a pendulum.
    def extra(robot, motion):
        if truth == "torque_constant":
            return inverse_dynamics(robot, motion) * (1 / 0.8 - 1)
        theta = np.array([0.6, 0.0, 0.0, -0.6])
        return -effect_named("payload").torque(robot, Operation.of(robot, motion), None, theta)

    loaded = robot_in(frictionless, LOADED)
    recordings = (
        recorded(frictionless, swing(1), extra(frictionless, swing(1)), "a.csv"),
        recorded(loaded, swing(2), extra(loaded, swing(2)), "b.csv", 2),
    )
    found = diagnose(frictionless, recordings, changes=(Change("a.csv"), LOADED))
    rivals = {at.effect for finding in found.findings for rival in finding.rivals for at in rival.effects}
    assert [finding.effect for finding in found.findings] == [truth]
    assert not rivals & {"payload", "torque_constant"}
