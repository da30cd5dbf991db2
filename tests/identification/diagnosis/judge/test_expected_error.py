"""Expected size of a residual. Oracle: known truth, normal numbers of a known deviation at each sample.

Findings of coarse readings. Oracle: closed forms on squares written out by hand.
"""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fit.gap import ResidualSums
from identification.diagnosis.judge.bursts import Causes, _variance, expected_error, moving_torque
from identification.diagnosis.judge.coarse_encoders import CoarseRounding, coarse_findings, coarse_rounding
from identification.diagnosis.noise.encoder_noise import CoarseJoint
from identification.gates.coarse_reading import coarser_than_stated

N = 4000
FOLD = np.arange(N) * 8 // N
ALL = np.ones(N, dtype=bool)
QUIET = np.zeros(N)
NEVER = np.zeros(N, dtype=bool)
TORQUE = 3.0 * (1 + np.sin(np.arange(N) / 37.0))


def drawn(variance: np.ndarray) -> np.ndarray:
    return np.sqrt(variance) * np.random.default_rng(1).standard_normal(N)


def test_noise_alone_is_expected_everywhere():
    expected = expected_error(drawn(np.full(N, 0.04)), Causes(QUIET, QUIET, NEVER), ALL, FOLD)
    np.testing.assert_allclose(expected, 0.2, rtol=0.08)


def test_a_share_of_the_torque_is_read_off_the_residual():
    variance = 0.01**2 + (0.02 * TORQUE) ** 2
    expected = expected_error(drawn(variance), Causes(QUIET, TORQUE**2, NEVER), ALL, FOLD)
    high = TORQUE > 4
    np.testing.assert_allclose(expected[high], np.sqrt(variance)[high], rtol=0.35)


def test_a_model_is_wrong_by_a_thousandth_of_unusual_torques_at_least():
    # By hand: 3000 N m are usual, so of 6000 N m it is the thousandth of what that is more, in squares.
    torque = np.where(np.arange(N) % 100 < 20, 6000.0, 3000.0)
    expected = expected_error(drawn(np.full(N, 1e-12)), Causes(QUIET, torque**2, NEVER), ALL, FOLD)
    np.testing.assert_allclose(expected[torque > 5000], np.sqrt(6.0**2 - 3.0**2), rtol=1e-3)


def test_events_are_not_taken_for_an_error_that_grows_with_the_torque():
    # A fifth of the samples is off by fifteen deviations, whatever the torque is.
    residual = drawn(np.ones(N)) + 15.0 * (np.random.default_rng(5).random(N) < 0.2)
    expected = expected_error(residual, Causes(QUIET, (10 * TORQUE) ** 2, NEVER), ALL, FOLD)
    assert np.all(expected < 3.0)


def test_what_reversals_leave_is_expected_at_the_next_one():
    reversals = np.arange(N) % 200 < 10
    residual = drawn(np.where(reversals, 25.0, 1.0))
    expected = expected_error(residual, Causes(QUIET, QUIET, reversals), ALL, FOLD)
    assert np.median(expected[reversals]) == pytest.approx(5.0, rel=0.35)
    assert np.median(expected[~reversals]) == pytest.approx(1.0, rel=0.1)


def test_what_is_known_beforehand_is_added():
    known = np.where(np.arange(N) % 500 < 20, 100.0, 0.0)
    expected = expected_error(drawn(np.ones(N)), Causes(known, QUIET, NEVER), ALL, FOLD)
    np.testing.assert_allclose(expected[known > 0], np.sqrt(101.0), rtol=0.01)


def test_an_event_does_not_make_what_is_expected_of_it():
    # A push at the only moment of large torque: no other fold shows that torque, so nothing speaks for an error there.
    torque = np.where((np.arange(N) > 2010) & (np.arange(N) < 2100), 5.0, 1.0)
    residual = drawn(np.ones(N)) + 40.0 * (torque > 2)
    expected = expected_error(residual, Causes(QUIET, torque**2, NEVER), ALL, FOLD)
    assert np.all(expected[torque > 2] < 4.0)


def test_events_in_a_fifth_of_the_time_hardly_raise_it():
    residual = drawn(np.ones(N)) + 15.0 * (np.arange(N) % 500 < 100)
    expected = expected_error(residual, Causes(QUIET, QUIET, NEVER), ALL, FOLD)
    assert np.all(expected < 1.4)


def test_samples_that_may_not_be_used_say_nothing():
    use = np.arange(N) % 2 == 0
    residual = np.where(use, drawn(np.ones(N)), 1e6)
    assert np.all(expected_error(residual, Causes(QUIET, QUIET, NEVER), use, FOLD) < 1.2)


def test_the_moving_torque_is_about_its_median_and_holds_its_peaks():
    # Closed form: a sine of 2 N m at half the edge of the band, about 7 N m: its change has half its size.
    t = np.arange(0, 10, 0.01)
    moving = moving_torque(7 + 2 * np.sin(2 * np.pi * 2.5 * t), 100.0, 5.0)
    inside = slice(50, -50)
    np.testing.assert_allclose(moving[inside], 4.0, rtol=0.02)
    assert not moving_torque(np.full(500, 7.0), 100.0, 5.0).any()


def split(count: int, many: int, others: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals of a first fold of so many samples of one, and of a second fold with another size."""
    fold = (np.arange(count) < many).astype(int)
    return np.where(fold == 1, 1.0, others), np.ones(count, dtype=bool), fold


@pytest.mark.parametrize(("samples", "other"), [(19, 1.0), (20, 5.0)])
def test_twenty_samples_of_other_folds_are_enough_to_judge_by(samples, other):
    # Closed form: noise is the median square over that of a normal number; with fewer all samples judge, most are one.
    residual, use, fold = split(200 + samples, 200, 5.0)
    none = np.zeros(len(residual))
    found = expected_error(residual, Causes(none, none, none > 0), use, fold)
    np.testing.assert_allclose(found[:200], other / np.sqrt(0.4549), rtol=0.02)
    np.testing.assert_allclose(found[200:], 1.0 / np.sqrt(0.4549), rtol=0.02)


@pytest.mark.parametrize(("calm", "noise"), [(19, 3.0), (20, 1.0)])
def test_twenty_calm_samples_are_enough_to_read_the_noise(calm, noise):
    # By hand: calm are samples up to the median of both causes; half of them has much torque, nearly the others much
    # doubt.
    torque = np.repeat([0.0, 10.0], 100)
    known = np.concatenate([np.zeros(calm), np.full(100 - calm, 7.0), np.zeros(100)])
    residual = np.where(torque + known > 0, 3.0, 1.0)
    found = _variance(residual, Causes(known, torque, torque < 0), np.ones(200, dtype=bool))
    assert found[0] == pytest.approx(noise**2 / 0.4549, rel=0.02)


def test_samples_with_the_usual_torque_and_doubt_are_calm():
    # By hand: the same torque and doubt everywhere; only the samples that may be used count.
    residual = np.where(np.arange(100) < 60, 2.0, 9.0)
    causes = Causes(np.full(100, 5.0), np.full(100, 4.0), np.zeros(100, dtype=bool))
    found = _variance(residual, causes, np.arange(100) < 60)
    np.testing.assert_allclose(found, 4.0 / 0.4549 + 5.0, rtol=0.02)


FLOOR = np.array([0.1, 0.2])


def coarse_elbow(*torque: np.ndarray) -> CoarseJoint:
    return CoarseJoint(1, 2e-3, torque, torque, coarser_than_stated(2.0))


def found(energy: list[float], gap: float, samples: float = 400.0):
    """The finding of a coarse elbow whose rounding has this mean square, where the given model has so much of noise."""
    before = ResidualSums(np.outer([samples], gap * FLOOR**2), np.full((1, 2), samples))
    return before, CoarseRounding((coarse_elbow(),), np.array([energy]))


def test_the_energies_of_several_coarse_joints_add():
    both = CoarseRounding((coarse_elbow(), coarse_elbow()), np.array([[0.1, 0.2], [0.3, 0.4]]))
    np.testing.assert_allclose(both.total, [0.4, 0.6])


def test_what_rounding_closes_is_its_share_of_the_gap(planar2):
    # By hand: (0.005 / 0.01 + 0.02 / 0.04) / 2 = 0.5 of a gap of 5 - 1 = 4.
    before, rounding = found([0.005, 0.02], 5.0)
    (finding,) = coarse_findings(planar2, rounding, before, FLOOR)
    assert (finding.effect, finding.joint) == ("encoder_quantization", "elbow")
    assert finding.gap_closed == pytest.approx(0.125)
    # Known to twice the root of one over the 400 samples of a joint.
    assert finding.gap_closed_interval == pytest.approx((0.125 * 0.9, 0.125 * 1.1))


def test_rounding_closes_no_more_than_the_whole_gap(planar2):
    before, rounding = found([0.02, 0.08], 1.5)
    (finding,) = coarse_findings(planar2, rounding, before, FLOOR)
    assert finding.gap_closed == 1.0
    assert finding.gap_closed_interval == pytest.approx((0.9, 1.0))


def test_the_step_is_known_to_a_hundredth_of_itself(planar2):
    before, rounding = found([0.005, 0.02], 5.0)
    step = coarse_findings(planar2, rounding, before, FLOOR)[0].parameters["step"]
    assert (step.value, step.unit) == (2e-3, "rad")
    assert step.std == pytest.approx(2e-5)


@pytest.mark.parametrize(("share", "kept"), [(0.02, 0), (0.2, 1)])
def test_a_coarse_reading_counts_where_it_makes_a_twentieth_of_the_noise(quiet, share, kept):
    # Known truth: of the noise that the recording has, a share of its square on the elbow and nothing on the shoulder.
    torque = tuple(np.sqrt(share) * part * [0.0, 1.0] for part in quiet.noise)
    floor = np.array([1e6, 1e6])
    rounding = coarse_rounding(quiet.problem, (coarse_elbow(*torque),), floor, quiet.noise)
    assert len(rounding.coarse) == kept
    assert rounding.energy.shape == (kept, 2)


def test_a_coarse_reading_counts_by_what_an_ordinary_low_pass_leaves_of_it(quiet):
    # Known truth: the lowered low pass of this joint has taken all of its rounding away.
    nothing, one = (tuple(size * np.ones_like(part) * [0.0, 1.0] for part in quiet.noise) for size in (0.0, 1.0))
    loud = tuple(1e6 * np.ones_like(part) for part in quiet.noise)
    coarse = replace(coarse_elbow(*nothing), usual_low_pass=one)
    found = coarse_rounding(quiet.problem, (coarse,), np.ones(2), loud)
    assert found.coarse == (coarse,)
    np.testing.assert_array_equal(found.total, 0.0)


def test_a_coarse_reading_counts_where_it_makes_a_twentieth_of_the_floor(quiet):
    # Known truth: a spurious torque of one on the elbow in every sample, far below the noise above the judged band.
    one = tuple(np.ones_like(part) * [0.0, 1.0] for part in quiet.noise)
    loud = tuple(1e6 * np.ones_like(part) for part in quiet.noise)
    for square, kept in ((19.0, 1), (21.0, 0)):
        rounding = coarse_rounding(quiet.problem, (coarse_elbow(*one),), np.array([1e9, np.sqrt(square)]), loud)
        assert len(rounding.coarse) == kept
        np.testing.assert_allclose(rounding.energy, np.array([[0.0, 1.0]])[:kept], atol=1e-9)


def test_of_several_coarse_readings_those_that_matter_are_kept(quiet):
    one, less = (tuple(size * np.ones_like(part) for part in quiet.noise) for size in (1.0, 1e-3))
    loud = tuple(1e6 * np.ones_like(part) for part in quiet.noise)
    joints = (coarse_elbow(*less), coarse_elbow(*one), coarse_elbow(*less))
    assert coarse_rounding(quiet.problem, joints, np.ones(2), loud).coarse == joints[1:2]


def test_what_a_few_samples_say_of_rounding_is_not_below_zero(planar2):
    # Closed form: of one sample the share is known to twice itself; of none it is taken as one.
    for samples in (1.0, 0.25):
        before, rounding = found([0.005, 0.02], 5.0, samples)
        (finding,) = coarse_findings(planar2, rounding, before, FLOOR)
        assert finding.gap_closed_interval[0] == 0.0
        assert finding.gap_closed_interval[1] == pytest.approx(min(3.0 * finding.gap_closed, 1.0))


def test_rounding_without_a_gap_closes_all_of_it(planar2):
    before, rounding = found([0.005, 0.02], 1.0)
    assert coarse_findings(planar2, rounding, before, FLOOR)[0].gap_closed == 1.0
