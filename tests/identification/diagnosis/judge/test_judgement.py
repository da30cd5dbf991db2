"""What a judgement puts together. Oracle: by hand on made-up sums, joints and recordings.

Figures of each joint, and changes within tolerance that end at their limits. Oracle: closed forms.

The judged band: its noise floor, what is visible above it, and fits in it. Oracle: closed forms and known truths.

The ledger of a diagnosis. Known truth: friction on the elbow; oracles: the findings, and what they close.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from identification.diagnosis.columns.column_variants import with_wider_band
from identification.diagnosis.fit.gap import ResidualSums, RowGaps
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge import judgement
from identification.diagnosis.judge.floors import Floor
from identification.diagnosis.judge.judged_band import JudgedBand, plain_search
from identification.diagnosis.judge.judgement import (
    _with_joint,
    _with_times,
    _without_rounding,
    joint_gaps,
    with_hidden_payload,
)
from identification.diagnosis.judge.regimes import regime_split
from identification.diagnosis.judge.shares import closed_together
from identification.diagnosis.judge.verdict import hidden_change
from identification.diagnosis.noise.noise_floor import noise_floor, weights_of
from identification.diagnosis.result import Adjusted, Burst, Diagnosis, EffectAt, Hidden, JointGap, Unexplained
from identification.gates import ORDER
from identification.pipeline import diagnose

CLEAN = Unexplained(0.2, False, None, None)
HERE = Unexplained(0.2, True, "shoulder", "posture")


def test_coarse_readings_take_their_mean_square_off_each_block_and_no_more_than_is_there():
    found = ResidualSums(np.array([[8.0, 5.0], [3.0, 9.0]]), np.array([[10.0, 20.0], [30.0, 40.0]]))
    left = _without_rounding(found, np.array([0.2, 0.1]))
    np.testing.assert_allclose(left.squares, [[6.0, 3.0], [0.0, 5.0]])
    np.testing.assert_array_equal(left.counts, found.counts)


def joint(name: str, after: float, floor: float, high: float) -> JointGap:
    return JointGap(name, "N m", 9.0, after, floor, 100, noise_floor_interval=(0.5 * floor, high))


@pytest.mark.parametrize(
    ("after", "expected"),
    # By hand: residuals over upper ends of floors of 1 and 4.
    [((1.5, 5.0), "shoulder"), ((1.2, 5.0), "elbow"), ((1.0, 4.0), None), ((0.5, 4.1), "elbow")],
)
def test_what_is_left_is_located_on_the_joint_furthest_above_its_floor(quiet, after, expected):
    joints = (joint("shoulder", after[0], 0.9, 1.0), joint("elbow", after[1], 3.0, 4.0))
    residual = quiet.columns.residual
    found = _with_joint(CLEAN, quiet.problem, residual, joints)
    row = None if expected is None else ("shoulder", "elbow").index(expected)
    regime = None if row is None else regime_split(quiet.problem, residual, row).best
    assert found == replace(CLEAN, joint=expected, regime=regime)


def test_a_structure_that_is_located_stays_where_it_is(quiet):
    joints = (joint("shoulder", 1.0, 0.9, 1.0), joint("elbow", 9.0, 3.0, 4.0))
    assert _with_joint(HERE, quiet.problem, quiet.columns.residual, joints) is HERE


def test_events_say_their_times_and_where_the_largest_is():
    bursts = (Burst("a", "elbow", 1.0, 1.5, 9.0, 7.0), Burst("a", "wrist", 3.0, 3.2, 1.0, 8.0))
    times = ((1.0, 1.5), (3.0, 3.2))
    assert _with_times(CLEAN, bursts) == replace(CLEAN, joint="wrist", times=times)
    assert _with_times(HERE, bursts) == replace(HERE, times=times)
    assert _with_times(CLEAN, ()) is CLEAN


def alike(rms: tuple[float, float], counts: tuple[float, float] = (64.0, 16.0)) -> ResidualSums:
    """Residuals of this size in four blocks of so many samples of each joint."""
    every = np.tile(counts, (4, 1))
    return ResidualSums(np.square(rms) * every, every)


@pytest.mark.parametrize(("within", "closed"), [(0.25, None), (0.5, (0.25 - 0.015625) / (0.25 - 0.0625))])
def test_a_joint_has_a_gap_from_above_the_upper_end_of_its_floor(quiet, within, closed):
    # By hand: floors of a quarter and their ends; all squares are powers of two.
    floor = Floor(np.array([0.25, 0.5]), np.array([0.125, 0.5]), np.array([0.25, 1.0]), ("above_band", "predictors"))
    first, second = joint_gaps(quiet.problem, floor, alike((1.0, 2.0)), alike((within, 1.0)), alike((0.125, 0.5)))
    assert first.closed == (None if closed is None else pytest.approx(closed))
    assert second.closed is None
    assert (first.noise_floor, second.noise_floor) == (0.25, 0.5)
    assert (first.hold_out_samples, second.hold_out_samples) == (256, 64)
    assert (second.rms_before, second.rms_within_tolerance, second.rms_after) == (2.0, 1.0, 0.5)
    assert second.noise_floor_interval == (0.5, 1.0)
    assert (first.noise_floor_source, second.noise_floor_source) == ("above_band", "predictors")
    assert (first.unit, first.joint, second.joint) == ("N m", "shoulder", "elbow")


@pytest.mark.parametrize(
    ("source", "read_by", "predictable", "share"),
    [
        ("sensors", "command", False, 0.025),
        ("sensors", "command", True, 0.0),
        ("sensors", "sensor", False, 0.0),
        ("repetitions", "command", False, 0.0),
    ],
)
def test_noise_may_be_as_loud_as_drives_are_where_sensors_alone_show_it(quiet, source, read_by, predictable, share):
    # By hand: the upper end is a share of the measured torque, or what was read where that is more.
    session = replace(quiet.session, robot=replace(quiet.session.robot, torque_source=read_by))
    problem = replace(quiet.problem, session=session)
    loud = 1e3 * np.ones(2)
    for high, floor in ((1e-9, np.full(2, 1e-9)), (1e3, loud)):
        found = Floor(floor, floor, floor, (source,) * 2)
        left = alike((1.0, 1.0))
        for gap in joint_gaps(problem, found, left, left, left, predictable=predictable):
            assert gap.noise_floor_interval == (high, pytest.approx(max(high, share * gap.rms_torque)))


def test_the_measured_torque_of_a_joint_is_what_the_model_needs_and_what_it_leaves(quiet):
    columns = quiet.columns
    problem = replace(quiet.problem, session=replace(quiet.session, cutoff_hz=1e3))
    floor = Floor(np.ones(2), np.ones(2), np.ones(2), ("predictors",) * 2)
    gaps = joint_gaps(problem, floor, alike((1.0, 1.0)), alike((1.0, 1.0)), alike((1.0, 1.0)))
    use = np.concatenate([np.arange(block.core, block.stop) for block in quiet.blocks])
    torque = (columns.model_torque[0] + columns.residual[0])[use]
    assert [gap.rms_torque for gap in gaps] == pytest.approx(np.sqrt(np.mean(torque**2, axis=0)))


@pytest.mark.parametrize(
    ("above", "endless", "searched"), [(True, False, True), (False, False, False), (True, True, False)]
)
def test_what_the_judged_band_shows_is_looked_for_there_where_nothing_was_found(
    quiet, monkeypatch, above, endless, searched
):
    # By hand: the search has come to an end without an effect, and finds an offset in the judged band if more than
    # noise is left there.
    offset, asked = frozenset([quiet.term("torque_offset", "elbow")]), []

    def shown(context, state):
        asked.append(state.found)
        return SimpleNamespace(chosen=state.found)

    monkeypatch.setattr(judgement, "shown_effects", shown)
    monkeypatch.setattr(judgement, "after_motion_gate", lambda context, state: state)
    monkeypatch.setattr(judgement, "_residual_of", lambda *_: SimpleNamespace(judged=None))
    monkeypatch.setattr(judgement, "_with_predictable_noise", lambda left, *_: left)
    monkeypatch.setattr(judgement, "_above_noise", lambda left: above)
    monkeypatch.setattr(judgement, "_torque_over_noise", lambda left: 2.0)
    monkeypatch.setattr(judgement, "stepwise_search", lambda plain, progress: offset)
    judgement._shown_and_residual(
        SimpleNamespace(search=quiet.search, chosen=frozenset(), endless=endless), quiet.search, ()
    )
    assert asked == [offset if searched else frozenset()]


def test_nothing_is_shown_where_the_torque_is_within_its_noise(quiet, monkeypatch):
    # By hand: nine tenths of the noise.
    offset = quiet.term("torque_offset", "elbow")
    monkeypatch.setattr(judgement, "shown_effects", lambda context, state: SimpleNamespace(chosen=state.found))
    monkeypatch.setattr(judgement, "after_motion_gate", lambda context, state: state)
    monkeypatch.setattr(judgement, "replace", lambda left, **_: left)
    monkeypatch.setattr(judgement, "_residual_of", lambda *_: SimpleNamespace(judged=None, floor=None))
    monkeypatch.setattr(judgement, "_with_predictable_noise", lambda left, *_: left)
    monkeypatch.setattr(judgement, "_torque_over_noise", lambda left: 0.9)
    search = quiet.search
    shown, _ = judgement._shown_and_residual(SimpleNamespace(search=search, chosen=frozenset([offset])), search, ())
    assert shown.chosen == frozenset()
    (result,) = search.record.results_of(offset.effect_joint)
    assert (result.gate, result.value, result.needed, result.passed) == ("torque is there", 0.9, 1.0, False)


FLOOR = Floor(np.array([0.1, 0.2]), np.array([0.09, 0.18]), np.array([0.11, 0.22]), ("above_band", "predictors"))


def left(*rms: float, blocks: int = 4) -> ResidualSums:
    """Residuals of this size on the two joints, the same in every block of fifty samples."""
    counts = np.full((blocks, 2), 50.0)
    return ResidualSums(np.square(rms) * counts, counts)


def test_findings_close_together_what_they_take_off_the_loss_beyond_the_floor(quiet):
    # Losses 100 and 4 on one joint, 1 on the other: (50.5 - 2.5) / (50.5 - 1).
    judged = JudgedBand(quiet.problem, FLOOR.value, FLOOR.high)
    gap = closed_together(judged, left(1.0, 0.2), left(0.2, 0.2))
    assert gap.closed == pytest.approx(48.0 / 49.5)
    assert gap.interval == pytest.approx((48.0 / 49.5, 48.0 / 49.5))


def test_where_all_is_within_the_noise_there_is_nothing_to_close(quiet):
    gap = closed_together(JudgedBand(quiet.problem, FLOOR.value, FLOOR.high), left(0.105, 0.21), left(0.1, 0.2))
    assert (gap.closed, gap.interval) == (None, None)


def test_no_payload_hides_beside_free_inertial_parameters_of_the_body_that_would_carry_it(quiet):
    # Both have the same columns, so that they cannot be fitted together.
    search = quiet.search
    load = next(term for term in search.terms if term.effect.inertial == "point mass")
    bodies = [term for term in search.terms if term.effect.inertial == "free"]
    free = next(term for term in bodies if set(load.columns) <= set(term.columns))
    changes = (Adjusted("lower mass", -0.05, 0.05, at_limit=True, hides=Hidden("payload", 1e-3)),)
    assert with_hidden_payload(changes, search, frozenset({free})) == changes
    assert with_hidden_payload(changes, search, frozenset())[0].hides.size > 1e-3


@pytest.mark.parametrize(("body", "number"), [("upper", 1), ("lower", 2)])
def test_what_hides_behind_a_mass_is_its_tolerance_of_it(quiet, planar2, body, number):
    mass = next(one for one in quiet.columns.tolerance_parameters if one.name == f"{body} mass")
    kilograms = mass.bound * planar2.model.inertias[number].mass
    hidden = hidden_change(planar2, mass)
    assert (hidden.kind, hidden.size) == ("payload", pytest.approx(kilograms))


def unfiltered(problem: Problem) -> Problem:
    """The same problem where the judged band is all of the band, so that nothing is smoothed."""
    return replace(problem, session=replace(problem.session, cutoff_hz=1e3))


def test_the_floor_is_the_root_of_the_mean_square_of_usable_noise(quiet, rng):
    # Closed form over the samples that may be used; those that may not hold anything.
    problem = unfiltered(quiet.problem)
    use = np.ones_like(problem.columns.usable[0])
    use[::3] = False
    noise = np.where(use, rng.normal(size=use.shape) * [1.0, 5.0], 1e3)
    columns = replace(problem.columns, usable=(use,))
    expected = [np.sqrt(np.mean(noise[use[:, j], j] ** 2)) for j in range(2)]
    np.testing.assert_allclose(noise_floor(problem.session, columns, (noise,)), expected)


def test_without_any_noise_the_floor_is_a_millionth_of_the_torque(quiet):
    problem = unfiltered(quiet.problem)
    nothing = tuple(np.zeros_like(part) for part in quiet.noise)
    torque = np.outer(np.tile([1.0, 3.0], len(nothing[0]) // 2 + 1)[: len(nothing[0])], [2.0, 0.0])
    columns = replace(problem.columns, model_torque=(torque,))
    floor = noise_floor(problem.session, columns, nothing)
    assert floor == pytest.approx([1e-6 * torque[:, 0].std(), 1e-12])


def test_a_plain_search_keeps_thresholds_and_spurious_gains(rough):
    search = replace(rough.search, spurious={("payload", None): 7.0}, gaps=RowGaps(np.array([1.0, 2.0]), np.zeros(2)))
    plain = plain_search(search, rough.noise)
    assert plain.threshold == search.threshold
    assert plain.spurious == search.spurious
    assert plain.gaps is search.gaps


@pytest.mark.parametrize(("share", "smoothed"), [(0.5, True), (0.98, True), (0.995, False)])
def test_a_plain_search_fits_columns_and_residual_in_the_judged_band(rough, share, smoothed):
    # Columns that reach beyond the judged band, less what lies above it where it is narrower by a hundredth.
    session = rough.session
    session = replace(session, cutoff_hz=share * session.logs[0].band.cutoff_hz)
    search = replace(rough.search, problem=replace(rough.problem, session=session))
    plain = plain_search(search, rough.noise).problem
    columns = rough.columns
    assert (plain.white.residual[0] is not columns.residual[0]) is smoothed
    for name in ("residual", "model_torque"):
        np.testing.assert_allclose(getattr(plain.white, name)[0], session.in_judged_band(getattr(columns, name))[0])
    for narrow, wide in zip(plain.white.values[0], with_wider_band(session, columns).values[0], strict=True):
        np.testing.assert_allclose(narrow, session.log_in_judged_band(wide, 0))
    weights = weights_of(plain.white, session.in_judged_band(rough.noise))
    np.testing.assert_array_equal(plain.weights.per_sample, weights.per_sample)


def test_samples_at_standstill_hardly_count_in_plain_fits_and_in_the_noise_that_weighs_them(rough):
    # Known truth: the fit and the noise without what friction holds at standstill, in the first 40 % of the recording.
    session = replace(rough.session, cutoff_hz=rough.session.logs[0].band.cutoff_hz)
    columns = rough.columns
    still = (np.arange(len(columns.residual[0])) < 0.4 * len(columns.residual[0]))[:, None]
    held = np.where(still, 1e3 * rough.noise[0].std(axis=0), 0.0)

    def plain(residual, standing, noise):
        changed = replace(columns, residual=(residual,), standstill_std=(standing,))
        problem = replace(rough.problem, session=session, columns=changed)
        return plain_search(replace(rough.search, problem=problem), (noise,))

    without = plain(columns.residual[0], held, rough.noise[0])
    beside = plain(columns.residual[0] + 0.5 * held, held, rough.noise[0] + 0.5 * held)
    np.testing.assert_allclose(beside.problem.weights.floor, without.problem.weights.floor, rtol=0.1)
    theta, expected = (search.held_out_fit(frozenset()).theta for search in (beside, without))
    np.testing.assert_allclose(theta, expected, atol=0.1 * np.abs(expected).max())


FRICTION = EffectAt("coulomb_friction", "elbow")


@pytest.fixture(scope="module")
def rubbed(lab, planar2) -> Diagnosis:
    """The arm with 0.3 N m of friction on the elbow that its model lacks."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = -0.3 * np.sign(motion.v) * [0.0, 1.0]
    return diagnose(planar2, (lab.recording(planar2, motion, torque),))


def test_findings_are_what_is_claimed_and_minor_ones_what_is_minor(rubbed):
    for outcome, findings in (("claimed", rubbed.findings), ("minor", rubbed.minor)):
        claims = {claim.effects for claim in rubbed.ledger if claim.outcome == outcome}
        assert claims == {(EffectAt(one.effect, one.joint),) for one in findings}
    assert {(FRICTION,)} == {claim.effects for claim in rubbed.ledger if claim.outcome == "claimed"}


def test_what_is_claimed_has_passed_all_gates_and_what_is_not_has_failed_the_last(rubbed):
    for claim in rubbed.ledger:
        passed = [result.passed for result in claim.gates]
        assert passed == [True] * len(passed) if claim.outcome == "claimed" else passed[-1] is False
        assert all(passed[:-1])


def test_gates_stand_in_the_order_in_which_they_are_asked(rubbed):
    for claim in rubbed.ledger:
        places = [ORDER[result.gate] for result in claim.gates]
        assert places == sorted(places)


def test_no_effect_stands_in_the_ledger_twice(rubbed):
    effects = [claim.effects for claim in rubbed.ledger]
    assert len(effects) == len(set(effects))
    assert len(effects) >= 10


def test_a_law_that_resembles_what_is_named_is_displaced_by_it(rubbed):
    (viscous,) = [claim for claim in rubbed.ledger if claim.effects == (EffectAt("viscous_friction", "elbow"),)]
    assert (viscous.outcome, viscous.instead) == ("displaced", (FRICTION,))
    assert 0.0 < viscous.figures["closes"] < 1.0
    assert viscous.figures["floors_more"] > 0.5


def test_what_an_effect_closes_alone_is_what_the_single_finding_closes(rubbed):
    # Oracle: a single finding closes what is closed together.
    (claim,) = [one for one in rubbed.ledger if one.outcome == "claimed"]
    assert claim.figures["closes"] == pytest.approx(rubbed.gap.closed, rel=1e-5)


@pytest.fixture(scope="module")
def without_gap(lab, planar2) -> Diagnosis:
    return diagnose(planar2, (lab.recording(planar2, lab.motion(2, 4)),))


def test_on_a_robot_without_a_gap_nothing_is_claimed_and_every_refusal_names_its_gate(without_gap):
    assert without_gap.findings == ()
    assert {claim.outcome for claim in without_gap.ledger} == {"not_claimed"}
    assert all(claim.failed is not None for claim in without_gap.ledger)


def test_moves_that_leave_more_than_the_given_model_are_not_made(without_gap):
    # Known truth: the given model is right, so that changes within its tolerances fit noise.
    assert without_gap.adjusted == ()
    assert all(joint.rms_within_tolerance == joint.rms_before for joint in without_gap.joints)
