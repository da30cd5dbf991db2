"""Sizes: which are shown, which a sound device may have, what noise moves."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import lfilter

from by_night import by_night
from identification.data.recording import Recording
from identification.diagnosis.fit.gap import RowGaps
from identification.diagnosis.judge.findings.gate_state import GateContext, LoopState, Residuals
from identification.diagnosis.judge.findings.shown import _noise_gate
from identification.diagnosis.judge.findings.shown_numbers import reach_of, with_unknown_marked
from identification.diagnosis.judge.findings.sound_sizes import all_plausible, size_notes
from identification.diagnosis.judge.judged_band import JudgedBand, search_below
from identification.diagnosis.judge.strong_motion import (
    _strong_up_to,
    noise_may_imitate,
    predictable_noise,
    strong_motion_search,
)
from identification.diagnosis.result import Value
from identification.notes import Code
from identification.pipeline import diagnose
from identification.words.verdict_words import headline
from phantom_dyn import load_robot
from phantom_dyn.model.inertia import has_known_centre


@pytest.fixture
def session(quiet):
    return quiet.session


def test_a_place_that_is_known_to_no_better_than_the_robot_is_large_is_not_shown(session, planar2):
    reach = reach_of(planar2)
    values = {"center_x": Value(0.1, 0.01 * reach, "m"), "center_y": Value(0.0, 2.0 * reach, "m")}
    found = with_unknown_marked(values, session, None)
    assert [value.shown for value in found.values()] == [True, False]
    assert found["center_x"] == values["center_x"]


def test_a_load_that_is_large_beside_the_robot_is_shown_by_its_own_size(session, planar2):
    moment = 10.0 * reach_of(planar2) * sum(float(inertia.mass) for inertia in planar2.model.inertias[1:])
    values = {"moment_x": Value(moment, 0.1 * moment, "kg m"), "moment_y": Value(0.0, 0.1 * moment, "kg m")}
    assert [value.shown for value in with_unknown_marked(values, session, None).values()] == [True, False]


def test_a_torque_whose_deviation_is_above_all_that_was_measured_is_not_shown(session, planar2):
    largest = max(float(np.abs(log.tau[:, 1]).max()) for log in session.logs)
    values = {"torque": Value([0.1, 0.2], [0.01, 2.0 * largest], "N m")}
    assert with_unknown_marked(values, session, "elbow")["torque"].std == [0.01, np.inf]


def test_a_mass_beside_moments_is_shown_if_its_deviation_is_less_than_half_of_it(session):
    # A centre divides by the mass, so that moments are stated from 13 % on; a mass of 1.0 +- 0.2 kg is still known.
    moments = {"moment_x": Value(0.2, 0.01, "kg m")}
    assert not with_unknown_marked({"mass": Value(1.0, 0.6, "kg"), **moments}, session, None)["mass"].shown
    assert with_unknown_marked({"mass": Value(1.0, 0.2, "kg"), **moments}, session, None)["mass"].shown
    assert not has_known_centre(1.0, 0.2)
    assert has_known_centre(1.0, 0.1)


def test_how_high_a_robot_is_mounted_does_not_lengthen_its_reach(planar2):
    # By hand: the first placement is that of the base. A load of a gantry at 1 m was at 0.00 +- 0.69 m.
    high = replace(planar2, model=planar2.model.copy())
    high.model.jointPlacements[1] = pin.SE3(np.eye(3), np.array([0.0, 0.0, 5.0]))
    assert reach_of(high) == pytest.approx(reach_of(planar2))


def finding(effect: str, joint: str) -> Any:
    """As much of a finding as is looked at."""
    return SimpleNamespace(effect=effect, joint=joint)


def shown_with(quiet, sizes) -> Any:
    """What is shown of an arm, with sizes of effects on its elbow."""
    theta = np.zeros(len(quiet.problem.precision))
    terms = [quiet.term(effect, "elbow") for effect in sizes]
    for term, size in zip(terms, sizes.values(), strict=True):
        theta[list(term.columns)] = size
    fit = SimpleNamespace(
        coefficients=lambda term: theta[list(term.columns)],
        slices_of=lambda term: SimpleNamespace(coefficients=slice(term.columns[0], term.columns[-1] + 1)),
        cov=np.zeros((len(theta), len(theta))),
    )
    found = SimpleNamespace(theta=theta)
    return SimpleNamespace(problem=quiet.problem, named=frozenset(terms), named_fit=found, full_fit=fit)


@pytest.mark.parametrize(
    ("sizes", "codes"),
    [
        ({"coulomb_friction": 0.1, "viscous_friction": 0.05}, []),
        # Pushes at high speed, where it is larger than what holds back.
        ({"coulomb_friction": 0.02, "viscous_friction": -1.0}, [Code.FRICTION_DRIVES]),
        # At its bound no friction is left, and none drives.
        ({"coulomb_friction": 0.0, "viscous_friction": 0.0}, []),
    ],
)
def test_friction_of_all_findings_together_holds_back(quiet, sizes, codes):
    notes = [note for note in size_notes(shown_with(quiet, sizes)) if note.code is Code.FRICTION_DRIVES]
    assert [note.code for note in notes] == codes
    assert {note.joint for note in notes} <= {"elbow"}


def test_a_torque_constant_of_four_is_said_to_be_none(quiet):
    # By hand: 1 / (1 - 0.75) is 4, where two is the most.
    (note,) = size_notes(shown_with(quiet, {"torque_constant": -0.75}))
    assert note.code is Code.IMPLAUSIBLE_SIZE
    assert note.numbers["value"] == pytest.approx(4.0)
    assert note.numbers["most"] == pytest.approx(2.0)


def test_only_findings_that_are_named_have_to_be_sound(quiet):
    notes = size_notes(shown_with(quiet, {"torque_constant": -0.75}))
    constant, friction = (finding(name, "elbow") for name in ("torque_constant", "other"))
    assert not all_plausible([friction, constant], notes)
    assert all_plausible([friction], notes)


def test_a_joint_whose_friction_drives_it_has_no_sound_finding(quiet):
    notes = size_notes(shown_with(quiet, {"coulomb_friction": 0.02, "viscous_friction": -1.0}))
    at = [finding("viscous_friction", joint) for joint in ("elbow", "shoulder")]
    assert not all_plausible(at[:1], notes)
    assert all_plausible(at[1:], notes)


def test_a_gap_is_not_explained_by_a_torque_constant_that_no_motor_has(lab, planar2):
    # Known truth: the torque of the elbow is recorded three times too small, its friction with it.
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = lab.acting(planar2, motion, "torque_constant", "elbow", 3.0)
    found = diagnose(planar2, (lab.recording(planar2, motion, torque),))
    assert ("torque_constant", "elbow") in {(one.effect, one.joint) for one in found.findings}
    assert found.verdict == "partly_explained"
    assert "a size that no sound robot has" in headline(found)


RATE, SECONDS = 1000.0, 8.0
INERTIA, WEIGHT, VISCOUS, COULOMB = 0.0225, 0.4905, 0.02, 0.01  # about the pin [kg m^2, N m, N m s/rad, N m]
SWING = """<robot name="swing"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 0.05"/><mass value="1"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
<joint name="pin" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="80" velocity="50"/><dynamics damping="0.02" friction="0.01"/></joint></robot>
"""
CONFIG = "torque_source: command\ntorque_hold: zoh\ntolerance: {inertia: 0.05, friction: 0.05, rotor_inertia: 0.1}\n"


@pytest.fixture(scope="module")
def swing(tmp_path_factory):
    folder = tmp_path_factory.mktemp("swing")
    (folder / "robot.urdf").write_text(SWING)
    (folder / "robot.yaml").write_text(CONFIG)
    return load_robot(folder / "robot.urdf")


def swung(seed: int, late: int, disturbance: float) -> Recording:
    """A soft position loop (3 Hz, critically damped) on a slow sine, its commands so many samples late."""
    rng, dt = np.random.default_rng(seed), 1.0 / RATE
    count, natural = int(SECONDS * RATE), 2.0 * np.pi * 3.0
    keep = np.exp(-2.0 * np.pi * 10.0 * dt)
    pushes = disturbance * lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(count))
    t = np.arange(count) * dt
    wanted, speed = 0.8 * np.sin(0.6 * np.pi * t), 0.48 * np.pi * np.cos(0.6 * np.pi * t)
    q, v, position, asked = 0.0, 0.0, np.zeros(count), np.zeros(count)
    for k in range(count):
        position[k] = q
        asked[k] = INERTIA * (natural**2 * (wanted[k] - q) + 2.0 * natural * (speed[k] - v))
        acts = asked[k - late] if k >= late else 0.0
        rubs = VISCOUS * v + COULOMB * np.tanh(v / 0.005)
        v += dt * (acts + pushes[k] - rubs + WEIGHT * np.sin(q)) / INERTIA
        q += dt * v
    q = position + 1e-6 * rng.standard_normal(count)
    return Recording("log.csv", ("pin",), t, q[:, None], asked[:, None])


@pytest.mark.parametrize("seed", by_night([1, 2], 0))
def test_what_a_disturbance_moves_is_neither_a_delay_nor_an_inertia(swing, seed):
    # Known truth: the model is exact. The damping of the loop answers the disturbance as a delay would. No sensor shows
    # what moves the joint, and its spectrum falls as that of a noisy drive behind a lag.
    found = diagnose(swing, (swung(seed, 0, 0.02),))
    assert (found.verdict, found.findings) == ("not_testable", ())


def test_a_delay_that_shows_above_the_noise_is_found(swing):
    # Known truth: 20 ms, and a fifth of the disturbance.
    found = diagnose(swing, (swung(1, 20, 0.004),))
    (delay,) = found.findings
    assert delay.effect in ("input_delay", "actuator_lag")
    assert next(iter(delay.parameters.values())).value == pytest.approx(0.02, abs=0.005)


def test_a_torque_is_loud_up_to_where_its_power_falls_below_thirty_times_the_noise():
    # Closed form: white noise of 1 and, below 5 Hz, of 100 times its power, which a steep low pass ends.
    rng, rate, count = np.random.default_rng(3), 100.0, 60_000
    spectrum = np.fft.rfft(10.0 * rng.standard_normal(count))
    spectrum[np.fft.rfftfreq(count, 1.0 / rate) > 5.0] = 0.0
    edge = _strong_up_to(rng.standard_normal(count), np.fft.irfft(spectrum, count), rate)
    assert edge == pytest.approx(5.0, abs=2 * rate / 256)


def test_a_torque_far_above_the_noise_everywhere_is_loud_everywhere():
    x = np.random.default_rng(4).standard_normal(4000)
    assert _strong_up_to(0.1 * x, x, 100.0) == np.inf


def test_a_loud_search_judges_its_few_effects_as_one_of_all_columns_does(quiet, monkeypatch):
    # Oracle: the search below the same frequencies with the columns of all rivals.
    asked = frozenset([quiet.term("coulomb_friction", "elbow"), quiet.term("rotor_inertia", "shoulder")])
    seen = []

    def spied(search, columns, noise, edges):
        seen.append(edges)
        return search_below(search, columns, noise, edges)

    monkeypatch.setattr("identification.diagnosis.judge.strong_motion.search_below", spied)
    loud, there = strong_motion_search(quiet.search, frozenset(), asked, quiet.noise)
    every = search_below(quiet.search, quiet.columns, quiet.noise, *seen)
    assert there.keys() == asked
    assert len(loud.problem.columns.names) < len(quiet.columns.names) / 2
    for chosen in (frozenset(), *(frozenset([term]) for term in asked), asked):
        few = frozenset(there[term] for term in chosen)
        assert loud.score(few) == pytest.approx(every.score(chosen), rel=1e-9)
        assert loud.price_of(few) == every.price_of(chosen)


def test_no_joint_within_its_floor_has_noise_that_is_foreseen(quiet):
    # By hand: 0.9 and 1.9 are left where 1 and 2 are allowed.
    judged = JudgedBand(quiet.problem, np.array([0.8, 1.8]), np.array([1.0, 2.0]))
    left = np.array([0.9, 1.9])
    np.testing.assert_array_equal(predictable_noise(judged, quiet.search, frozenset(), quiet.noise, left), [0.0, 0.0])


@pytest.mark.parametrize(
    ("over", "has_structure", "floor", "loudest", "shown"),
    [
        (0.9, False, 0.01, 1e3, False),
        (1.1, False, 0.01, 1e3, True),
        (0.9, True, 0.01, 1e3, True),
        (0.9, False, 0.01, 0.01, True),
        (0.9, False, 1e-9, 0.01, False),
    ],
)
def test_an_inertia_that_noise_may_imitate_is_shown_where_there_would_be_a_gap_without_it(
    lab, planar2, over, has_structure, floor, loudest, shown
):
    # By hand: what is left without it is just below or above what is allowed, or has structure; or the noise may not be
    # as loud as what it gains. Then nothing but noise is left with it.
    motion = lab.motion(2)
    effect = lab.acting(planar2, motion, "rotor_inertia", "elbow", 0.2)
    made = lab.prepared(planar2, (lab.recording(planar2, motion, effect),))
    chosen = frozenset([made.term("rotor_inertia", "elbow")])
    judged = JudgedBand(made.problem, np.full(2, floor), np.full(2, loudest))
    residuals = Residuals(lambda _: judged, lambda *_: np.full(2, over), lambda *_: has_structure)
    after = _noise_gate(GateContext(made.search, made.search, made.noise, residuals), LoopState.of(chosen))
    assert after.shown == (chosen if shown else frozenset())


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("rotor_inertia", True),
        ("coulomb_friction", False),
        ("transmission_compliance", True),
        ("encoder_eccentricity", False),
        ("presliding_friction", True),
        ("backlash", True),
    ],
)
def test_noise_may_imitate_what_shows_in_the_acceleration_or_at_reversals(quiet, name, made):
    assert noise_may_imitate(quiet.term(name, "elbow")) is made


def test_claims_of_a_loud_search_are_measured_by_what_is_left_in_its_band(quiet):
    # By hand: the whole loss of the tolerance parameters alone less one for each sample, whatever another band has.
    wide = replace(quiet.search, gaps=RowGaps(np.full(2, 1e9), np.full(2, 1e9)))
    loud, _ = strong_motion_search(wide, frozenset(), frozenset([quiet.term("coulomb_friction", "elbow")]), quiet.noise)
    left = loud.held_out_fit(frozenset()).row_losses
    counts = [row.count.sum() for row in loud.problem.grams.rows]
    np.testing.assert_allclose(loud.gaps.gap, np.maximum(left - counts, 0.0), rtol=1e-9)
    assert np.all(loud.gaps.accuracy < 1e9)
