"""The judged band: its noise floor, what is visible above it, and fits in it. Oracle: closed forms and known truths."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fit.gap import RowGaps
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.judged_band import Judge, narrow_search
from identification.diagnosis.noise.noise_floor import noise_floor, weights_of


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


@pytest.fixture(scope="module")
def rubbing(lab, planar2):
    """The arm with 0.3 N m of friction on the elbow that its model lacks."""
    motion = lab.motion(2, 4)
    return lab.prepared(planar2, (lab.recording(planar2, motion, -0.3 * np.sign(motion.v) * [0.0, 1.0]),))


def test_a_plain_search_keeps_thresholds_and_spurious_gains(rubbing):
    search = replace(rubbing.search, spurious={("payload", None): 7.0}, rows=RowGaps(np.array([1.0, 2.0]), np.zeros(2)))
    plain = narrow_search(search, rubbing.noise)
    assert plain.threshold == search.threshold
    assert plain.spurious == search.spurious
    assert plain.rows is search.rows


@pytest.mark.parametrize(("share", "smoothed"), [(0.5, True), (0.98, True), (0.995, False)])
def test_a_plain_search_fits_columns_and_residual_in_the_judged_band(rubbing, share, smoothed):
    # The columns as computed, less what lies above the judged band where that is narrower by a hundredth.
    session = rubbing.session
    session = replace(session, cutoff_hz=share * session.logs[0].band.cutoff_hz)
    search = replace(rubbing.search, problem=replace(rubbing.problem, session=session))
    plain = narrow_search(search, rubbing.noise).problem
    columns = rubbing.columns
    assert (plain.white.residual[0] is not columns.residual[0]) is smoothed
    for name in ("residual", "model_torque"):
        np.testing.assert_allclose(getattr(plain.white, name)[0], session.in_judged_band(getattr(columns, name))[0])
    for narrow, wide in zip(plain.white.values[0], columns.values[0], strict=True):
        np.testing.assert_allclose(narrow, session.log_in_judged_band(wide, 0))
    weights = weights_of(plain.white, session.in_judged_band(rubbing.noise))
    np.testing.assert_array_equal(plain.weights.per_sample, weights.per_sample)


def test_a_judge_sees_series_in_its_band(rubbing):
    judge = Judge(rubbing.problem, np.ones(2), np.ones(2))
    np.testing.assert_array_equal(judge.narrow(rubbing.noise)[0], rubbing.session.in_judged_band(rubbing.noise)[0])
