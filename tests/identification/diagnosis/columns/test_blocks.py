import itertools
from dataclasses import replace

import numpy as np
import pytest

from identification.data.signals import process
from identification.diagnosis.columns.blocks import split_blocks


@pytest.fixture(scope="module")
def two(lab, planar2):
    """Two recordings of different length; no fit sees the second."""
    recordings = (
        lab.recording(planar2, lab.motion(2, 1, seconds=16.0)),
        lab.recording(planar2, lab.motion(2, 2, seconds=7.0), seed=1),
    )
    return lab.prepared(planar2, recordings, held_out=1)


def test_every_sample_in_the_band_is_in_one_block(two):
    for k, log in enumerate(two.logs):
        mine = [block for block in two.blocks if block.log == k]
        covered = np.concatenate([np.arange(block.start, block.stop) for block in mine])
        np.testing.assert_array_equal(covered, np.arange(len(log.samples)))


def test_a_core_shares_no_sample_with_the_kernels_of_the_block_before(two):
    # Full-rate samples that the filter of the first core sample touches, against those of the last block.
    for k, log in enumerate(two.logs):
        mine = [block for block in two.blocks if block.log == k]
        assert len(mine) > 1
        for before, block in itertools.pairwise(mine):
            assert block.start < block.core < block.stop
            assert log.samples[block.core] - log.band.half >= log.samples[before.stop - 1]


def test_the_first_block_of_a_log_is_all_core(two):
    firsts = [next(block for block in two.blocks if block.log == k) for k in range(2)]
    assert all(block.core == block.start == 0 for block in firsts)


def test_blocks_last_a_second_at_least(two):
    assert two.blocks
    for block in two.blocks:
        band = two.logs[block.log].band
        assert (block.stop - block.start) * band.step / band.rate_hz > 0.9


def test_a_long_recording_has_two_dozen_blocks(lab, planar2):
    log = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, seconds=10.0)),)).logs[0]
    long = lab.recording(planar2, lab.motion(2, seconds=100.0))
    blocks = split_blocks((process(long, planar2, cutoff_hz=log.band.cutoff_hz),), 5.0)
    assert 22 <= len(blocks) <= 26


def test_what_a_joint_travels_in_one_stroke_is_shared_among_the_folds(lab, planar2):
    # Joint 2 moves during one of forty seconds: no block holds more than a quarter of its travel.
    log = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, seconds=40.0)),)).logs[0]
    v = log.motion.v.copy()
    t = log.motion.t - log.motion.t[0]
    v[:, 1] = np.where(np.abs(t - 20.0) < 0.5, np.sin(np.pi * (t - 19.5)), 0.0)
    blocks = split_blocks((replace(log, motion=replace(log.motion, v=v)),), 5.0)
    speed = np.abs(v[log.samples, 1])
    shares = np.array([speed[block.start : block.stop].sum() for block in blocks]) / speed.sum()
    assert shares.max() <= 1 / 4
    assert sum(block.stop - block.start for block in blocks) == len(log.samples)


def test_no_block_is_shorter_than_half_a_period_of_the_edge(lab, planar2):
    # A joint that jumps from one sample to the next: its travel cannot be shared.
    log = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, seconds=40.0)),)).logs[0]
    v = np.zeros_like(log.motion.v)
    v[log.samples[100]] = 1.0
    blocks = split_blocks((replace(log, motion=replace(log.motion, v=v)),), 2.0)
    rate = log.band.rate_hz / log.band.step
    assert min(block.stop - block.start for block in blocks) >= int(0.5 * rate / 2.0)
