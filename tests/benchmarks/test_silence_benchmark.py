"""Benchmarks of silence and of noise floors."""

import numpy as np
import pytest

from benchmarks.blind.makes import make_named
from benchmarks.gapbench.generator.case import draw_case, with_and_without
from benchmarks.silence import Pair, summary
from benchmarks.tracking_gain import ARM, controller, drawn_causes, error_ratio, mean_ratio, sines, tracking_error
from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_model import corrected_model
from phantom_dyn.model.loading import load_robot


def test_a_floor_that_is_lower_with_the_effect_counts_as_one_that_is_higher():
    # By hand: 1.3 and 1/1.3 are off, 1.1 and 1/1.1 are within 1.2.
    found = [Pair(0, "cogging", "j1", ratio, "sensors", "no_gap") for ratio in (1.3, 1 / 1.3, 1.1, 1 / 1.1)]
    assert "2 of 4 (50 %)" in summary(found)[1]


def test_a_case_without_its_effect_has_the_same_readings_noise_and_another_motion():
    case, without = with_and_without(1, "single", slow=True)
    assert case.log.shape == without.log.shape
    assert case.yaml == without.yaml
    assert np.array_equal(case.log[:, 0], without.log[:, 0])
    assert not np.array_equal(case.log, without.log)


def test_slow_motions_are_slower_than_those_of_the_first_make():
    # Oracle: mean speed of the recorded positions of the same robot.
    def speed(log):
        return np.abs(np.diff(log[:, 1])).mean() / np.diff(log[:, 0]).mean()

    slow, fast = (draw_case(0, "null", robot="pendulum", slow=slow).log for slow in (True, False))
    assert speed(slow) < 0.6 * speed(fast)


def test_the_slow_make_gives_the_same_bytes_again_under_a_name_of_its_own():
    make = make_named("slow")
    one, again = (make.draw_case(2, "null") for _ in range(2))
    assert np.array_equal(one.log, again.log)
    assert one.id == make.case_id(2, "null") != make_named("mujoco").case_id(2, "null")


@pytest.mark.whole
def test_a_controller_of_the_true_model_hardly_errs():
    robot, rng = load_robot(ARM), np.random.default_rng(3)
    causes = drawn_causes(rng)
    effects = tuple(KnownEffect(c.effect.name, c.joint, tuple(np.asarray(c.theta).tolist())) for c in causes)
    reference = sines(rng, 3.0, robot.nv)
    true, given = (
        tracking_error(robot, causes, controller(corrected_model(robot, found), reference), reference)
        for found in (effects, ())
    )
    assert true < 2e-3
    assert true < 0.1 * given


@pytest.mark.whole
def test_the_corrected_model_gives_the_better_controller():
    _, before, after = error_ratio(load_robot(ARM), np.random.default_rng((0, 2)))
    assert after < 0.5 * before


@pytest.mark.whole
def test_the_mean_is_geometric_and_lies_in_its_interval():
    mean, low, high = mean_ratio(np.array([0.1, 0.4, 0.2, 0.2]), np.random.default_rng(0))
    assert mean == pytest.approx(0.2)
    assert low < mean < high
