"""The step of an encoder, from the levels of its readings."""

import numpy as np
import pytest

from phantom_dyn.effects.support.encoder_lattice import _levels, _on_lattice, _sharpened, coarse_step, step_of

STATED = 1e-4


@pytest.fixture
def swung(rng) -> np.ndarray:
    t = np.linspace(0.0, 8.0, 6000)
    return 0.6 * np.sin(1.7 * t) + 0.3 * np.sin(4.1 * t + rng.uniform(0, 6))


@pytest.mark.parametrize("times", [8, 12.5, 30, 100])
def test_a_coarse_step_is_found_under_noise_of_a_stated_step(swung, rng, times):
    readings = np.round(swung / (times * STATED)) * times * STATED + 0.5 * STATED * rng.normal(size=len(swung))
    assert coarse_step(readings, STATED) == pytest.approx(times * STATED, rel=1e-3)


def test_readings_at_the_stated_step_gather_about_none_that_is_coarser(swung):
    assert coarse_step(np.round(swung / STATED) * STATED, STATED) is None


def test_readings_between_all_levels_gather_about_no_step(swung):
    assert coarse_step(swung, STATED) is None


def test_few_levels_have_no_comb():
    assert coarse_step(np.round(np.linspace(0.0, 1.0, 500) * 9) / 9, STATED) is None


@pytest.mark.parametrize(("wrong", "believed"), [(2, True), (3, False)])
def test_a_lattice_is_believed_while_no_more_than_two_in_a_hundred_levels_are_off(wrong, believed):
    levels = np.arange(100.0)
    levels[10 : 10 + 10 * wrong : 10] += 0.4
    assert _on_lattice(levels, 1.0) is believed


@pytest.mark.parametrize(("teeth", "step"), [(15, None), (16, 604 / 60), (21, 804 / 80)])
def test_a_comb_of_sixteen_teeth_is_believed_to_a_line_of_its_spectrum(teeth, step):
    # By hand: every tenth of 10 (teeth - 1) + 1 levels; the line next to a tenth of four times as many.
    found = coarse_step(np.repeat(0.3 + 10 * STATED * np.arange(teeth), 20), STATED)
    assert found == (None if step is None else pytest.approx(step * STATED))


@pytest.mark.parametrize(("extra", "peak"), [(5, 80), (6, 161)])
def test_a_comb_is_believed_where_its_first_line_has_six_tenths(extra, peak):
    # Closed form: of 21 teeth and so many levels halfway between, the first line is (21 - n) / (21 + n), 0.62 and 0.56;
    # the second one has all in phase, at twice 80.4.
    places = np.concatenate([10 * np.arange(21), 5 + 20 * np.arange(extra)])
    assert coarse_step(np.repeat(STATED * places, 20), STATED) == pytest.approx(804 / peak * STATED)


def test_a_travel_of_more_than_twenty_million_steps_is_not_looked_at():
    assert coarse_step(np.linspace(0.0, 20_000_001 * 1e-9, 50), 1e-9) is None


@pytest.mark.parametrize(("levels", "step"), [(7, None), (8, 1e-3)])
def test_seven_levels_may_lie_on_any_lattice(levels, step):
    found = step_of(0.2 + 1e-3 * np.array([0, 1, 3, 4, 8, 9, 13, 14])[:levels])
    assert found == (None if step is None else pytest.approx(step))


def test_the_largest_step_of_which_all_distances_are_multiples_is_found():
    # By hand: distances of 6, 9 and 15 units share 3; no two neighbours are closer than 6.
    places = np.cumsum([0, 6, 9, 15, 6, 9, 9, 6, 15, 6, 9, 6])
    assert step_of(1e-3 * places) == pytest.approx(3e-3)
    assert step_of(1e-3 * places, 1e-3) == pytest.approx(3e-3)


def test_readings_that_differ_by_rounding_of_numbers_are_one_level():
    np.testing.assert_array_equal(_levels(np.array([2.0, 0.0, 1e-12, 1.0, 1.0 + 1e-12])), [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(_levels(np.array([1e6, 1e6 + 9e-6, 1e6 + 2e-4])), [1e6, 1e6 + 2e-4])
    np.testing.assert_array_equal(_levels(np.array([-1e-3, 1e-3, 1e-3 + 1e-13])), [-1e-3, 1e-3, 1e-3 + 1e-13])
    np.testing.assert_array_equal(_levels(np.array([3.0, 3.0])), [3.0])


@pytest.mark.parametrize(("off", "believed"), [(1e-3, True), (4e-3, False)])
def test_an_error_of_the_step_counts_over_a_hundred_levels(off, believed):
    # Closed form: over a hundred levels it adds up to a tenth of a step either way at 2e-3, wherever they begin.
    assert _on_lattice(np.arange(1000.0) * (1.0 + off), 1.0) is believed


@pytest.mark.parametrize(("wrong", "believed"), [(6, True), (7, False)])
def test_wrong_levels_count_over_all_stretches(wrong, believed):
    levels = np.arange(300.0)
    levels[[20, 80, 120, 180, 220, 250, 280][:wrong]] += 0.4
    assert _on_lattice(levels, 1.0) is believed


@pytest.mark.parametrize(("off", "believed"), [(0.09, True), (0.11, False)])
def test_a_level_within_a_tenth_of_a_step_lies_on_the_lattice(off, believed):
    levels = np.arange(100.0)
    levels[[10, 50, 90]] += off
    assert _on_lattice(levels, 1.0) is believed


def test_a_distance_within_a_fifth_of_a_step_of_a_multiple_counts():
    # By hand, at a step of a half: 0.59 is near one and 0.61 is not; then (0.59 + 2.0) / (1 + 4).
    assert _sharpened(np.array([1.0, 0.59]), 0.5) == pytest.approx(2.59 / 5.0)
    assert _sharpened(np.array([1.0, 0.61, 0.66]), 0.5) == pytest.approx(0.5)


def test_a_joint_that_creeps_about_a_place_and_sweeps_once_shows_no_coarse_step():
    # Most levels lie close together where it creeps, and few on the sweep: they gather, but about one tooth.
    t = np.arange(0.0, 20.0, 4e-3)
    place = np.where(t < 19.0, 5.0 * STATED * t, 95.0 * STATED + 0.2 * np.sin(2.0 * np.pi * (t - 19.0)))
    readings = np.round(place / (0.1 * STATED)) * 0.1 * STATED
    assert coarse_step(readings, 0.1 * STATED) is None


@pytest.mark.parametrize("speed", [12.9, 24.3])
def test_a_joint_that_turns_at_a_constant_speed_shows_no_coarse_step(speed):
    # Known truth: readings at every stated step. The distance between two rows, `speed` steps, is a step of the motion.
    travel = np.concatenate([np.arange(0.0, 2000.0), np.full(300, 2000.0), np.arange(2000.0, 0.0, -1.7)])
    assert coarse_step(np.round(speed * travel) * STATED, STATED) is None


def test_a_coarse_step_is_found_beside_a_sweep_of_one_step_a_row(swung, rng):
    sweep = 1.0 + 30 * STATED * np.arange(400)
    place = np.concatenate([swung, sweep])
    readings = np.round(place / (30 * STATED)) * 30 * STATED + 0.5 * STATED * rng.normal(size=len(place))
    assert coarse_step(readings, STATED) == pytest.approx(30 * STATED, rel=1e-3)
