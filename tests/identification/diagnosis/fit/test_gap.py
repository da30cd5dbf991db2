from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fit.fitting import predict
from identification.diagnosis.fit.gap import Sums, held_out_torque, judged_blocks, residual_after, sums


def test_a_residual_of_the_size_of_the_noise_has_loss_one():
    # Contract: mean over joints of mean square over squared noise floor.
    floor = np.array([0.1, 2.0])
    counts = np.array([[50.0, 40.0], [30.0, 20.0]])
    given = Sums(counts * floor**2, counts)
    assert given.loss(floor, np.ones((1, 2)))[0] == pytest.approx(1.0)
    np.testing.assert_allclose(given.rms(), floor)


def test_the_loss_is_the_mean_over_joints():
    given = Sums(np.array([[100 * 0.09, 50 * 16.0]]), np.array([[100.0, 50.0]]))
    # Joint 1: rms 0.3 over 0.1; joint 2: rms 4 over 2.
    assert given.loss(np.array([0.1, 2.0]), np.ones((1, 1)))[0] == pytest.approx((9 + 4) / 2)


def test_a_block_drawn_twice_counts_twice():
    given = Sums(np.array([[1.0], [9.0]]), np.array([[1.0], [1.0]]))
    loss = given.loss(np.ones(1), np.array([[1.0, 1.0], [2.0, 0.0], [1.0, 3.0]]))
    np.testing.assert_allclose(loss, [5.0, 1.0, 7.0])


@pytest.fixture(scope="module")
def two(lab, planar2):
    recordings = (lab.recording(planar2, lab.motion(2, 1)), lab.recording(planar2, lab.motion(2, 2), seed=1))
    return lab.prepared(planar2, recordings, held_out=1)


def test_held_out_recordings_are_judged_alone(two, quiet):
    assert {two.blocks[k].log for k in judged_blocks(two.problem)} == {1}
    assert len(judged_blocks(quiet.problem)) == len(quiet.blocks)


def test_sums_are_those_of_usable_samples_of_cores(two):
    # Brute force over the judged blocks.
    found = sums(two.problem, two.columns.residual)
    judged = [block for block in two.blocks if block.log == 1]
    for i, block in enumerate(judged):
        use = two.columns.usable[1][block.core : block.stop]
        np.testing.assert_array_equal(found.counts[i], use.sum(axis=0))
        squares = two.columns.residual[1][block.core : block.stop] ** 2
        np.testing.assert_allclose(found.squares[i], (squares * use).sum(axis=0))


def test_a_block_without_a_sample_is_no_block_to_draw(quiet):
    # By hand: a replicate of such blocks alone would have neither squares nor samples.
    usable = quiet.columns.usable[0].copy()
    usable[quiet.blocks[0].start : quiet.blocks[0].stop] = False
    problem = replace(quiet.problem, columns=replace(quiet.columns, usable=(usable,)))
    assert len(sums(problem, quiet.columns.residual).counts) == len(quiet.blocks) - 1


def test_a_sample_counts_as_little_as_the_friction_of_a_standing_joint_is_known_there(two):
    # By hand: where friction is open by twice the noise, a sample counts a fifth.
    twice = tuple(np.full(r.shape, 2.0) * two.problem.weights.floor for r in two.columns.residual)
    standing = replace(two.problem, columns=replace(two.columns, standing=twice))
    moving = replace(two.problem, columns=replace(two.columns, standing=tuple(0.0 * part for part in twice)))
    few, all_ = (sums(problem, two.columns.residual) for problem in (standing, moving))
    np.testing.assert_allclose(few.counts, 0.2 * all_.counts)
    np.testing.assert_allclose(few.squares, 0.2 * all_.squares)
    np.testing.assert_allclose(few.rms(), all_.rms())


def test_each_block_is_predicted_by_the_fit_without_its_fold(two):
    term = two.term("viscous_friction", "elbow")
    found = two.search.evaluate(frozenset([term]))
    torque = held_out_torque(two.problem, frozenset([term]), found)
    for block, fold in zip(two.blocks, two.folds, strict=True):
        theta = found.theta if fold < 0 else found.fold_theta[fold]
        part = slice(block.start, block.stop)
        expected = predict(two.problem, (term,), theta, block.log)[part]
        # The product of a part of the rows rounds in its last digit as it likes.
        np.testing.assert_allclose(torque[block.log][part], expected, rtol=1e-12)


def test_what_is_left_is_measured_less_predicted(two):
    columns = two.columns
    measured = tuple(m + r for m, r in zip(columns.model_torque, columns.residual, strict=True))
    rest = residual_after(two.problem, tuple(0.9 * m for m in measured))
    np.testing.assert_allclose(rest[1], 0.1 * measured[1], atol=1e-9)


def test_the_judged_band_leaves_what_lies_above_out(quiet):
    log = quiet.logs[0]
    t = log.motion.t[log.samples]
    slow, fast = np.sin(2 * np.pi * 0.3 * t), np.sin(2 * np.pi * 0.8 * log.band.cutoff_hz * t)
    series = np.column_stack([slow, slow + fast])
    inside = slice(len(t) // 5, -len(t) // 5)
    narrow = replace(quiet.session, cutoff_hz=0.3 * log.band.cutoff_hz).in_judged_band((series,))[0]
    np.testing.assert_allclose(narrow[inside, 1], slow[inside], atol=0.02)


def test_a_band_that_is_judged_as_it_stands_is_not_filtered_again(quiet):
    series = (quiet.columns.residual[0],)
    same = replace(quiet.session, cutoff_hz=quiet.logs[0].band.cutoff_hz).in_judged_band(series)
    assert same[0] is series[0]
