from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from identification.data.signals import low_pass
from identification.diagnosis.explanation import Explanation
from identification.diagnosis.noise.noise_floor import estimate_noise
from identification.diagnosis.result import EffectAt, Finding, Rival
from identification.next_experiment.advise import length_of, proposed
from identification.next_experiment.hypotheses import hypotheses_of
from identification.next_experiment.proposal import Proposal
from identification.notes import Code
from identification.reporting.stored.diagnosis_files import write_outputs
from identification.words.diagnosis_words import PROPOSED, finding_words
from identification.words.note_words import sentence
from phantom_dyn.dynamics.dynamics import inverse_dynamics


def one_of(effect: str, rival: str, joint: str) -> Finding:
    """A finding with one rival on the same joint."""
    rivals = (Rival((EffectAt(rival, joint),), 0.3),)
    return Finding(effect, joint, "everywhere", {}, 0.8, (0.7, 0.9), 0.7, rivals, "one_of")


@pytest.fixture(scope="module")
def advised(lab):
    """What is proposed for a robot on which one effect acts and another one is its rival."""

    def advise(robot, motion, effect, joint, theta, rival):
        torque = lab.acting(robot, motion, effect, joint, *theta)
        ready = lab.prepared(robot, (lab.recording(robot, motion, torque),))
        noise = estimate_noise(ready.session, ready.columns)[0]
        chosen = frozenset([ready.term(effect, joint)])
        return proposed(Explanation(ready.search, chosen, noise), (one_of(effect, rival, joint),))

    return advise


@pytest.fixture(scope="module")
def friction(lab, pendulum, advised):
    """Coulomb friction or viscous friction: a recording of small swings leaves it open."""
    return advised(pendulum, lab.motion(1, swing=0.3), "coulomb_friction", "pin", (0.2,), "viscous_friction")


def test_rivals_that_differ_over_speed_get_a_motion_that_parts_them(friction):
    experiment = friction.experiment
    assert set(experiment) == {"separates", "reference", "expected_power", "say"}
    assert experiment["separates"] == [["coulomb_friction", "pin"], ["viscous_friction", "pin"]]
    assert experiment["reference"] == "next.csv"
    # Coulomb friction, of probability 0.7, is told for sure if it is what acts.
    assert experiment["expected_power"] > 0.65


def test_the_sentence_says_what_to_do_and_what_it_tells(friction):
    say = friction.experiment["say"]
    assert say.startswith("Record the motion of next.csv")
    assert "Coulomb friction on joint pin from viscous friction on joint pin" in say
    words = finding_words(one_of("coulomb_friction", "viscous_friction", "pin"), friction.experiment)
    assert words.what_next == PROPOSED


def test_the_motion_is_no_faster_and_asks_for_no_more_torque_than_twice_the_recording(friction, lab, pendulum):
    # Oracle: the recording's own extremes, and inverse dynamics.
    recorded, motion = lab.motion(1, swing=0.3), friction.motion
    assert np.abs(motion.v).max() < 2.05 * np.abs(recorded.v).max()
    assert np.ptp(motion.q) < 2.05 * np.ptp(recorded.q)
    torque = np.abs(inverse_dynamics(pendulum, recorded)).max() + 0.2
    assert np.abs(inverse_dynamics(pendulum, motion)).max() < 2.05 * torque


def test_exact_twins_get_no_motion_but_a_note_that_says_what_would_help(lab, pendulum, advised):
    # On a pendulum a rotor's inertia is one of the link's own parameters.
    out = advised(pendulum, lab.motion(1), "rotor_inertia", "pin", (0.02,), "inertial_parameters")
    assert out.experiment is None
    assert out.motion is None
    assert "No safe motion that was tried separates rotor inertia on joint pin from" in sentence(out.notes[0])
    assert "data sheet" in sentence(out.notes[0])


def test_without_rivals_nothing_is_proposed(quiet):
    chosen = frozenset([quiet.term("coulomb_friction", "shoulder")])
    finding = replace(one_of("coulomb_friction", "viscous_friction", "shoulder"), rivals=())
    assert proposed(Explanation(quiet.search, chosen, quiet.noise), (finding,)) == Proposal()


def test_a_joint_without_a_drive_is_said_to_stand_against_an_experiment(lab, pendulum, advised):
    idle = replace(pendulum, actuators=(replace(pendulum.actuators[0], actuated=False),))
    out = advised(idle, lab.motion(1), "coulomb_friction", "pin", (0.2,), "viscous_friction")
    assert out.experiment is None
    assert [note.code for note in out.notes] == [Code.NO_EXPERIMENT]
    assert "pin of" in sentence(out.notes[0])


def test_a_finding_that_was_not_chosen_has_no_hypotheses(quiet):
    assert hypotheses_of(quiet.search, frozenset(), one_of("coulomb_friction", "viscous_friction", "elbow")) == ()


def test_a_finding_that_leads_in_the_place_of_what_was_found_gets_a_motion_too(lab, pendulum):
    # The search has found viscous friction; Coulomb friction was told in its place, with viscous friction as a rival.
    robot, motion = pendulum, lab.motion(1, swing=0.3)
    torque = lab.acting(robot, motion, "coulomb_friction", "pin", 0.2)
    ready = lab.prepared(robot, (lab.recording(robot, motion, torque),))
    noise = estimate_noise(ready.session, ready.columns)[0]
    chosen = frozenset([ready.term("viscous_friction", "pin")])
    out = proposed(Explanation(ready.search, chosen, noise), (one_of("coulomb_friction", "viscous_friction", "pin"),))
    assert out.experiment is not None
    assert out.experiment["separates"] == [["coulomb_friction", "pin"], ["viscous_friction", "pin"]]


def test_the_motion_is_written_beside_the_diagnosis(friction, made_up, pendulum, tmp_path, monkeypatch):
    # The report has tests of its own, and takes a second.
    monkeypatch.setattr("identification.reporting.stored.diagnosis_files._report", lambda *_: "page")
    told = replace(
        made_up(pendulum.joint_names, findings=0, samples=400),
        next_experiment=friction.experiment,
        next_motion=friction.motion,
    )
    written = write_outputs(told, pendulum, out=tmp_path, json_file=None)
    assert tmp_path / "next.csv" in written
    with (tmp_path / "next.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["t", "q_ref.pin", "v_ref.pin", "a_ref.pin"]
    np.testing.assert_array_equal(np.array(rows[1:], dtype=float)[:, 1], friction.motion.q[:, 0])


def test_a_slow_recording_gets_a_proposal_long_enough_for_its_band(lab, pendulum):
    # One sample in ten seconds: twenty seconds would hold three of them, and no fit has its columns from these.
    motion = lab.motion(1)
    torque = lab.acting(pendulum, motion, "coulomb_friction", "pin", 0.2)
    logs = lab.prepared(pendulum, (lab.recording(pendulum, motion, torque),)).session.logs
    slow = replace(logs[0], band=low_pass(0.02, 0.1))
    seconds = length_of((slow,))
    assert len(slow.band.samples(int(seconds * 0.1))) >= 20
    assert length_of(logs) <= 20
