"""Figures of each joint, and moves that end at their limits. Oracle: closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.gap import Sums
from identification.diagnosis.judge.floors import Floor
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.judgement import joint_gaps
from identification.diagnosis.judge.shares import closed_together
from identification.diagnosis.judge.verdict import adjusted, hidden_by

FLOOR = Floor(np.array([0.1, 0.2]), np.array([0.09, 0.18]), np.array([0.11, 0.22]), ("above_band", "predictors"))


def left(*rms: float, blocks: int = 4) -> Sums:
    """Residuals of this size on the two joints, the same in every block of fifty samples."""
    counts = np.full((blocks, 2), 50.0)
    return Sums(np.square(rms) * counts, counts)


def test_a_joint_closes_the_part_of_its_own_gap_that_is_no_longer_left(quiet):
    first, second = joint_gaps(quiet.problem, FLOOR, left(1.5, 0.3), left(1.0, 0.21), left(0.2, 0.2))
    assert first.closed == pytest.approx((1.0**2 - 0.2**2) / (1.0**2 - 0.1**2))
    assert second.closed is None  # within the interval of its noise
    assert (first.rms_before, first.rms_within_tolerance, first.rms_after) == pytest.approx((1.5, 1.0, 0.2))
    assert first.noise_floor_interval == pytest.approx((0.09, 0.11))
    assert first.hold_out_samples == 200


def test_findings_close_together_what_they_take_off_the_loss_beyond_the_floor(quiet):
    # Losses 100 and 4 on one joint, 1 on the other: (50.5 - 2.5) / (50.5 - 1).
    judge = Judge(quiet.problem, FLOOR.value, FLOOR.high)
    gap = closed_together(judge, left(1.0, 0.2), left(0.2, 0.2))
    assert gap.closed == pytest.approx(48.0 / 49.5)
    assert gap.interval == pytest.approx((48.0 / 49.5, 48.0 / 49.5))


def test_where_all_is_within_the_noise_there_is_nothing_to_close(quiet):
    gap = closed_together(Judge(quiet.problem, FLOOR.value, FLOOR.high), left(0.105, 0.21), left(0.1, 0.2))
    assert (gap.closed, gap.interval) == (None, None)


def test_a_mass_at_its_limit_could_hide_a_payload_and_others_hide_nothing(quiet):
    problem = quiet.problem
    names = [move.name for move in problem.columns.nuisances]
    mass = next(k for k, name in enumerate(names) if name.endswith(" mass"))
    found = fit(problem, ())
    theta = found.theta.copy()
    theta[: problem.nuisances] = 0.0
    theta[mass] = -problem.columns.nuisances[mass].bound
    inside = next(k for k in range(problem.nuisances) if k != mass and problem.columns.nuisances[k].relative)
    theta[inside] = 0.9 * problem.columns.nuisances[inside].bound
    sure = replace(found, problem=replace(problem, precision=np.full(len(theta), 1e12)))
    moves = {move.quantity: move for move in adjusted(problem, replace(sure, theta=theta))}
    assert set(moves) == {names[mass], names[inside]}
    assert moves[names[mass]].at_limit
    assert moves[names[mass]].hides.kind == "payload"
    assert not moves[names[inside]].at_limit
    assert moves[names[inside]].hides is None


def test_what_hides_behind_a_mass_is_its_tolerance_of_it(quiet, planar2):
    move = next(move for move in quiet.columns.nuisances if move.name == "lower mass")
    kilograms = move.bound * planar2.model.inertias[2].mass
    hidden = hidden_by(planar2, move)
    assert (hidden.kind, hidden.size) == ("payload", pytest.approx(kilograms))
