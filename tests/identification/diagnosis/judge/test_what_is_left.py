"""What is left without a cause. Oracle: known truths, a structure put into a residual or none, and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.verdict import adjusted, flexible_prediction, unexplained
from identification.diagnosis.noise.noise_floor import noise_floor


@pytest.fixture(scope="module")
def nothing(quiet):
    """Nothing shown, on recordings without a gap, in a band that is judged as a whole."""
    session = replace(quiet.session, cutoff_hz=1e3)
    problem = replace(quiet.problem, session=session)
    search = replace(quiet.search, problem=problem)
    floor = noise_floor(session, quiet.columns, quiet.noise)
    return search, Judge(problem, floor, floor)


def left_over(quiet, nothing, residual):
    plain, judge = nothing
    return unexplained(plain, frozenset(), judge, residual, residual)


def waves(quiet, size: float, joint: int = 1):
    """Noise of the recording, and on one joint a wave over its position that no effect of the catalogue is."""
    log = quiet.logs[0]
    out = quiet.noise[0].copy()
    out[:, joint] += (
        size * np.tanh(4.0 * np.sin(3.0 * log.motion.q[log.samples, joint])) * quiet.columns.usable[0][:, joint]
    )
    return (out,)


def test_noise_has_no_structure(quiet, nothing):
    found = left_over(quiet, nothing, quiet.noise)
    assert not found.structured
    assert (found.joint, found.regime) == (None, None)


@pytest.mark.parametrize(("joint", "name"), [(0, "shoulder"), (1, "elbow")])
def test_what_returns_with_position_is_structure_of_its_joint(quiet, nothing, joint, name):
    floor = nothing[1].floor
    found = left_over(quiet, nothing, waves(quiet, 5.0 * floor[joint], joint))
    assert found.structured
    assert found.joint == name
    assert found.regime is not None


def test_all_of_a_gap_that_nothing_explains_is_left(quiet, nothing):
    # Known truth: the given residual is the wave, so that all that could be explained is left.
    plain, judge = nothing
    residual = waves(quiet, 5.0 * judge.floor[1])
    columns = replace(quiet.columns, residual=residual)
    problem = replace(plain.problem, columns=columns)
    plain, judge = replace(plain, problem=problem), replace(judge, problem=problem)
    found = unexplained(plain, frozenset(), judge, residual, residual)
    assert found.fraction_of_explainable == pytest.approx(1.0, abs=0.1)


def test_a_flexible_regression_foretells_what_returns_and_not_what_is_noise(quiet):
    # Known truth: a wave of twenty times the noise; on the shoulder there is none.
    noise = quiet.noise[0]
    size = 20.0 * noise[:, 1].std()
    (residual,) = waves(quiet, size)
    (predicted,) = flexible_prediction(quiet.problem, (residual,))
    use = quiet.columns.usable[0][:, 1]
    assert np.std((residual - predicted)[use, 1]) < 0.5 * np.std(residual[use, 1])
    assert np.std(predicted[:, 0]) < 0.5 * noise[:, 0].std()


def test_what_a_regression_does_not_help_is_not_foretold(quiet, rng):
    # White noise: held out, a prediction makes it worse.
    residual = 0.1 * rng.normal(size=quiet.noise[0].shape)
    (predicted,) = flexible_prediction(quiet.problem, (residual,))
    left = np.sum((residual - predicted)[quiet.columns.usable[0]] ** 2)
    assert left <= np.sum(residual[quiet.columns.usable[0]] ** 2) * 1.01


def test_moves_beyond_two_deviations_are_told(quiet):
    # Closed form on a fit whose moves are set by hand.
    found = fit(quiet.problem, ())
    std = np.sqrt(np.diag(found.cov))
    fitted = [(k, one) for k, one in zip(quiet.problem.moves, std, strict=True) if quiet.columns.nuisances[k].relative]
    relative, deviation = zip(*fitted, strict=True)
    theta = np.zeros_like(found.theta)
    theta[list(relative[:3])] = np.array([1.9, 2.1, -2.1]) * deviation[:3]
    said = adjusted(quiet.problem, replace(found, theta=theta))
    assert [move.quantity for move in said] == [quiet.columns.nuisances[k].name for k in relative[1:3]]
    assert [move.change for move in said] == pytest.approx(theta[list(relative[1:3])])
