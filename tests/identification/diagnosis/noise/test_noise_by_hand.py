"""Sizes and shares of noise. Oracle: NumPy's correlation written out, least squares by hand on made-up series.

Errors of sound models. Oracle: the table's shares, by hand.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from identification.diagnosis.columns.motion.standstill import reversal_std
from identification.diagnosis.columns.session import session_of
from identification.diagnosis.decision_rules import ORDINARY_SHARE
from identification.diagnosis.noise.discrepancy import DRIVE_CLASSES, MOST_DRIVE_ERROR, discrepancy, slow_samples
from identification.diagnosis.noise.noise_floor import _plain_first, noise_without_remainder, smaller_noise, weights_of
from identification.diagnosis.noise.whitening import (
    autocovariance,
    filtered,
    noise_variance,
    prediction_filters,
    whitened,
    whitening_of,
)
from identification.engine.autocorrelation import autocorrelation_time
from identification.engine.products.grams import Weights
from identification.pipeline import diagnose
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_friction
from phantom_dyn.motion import Motion

PLACE = "identification.diagnosis.noise.noise_floor."


def law(*columns: int, named=True, inertial=None, follows="", scope="joint", shape=()) -> SimpleNamespace:
    """A rival of these columns; ``follows`` names what its columns are made of besides the motion."""
    kinds = ("follows_model", "follows_torque", "scales_joint")
    effect = SimpleNamespace(inertial=inertial, scope=scope, **{kind: kind == follows for kind in kinds})
    return SimpleNamespace(columns=columns, named=named, effect=effect, shape=shape)


@pytest.mark.parametrize(
    ("rival", "rung"),
    [
        (law(5), 0),
        (law(5, shape=(0.1,)), 2),
        (law(5, scope="pair", shape=(1.0,)), 0),
        (law(5, scope="pair", shape=(1.0,), follows="follows_model"), 2),
        (law(5, follows="follows_model"), 1),
        (law(5, follows="follows_torque"), 1),
        (law(5, follows="scales_joint"), 1),
        (law(5, follows="scales_joint", shape=(0.1,)), 2),
        (law(5, named=False), 2),
        (law(5, inertial="free"), 2),
        (law(5, inertial="point mass"), 2),
    ],
)
def test_the_ladder_goes_from_laws_of_the_motion_over_moves_and_other_laws_to_all_the_rest(rival, rung):
    # By hand: columns 0 and 1 are tolerance parameters, 2 and 3 of a law of the motion, 4 of nothing that is known.
    columns = SimpleNamespace(
        tolerance_parameters=("a", "b"), terms=(law(2, 3), rival), rows=((0, 1, 9), (4, 5, 3, 1, 2, 0))
    )
    order, ends = _plain_first(columns, 1)
    steps = {0: [1, 2, 4, 3, 5, 0], 1: [2, 4, 1, 3, 5, 0], 2: [2, 4, 3, 5, 0, 1]}
    assert list(order) == steps[rung]
    assert ends == {0: (3, 5), 1: (2, 5), 2: (2, 4)}[rung]
    assert _plain_first(columns, 0)[1] == (0, 2)


def two_logs(quiet, **changes):
    """Columns of two logs of unequal length, thirty and ten samples, all usable."""
    shapes = ((30, 2), (10, 2))
    given = {"usable": tuple(np.ones(shape, dtype=bool) for shape in shapes)}
    given |= {
        name: tuple(np.zeros(shape) for shape in shapes) for name in ("model_torque", "residual", "standstill_std")
    }
    return replace(quiet.columns, **(given | changes))


def test_weights_are_of_the_size_of_usable_noise_and_of_its_mean_colour(quiet, rng):
    use = (np.arange(60).reshape(30, 2) % 5 != 0, np.ones((10, 2), dtype=bool))
    noise = tuple(np.where(u, np.cumsum(rng.normal(size=u.shape), axis=0), 77.0) * [1.0, 4.0] for u in use)
    weights = weights_of(two_logs(quiet, usable=use), noise)
    for j in range(2):
        parts = [e[u[:, j], j] for e, u in zip(noise, use, strict=True)]
        assert weights.floor[j] == pytest.approx(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
        assert weights.spread[j] == pytest.approx(np.mean([autocorrelation_time(part) for part in parts]))


def test_a_noise_is_a_millionth_of_the_deviation_of_the_torque_over_all_logs(quiet):
    # By hand: 30 samples of 3 and 10 of -1 about 2 deviate by the root of 3; where no torque is, by next to nothing.
    torque = tuple(size * np.ones((count, 2)) * [1.0, 0.0] for size, count in ((3.0, 30), (-1.0, 10)))
    nothing = tuple(np.zeros((count, 2)) for count in (30, 10))
    weights = weights_of(two_logs(quiet, model_torque=torque), nothing)
    np.testing.assert_allclose(weights.floor, [1e-6 * np.sqrt(3.0), 1e-18])
    np.testing.assert_array_equal(weights.spread, 1.0)


@pytest.fixture
def leaving(quiet, monkeypatch):
    """A search of two logs whose effects leave a given residual, or make a given torque."""

    def search(columns, residual=None, torque=None, weights=None):
        monkeypatch.setattr(PLACE + "residual_after", lambda *_: residual)
        monkeypatch.setattr(PLACE + "held_out_torque", lambda _, chosen, found: (torque or {}).get(chosen))
        monkeypatch.setattr(PLACE + "whitening_of", lambda *_: SimpleNamespace(series=lambda series: series))
        problem = SimpleNamespace(columns=columns, white=columns, weights=weights)
        return SimpleNamespace(problem=problem, held_out_fit=lambda chosen: None)

    return search


def test_each_row_takes_what_an_explanation_leaves_where_that_is_less(quiet, leaving):
    # By hand: noise of 2 and 5; 1 and 6 are left of them, where samples are usable.
    use = (np.arange(60).reshape(30, 2) % 7 != 0, np.ones((10, 2), dtype=bool))
    left = tuple(np.where(u, [1.0, 6.0], 99.0) for u in use)
    noise = tuple(np.where(u, [2.0, 5.0], 0.0) for u in use)
    found, ratio = smaller_noise(leaving(two_logs(quiet, usable=use), left), frozenset(), noise)
    assert ratio == pytest.approx(0.5)
    for part, u in zip(found, use, strict=True):
        np.testing.assert_array_equal(part, np.where(u, [1.0, 5.0], 0.0))


@pytest.mark.parametrize(("sizes", "ratio"), [((1.0, 4.0), 0.5), ((1.9, 1.0), 0.2), ((0.0, 0.0), 1.0)])
def test_the_ratio_is_that_of_the_row_that_has_come_down_most(quiet, leaving, sizes, ratio):
    # By hand: noise of 2 and 5; a residual of exactly nothing is no noise.
    left, noise = (
        tuple(np.ones((count, 2)) * size for count in (30, 10)) for size in (np.array(sizes), np.array([2.0, 5.0]))
    )
    assert smaller_noise(leaving(two_logs(quiet), left), frozenset(), noise)[1] == pytest.approx(ratio)


def test_the_share_of_a_trace_is_that_of_least_squares_and_all_of_it_at_most(quiet, leaving, rng):
    # By hand: the noise holds 0.4 of the trace on one row and thrice of it on the other, besides what is across it.
    tried, chosen = frozenset({"friction"}), frozenset()
    trace = [rng.normal(size=(count, 2)) for count in (30, 10)]
    whole = np.concatenate(trace)
    across = rng.normal(size=whole.shape)
    across -= whole * (across * whole).sum(axis=0) / (whole**2).sum(axis=0)
    noise = np.split(across + whole * [0.4, 3.0], [30])
    torque = {tried: tuple(5.0 + part for part in trace), chosen: tuple(5.0 + 0.0 * part for part in trace)}
    weights = Weights(np.array([0.5, 2.0]), np.ones(2))
    search = leaving(two_logs(quiet), torque=torque, weights=weights)
    left, gain = noise_without_remainder(search, tried, chosen, tuple(noise))
    np.testing.assert_allclose(np.concatenate(left), across + whole * [0.0, 2.0], atol=1e-9)
    # What the weighted square has come down by.
    taken = (across + whole * [0.4, 3.0]) ** 2 - np.concatenate(left) ** 2
    assert gain == pytest.approx(float(taken.sum(axis=0) @ weights.per_sample))


@pytest.mark.parametrize("shares", [(-0.4, 0.3), (0.3, -0.4), (-0.4, -0.3)])
def test_a_row_with_the_opposite_of_a_trace_stays_and_others_do_not(leaving, quiet, rng, shares):
    tried, chosen = frozenset({"friction"}), frozenset()
    trace = tuple(rng.normal(size=(count, 2)) for count in (30, 10))
    torque = {tried: trace, chosen: tuple(0.0 * part for part in trace)}
    search = leaving(two_logs(quiet), torque=torque, weights=Weights(np.ones(2), np.ones(2)))
    left, gain = noise_without_remainder(search, tried, chosen, tuple(part * shares for part in trace))
    for part, own in zip(left, trace, strict=True):
        np.testing.assert_allclose(part, own * np.minimum(shares, 0.0), atol=1e-12)
    assert bool(gain > 0) is (max(shares) > 0)


@pytest.fixture
def session(lab, planar2):
    return session_of(planar2, (lab.recording(planar2, lab.motion(2, seconds=20.0)),))


def found(session, torque, **changes):
    robot = replace(session.robot, **changes)
    counts = tuple(np.ones((len(log.samples), 2)) for log in session.logs)
    return discrepancy(replace(session, robot=robot), counts, np.array(torque))


def test_it_is_never_less_than_the_share_of_the_torque(session):
    torque = np.array([2.0, 10.0])
    assert np.all(found(session, torque) >= DRIVE_CLASSES["command"].torque_error * torque - 1e-15)


def test_it_is_never_more_than_the_most(session):
    # By hand: friction of newton metres beside a torque of milli newton metres.
    small = np.array([1e-3, 1e-3])
    robot = with_friction(session.robot, session.robot.joint_names[0], viscous=0.0, coulomb=5.0)
    rubbing = replace(session, robot=robot)
    assert found(rubbing, small)[0] == pytest.approx(MOST_DRIVE_ERROR * 1e-3)


def test_friction_at_reversals_adds_to_it(session):
    torque = np.array([20.0, 20.0])
    robot = with_friction(session.robot, session.robot.joint_names[0], viscous=0.0, coulomb=2.0)
    more = found(replace(session, robot=robot), torque)
    assert more[0] > found(session, torque)[0]
    assert more[1] == found(session, torque)[1]


def test_a_torque_sensor_allows_less(session):
    torque = np.array([2.0, 10.0])
    assert np.all(found(session, torque, torque_source="sensor") < found(session, torque))


def test_the_error_that_another_recording_has_shown_adds_by_its_share_of_time(session):
    # Closed form: 0.03 N m in the slow samples of the first joint and 0.01 elsewhere.
    torque = np.array([20.0, 20.0])
    plain = found(session, torque)
    error = found(session, torque, model_error=np.array([[0.03, 0.01], [0.0, 0.0]]))
    slow = np.concatenate([slow_samples(session, k)[log.samples] for k, log in enumerate(session.logs)])[:, 0]
    wanted = plain[0] ** 2 + slow.mean() * 0.03**2 + (1 - slow.mean()) * 0.01**2
    assert 0.0 < slow.mean() < 1.0
    assert error[0] ** 2 == pytest.approx(wanted, rel=1e-9)
    assert error[1] == plain[1]


def test_the_error_that_another_recording_has_shown_is_at_most_a_tenth_of_the_torque(session):
    torque = np.array([2.0, 2.0])
    error = found(session, torque, model_error=np.full((2, 2), 5.0))
    assert np.all(error <= np.hypot(found(session, torque), ORDINARY_SHARE * torque) + 1e-12)


def test_doubt_is_the_rate_of_modelled_coulomb_friction_times_five_milliseconds(lab, pendulum):
    # Closed form: T sign(v) jumps by 2 T at every reversal, between two samples; viscous friction does not count.
    robot = replace(pendulum, coulomb_friction=np.array([0.4]), viscous_friction=np.array([2.0]))
    motion = lab.motion(1)
    doubt = reversal_std(Operation.of(robot, motion))
    expected = 0.005 * np.gradient(0.4 * np.sign(motion.v), motion.t, axis=0)
    np.testing.assert_allclose(doubt, expected, atol=1e-9)


def test_a_model_without_coulomb_friction_is_not_doubted(lab, pendulum):
    robot = replace(pendulum, coulomb_friction=np.zeros(1), viscous_friction=np.array([2.0]))
    np.testing.assert_allclose(reversal_std(Operation.of(robot, lab.motion(1))), 0.0, atol=1e-12)


def test_samples_in_doubt_count_as_if_their_noise_were_larger_by_it(quiet, rng):
    # Brute force: each whitened sample times the share of noise in noise and doubt, of mean square one.
    columns = quiet.columns
    noise = (np.where(columns.usable[0], rng.normal(size=columns.residual[0].shape), 0.0),)
    doubt = (3.0 * rng.random(columns.residual[0].shape),)
    plain, _ = whitened(replace(columns, reversal_std=(np.zeros_like(doubt[0]),)), noise)
    white, _ = whitened(replace(columns, reversal_std=doubt), noise)
    for j in range(2):
        use = columns.usable[0][:, j]
        filters = prediction_filters(autocovariance([noise[0][:, j]]), use)
        variance = np.mean(filtered(filters, noise[0][:, j])[use] ** 2)
        share = variance / (variance + filtered(filters, doubt[0][:, j]) ** 2)
        expected = plain.residual[0][:, j] * np.sqrt(share / share[use].mean())
        np.testing.assert_allclose(white.residual[0][:, j], expected, rtol=1e-9)


def test_what_standing_joints_leave_open_counts_at_the_most_that_the_filter_makes_of_it(quiet, rng):
    # Brute force: the sum over the filter's weights without their signs.
    columns = quiet.columns
    noise = (np.where(columns.usable[0], rng.normal(size=columns.residual[0].shape), 0.0),)
    standing = (3.0 * rng.random(columns.residual[0].shape) * (rng.random(columns.residual[0].shape) < 0.2),)
    made = replace(columns, reversal_std=(np.zeros_like(standing[0]),), standstill_std=standing)
    white, _ = whitened(made, noise)
    for j, (filters,) in enumerate(whitening_of(made, noise).filters):
        use, own = columns.usable[0][:, j], noise[0][:, j]
        variance = noise_variance(made, [own], j, [filters])
        share = variance / (variance + filtered(np.abs(filters), standing[0][:, j]) ** 2)
        expected = filtered(filters, columns.residual[0][:, j]) * np.sqrt(share / share[use].mean())
        np.testing.assert_allclose(white.residual[0][:, j], expected, rtol=1e-9)


def test_columns_and_noise_count_as_the_residual_does(quiet, rng):
    columns = quiet.columns
    noise = (np.where(columns.usable[0], rng.normal(size=columns.residual[0].shape), 0.0),)
    doubted = replace(columns, reversal_std=(rng.random(columns.residual[0].shape),), residual=noise)
    same = tuple(tuple(np.repeat(noise[0][:, [j]], 2, axis=1) for j in range(2)) for _ in range(1))
    white, white_noise = whitened(replace(doubted, values=same), noise)
    np.testing.assert_allclose(white.residual[0], white_noise[0])
    np.testing.assert_allclose(white.values[0][1][:, 1], white_noise[0][:, 1])
    np.testing.assert_allclose(whitening_of(doubted, noise).series(noise)[0], white_noise[0])


def test_friction_that_passes_through_zero_two_milliseconds_late_is_no_certain_finding(lab, pendulum):
    # Known truth: nothing but the modelled friction, in steps that come later; noise of a hundredth of it.
    robot = replace(pendulum, coulomb_friction=np.array([0.5]))
    motion = lab.motion(1, 1, seconds=20.0, rate=500.0)
    late = lab.motion(1, 1, seconds=20.0, rate=500.0, ahead=-0.002)
    torque = 0.5 * (np.sign(motion.v) - np.sign(late.v))
    recording = replace(lab.recording(robot, motion, torque, noise=0.005), q=motion.q)
    for finding in diagnose(robot, (recording,)).findings:
        # The lateness that it is has to be among its rivals, and about as likely.
        assert finding.probability < 0.6
        assert any(one.effect == "input_delay" for rival in finding.rivals for one in rival.effects)


def test_a_drive_that_is_late_is_still_found_beside_modelled_friction(lab, pendulum):
    # Known truth: all of the torque ten milliseconds late.
    robot = replace(pendulum, coulomb_friction=np.array([0.5]))
    motion = lab.motion(1, seconds=20.0, rate=500.0)
    late = lab.motion(1, seconds=20.0, rate=500.0, ahead=0.010)
    recording = lab.recording(robot, motion, noise=0.02)
    asked = lab.recording(robot, Motion(motion.t, late.q, late.v, late.a), noise=0.02).tau
    (found,) = diagnose(robot, (replace(recording, tau=asked),)).findings
    # Below 1.5 Hz a lag of ten milliseconds leaves nearly the same torque: both may be listed, and nothing else.
    names = {found.effect, *(one.effect for rival in found.rivals for one in rival.effects)}
    assert "input_delay" in names <= {"input_delay", "actuator_lag"}
