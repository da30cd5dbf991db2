"""Derivatives of coarsely read positions. Oracle: the true motion, which was rounded by hand."""

import numpy as np
import pytest

from identification.data.derivatives import differentiate, edges_of_readings, motion_edge
from identification.data.signals import low_pass

RATE = 500.0
T = np.arange(0.0, 12.0, 1.0 / RATE)
BAND = low_pass(10.0, RATE)
EVERYWHERE = np.ones(len(T), dtype=bool)
OMEGA = 2.0 * np.pi * 0.2
SLOW = np.sin(OMEGA * T)[:, None]
STEP = 0.01


def rounded(q: np.ndarray, step: float = STEP) -> np.ndarray:
    """Readings of an encoder with that step."""
    return step * np.round(q / step)


def edges(q: np.ndarray, step: float | None = STEP, valid: np.ndarray = EVERYWHERE) -> np.ndarray:
    """Edges of one joint's readings."""
    return edges_of_readings(q, (step,), valid, BAND)


def test_accelerations_of_a_slow_joint_on_a_coarse_encoder_are_near_the_true_ones():
    readings, truth = rounded(SLOW), -(OMEGA**2) * SLOW
    inner = slice(1000, -1000)
    off = [
        np.std((differentiate(readings, RATE, edge)[2] - truth)[inner]) for edge in (edges(readings), motion_edge(BAND))
    ]
    assert off[0] < 0.02 * truth.std()
    assert off[1] > 5.0 * truth.std()


def test_a_motion_between_coarse_readings_is_within_a_step_of_each():
    readings = rounded(SLOW)
    smooth, *_ = differentiate(readings, RATE, edges(readings))
    assert np.abs(smooth - readings).max() <= STEP


@pytest.mark.parametrize(
    ("q", "step"),
    [
        (rounded(SLOW, 1e-6), 1e-6),
        (rounded(SLOW + 3 * STEP * np.random.default_rng(0).normal(size=SLOW.shape)), STEP),
        (SLOW, None),
        (np.zeros_like(SLOW), None),
    ],
    ids=["fine steps", "noise of three steps", "no steps", "at rest"],
)
def test_readings_that_show_the_motion_keep_the_edge_of_the_band(q, step):
    np.testing.assert_array_equal(edges(q, step), motion_edge(BAND))


def test_readings_that_do_not_count_have_no_say():
    readings, some = rounded(SLOW), EVERYWHERE.copy()
    readings[3000:3010] += 100 * STEP
    some[2900:3110] = False
    assert edges(readings, valid=some) < 0.5 * motion_edge(BAND)
    assert edges(readings) == motion_edge(BAND)


def test_each_joint_has_its_own_low_pass():
    both = np.hstack([SLOW, rounded(SLOW)])
    _, _, a = differentiate(both, RATE, np.array([25.0, 2.0]))
    for j, edge in enumerate((25.0, 2.0)):
        np.testing.assert_allclose(a[:, j], differentiate(both[:, [j]], RATE, edge)[2][:, 0], atol=1e-9)


def test_a_low_pass_is_not_lowered_to_an_edge_above_the_band():
    # Part of a step to and fro at 12 Hz: the readings show it, so that no edge within the band fits, and 15 Hz does.
    q = SLOW + 0.4 * STEP * np.sin(2.0 * np.pi * 12.0 * T)[:, None]
    np.testing.assert_array_equal(edges(rounded(q)), motion_edge(BAND))
