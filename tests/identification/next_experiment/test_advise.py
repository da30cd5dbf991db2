"""Advice for the next experiment."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from identification.data.signals import low_pass
from identification.diagnosis.explanation import Explanation
from identification.diagnosis.noise.noise_floor import estimate_noise
from identification.diagnosis.result import EffectAt, Finding, Rival
from identification.diagnosis.search.fits import Fits
from identification.excitation.motion_shapes import FourierSeries
from identification.next_experiment.advise import Proposal, Trial, length_of, proposal_words, proposed, reference_text
from identification.next_experiment.candidates import Candidate
from identification.next_experiment.hypotheses import Hypothesis, Variant, hypotheses_of, model_of, union_of
from identification.next_experiment.planned_recording import coarser, planned_recording
from identification.next_experiment.separation import Pair
from identification.notes import Code
from identification.reporting.stored.diagnosis_files import write_outputs
from identification.words.diagnosis_words import PROPOSED, finding_words
from identification.words.note_words import sentence
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.motion import Motion


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
    # Coulomb friction, of probability 0.7, is named for sure if it is what acts.
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


def test_a_fit_that_has_fewer_tolerance_parameters_than_it_could_is_a_model_with_all_of_them(lab, pendulum):
    # Oracle: the coefficients of the fit. Fits with other weights may see more moves or fewer than the search.
    motion = lab.motion(1, swing=0.3)
    torque = lab.acting(pendulum, motion, "coulomb_friction", "pin", 0.2)
    ready = lab.prepared(pendulum, (lab.recording(pendulum, motion, torque),))
    fewer = replace(ready.search.problem, fitted_nuisances=ready.search.problem.fitted_nuisances[1:])
    chosen = frozenset([ready.term("coulomb_friction", "pin")])
    variant = Variant(chosen, Fits(fewer).held_out(chosen), 0.0)
    union = union_of((Hypothesis((EffectAt("coulomb_friction", "pin"),), 1.0, (variant,)),))
    model = model_of(variant, union)
    assert model.basis.shape[1] == fewer.nuisance_count + 1
    assert model.is_nuisance.sum() == fewer.nuisance_count
    np.testing.assert_allclose(model.basis @ model.y + model.shift, variant.fitted.theta[union], atol=1e-12)


def test_a_finding_that_leads_in_the_place_of_what_was_found_gets_a_motion_too(lab, pendulum):
    # The search has found viscous friction; Coulomb friction was named in its place, with viscous friction as a rival.
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
    stated = replace(
        made_up(pendulum.joint_names, findings=0, samples=400),
        next_experiment=friction.experiment,
        next_motion=friction.motion,
    )
    written = write_outputs(stated, pendulum, out=tmp_path, json_file=None)
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


MOTION = Candidate("Fourier series", FourierSeries(10.0, 4), np.zeros((9, 1)))

PAIR = Pair(*(Hypothesis((EffectAt(name, "pin"),), 0.5, ()) for name in ("viscous_friction", "input_delay")))


def test_softer_gains_are_asked_for_in_the_sentence():
    trial = Trial(MOTION, None, 0.25, np.array([0.9]), np.array([40.0]), 0.9)
    said = proposal_words((PAIR,), trial, "next.csv", 0.9).replace("\xa0", " ")
    assert said.startswith(
        "Record the motion of next.csv with the gains of the position controllers at 25 % of those in robot.yaml"
        " (10 s, Fourier series"
    )
    assert "), write these gains as its controller beside its file name in recordings.yaml, and diagnose it" in said
    assert said.endswith(
        "with a probability of 90 % it separates viscous friction on joint pin from an input delay on joint pin."
    )


def test_of_many_pairs_one_is_reported_and_the_others_counted():
    def cause(effect: str, joint: str) -> Hypothesis:
        return Hypothesis((EffectAt(effect, joint),), 0.5, ())

    pairs = tuple(Pair(cause("viscous_friction", f"j{k}"), cause("coulomb_friction", f"j{k}")) for k in range(5))
    trial = Trial(MOTION, None, 0.25, np.array([0.9]), np.array([40.0]), 0.9)
    said = proposal_words(pairs, trial, "next.csv", 0.9)
    assert said.endswith("friction on joint j0 from Coulomb friction on joint j0, and 4 more causes from others.")
    assert "j1" not in said


def test_a_reference_has_the_columns_of_the_contract_and_loses_no_digit(rng):
    q, v, a = rng.normal(size=(3, 5, 2))
    text = reference_text(Motion(np.arange(5) / 3.0, q, v, a), ("j1", "j2"))
    header, *rows = text.splitlines()
    assert header == "t,q_ref.j1,q_ref.j2,v_ref.j1,v_ref.j2,a_ref.j1,a_ref.j2"
    table = np.array([[float(x) for x in row.split(",")] for row in rows])
    np.testing.assert_array_equal(table, np.column_stack([np.arange(5) / 3.0, q, v, a]))


def test_reversals_tell_as_little_of_a_planned_motion_as_of_a_recorded_one(lab, pendulum):
    # Oracle: the products that the diagnosis itself forms of the same motion. Samples at reversals count less there, as
    # friction is in doubt, and what separates presliding from Coulomb friction lies in them alone.
    moved = lab.motion(1, seconds=20.0, swing=0.5)
    ready = lab.prepared(pendulum, (lab.recording(pendulum, moved, 0.2 * np.sign(moved.v)),))
    noise = estimate_noise(ready.session, ready.columns)[0]
    short = min(
        (term for term in ready.columns.terms if term.effect.name == "presliding_friction"), key=lambda t: t.shape
    )
    coulomb, viscous = (ready.term(name, "pin") for name in ("coulomb_friction", "viscous_friction"))
    union = np.array(sorted(k for term in (short, coulomb, viscous) for k in term.columns))
    plan = planned_recording(ready.problem, noise, union, ())
    planned = plan.products(lab.motion(1, seconds=20.0, swing=0.5, rate=plan.band.rate_hz), pendulum)
    recorded = ready.problem.total_a[np.ix_(union, union)]

    def stated(products):
        """What parts the two laws, in units of what viscous friction shows."""
        apart = (union == short.columns[0]).astype(float) - (union == coulomb.columns[0])
        at = int(np.searchsorted(union, viscous.columns[0]))
        return apart @ products @ apart / products[at, at]

    assert abs(stated(planned) / stated(recorded) - 1.0) < 0.25


@pytest.mark.parametrize("step", [1, 3, 19, 26, 400])
def test_a_planned_motion_comes_out_of_the_filter_at_the_rate_of_the_recordings(step):
    # By the definition of the filter: 2.5 samples come out per period of its edge, and at least four go in.
    cutoff = 1000.0 / (2.5 * step) if step > 1 else 450.0
    band = low_pass(cutoff, 1000.0)
    fewer = coarser(band)
    assert fewer.rate_hz / fewer.step == pytest.approx(band.output_rate_hz)
    assert min(4.0 * band.cutoff_hz, band.rate_hz) <= fewer.rate_hz <= band.rate_hz
    assert fewer.rate_hz <= 8.0 * band.cutoff_hz or fewer is band
