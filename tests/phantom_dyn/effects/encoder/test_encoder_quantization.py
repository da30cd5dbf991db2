from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.effects.encoder.encoder_quantization import EncoderQuantization
from phantom_dyn.effects.support.encoder_lattice import stated_step, step_of

EFFECT = EncoderQuantization()


@pytest.fixture
def motion_read(rng: np.random.Generator) -> np.ndarray:
    """Some seconds of a smooth motion that also rests."""
    t = np.linspace(0.0, 8.0, 4000)
    return 0.8 * np.sin(1.7 * t) * np.minimum(t, 1.0) + 0.3 * np.sin(4.1 * t + rng.uniform(0, 6))


@pytest.mark.parametrize("step", [1e-4, 9.587e-5, 1.2e-3, 0.02])
@pytest.mark.parametrize("offset", [0.0, 0.4321])
@pytest.mark.parametrize("digits", [6, 12])
def test_the_step_of_rounded_readings_is_found(motion_read, step, offset, digits):
    # Known truth, with a zero of its own and the rounding of a text file.
    readings = np.round(np.round(motion_read / step) * step + offset, digits)
    assert step_of(readings) == pytest.approx(step, rel=2e-3)


def test_a_step_coarser_than_the_stated_one_is_found(motion_read):
    assert step_of(np.round(motion_read / 3.3e-4) * 3.3e-4, 1e-4) == pytest.approx(3.3e-4, rel=1e-3)


def test_a_step_is_found_where_levels_are_passed_unread(rng):
    # Fast: 500 readings on 60 000 levels.
    readings = np.round(rng.uniform(-3.0, 3.0, 500) / 1e-4) * 1e-4
    assert step_of(readings, 1e-4) == pytest.approx(1e-4, rel=1e-3)


def test_a_few_wrong_readings_do_not_hide_the_step(motion_read, rng):
    readings = np.round(motion_read / 1e-3) * 1e-3
    readings[rng.choice(len(readings), 20, replace=False)] += rng.uniform(-1e-3, 1e-3, 20)
    assert step_of(readings) == pytest.approx(1e-3, rel=1e-3)


def test_readings_of_a_perfect_encoder_are_on_no_lattice(motion_read):
    assert step_of(motion_read, 1e-4) is None


def test_noisy_readings_are_on_no_lattice(motion_read, rng):
    readings = np.round(motion_read / 1e-3) * 1e-3 + rng.normal(0, 5e-4, len(motion_read))
    assert step_of(readings, 1e-3) is None


def test_a_joint_that_rests_takes_too_few_levels_to_tell():
    assert step_of(np.array([0.1, 0.2, 0.1, 0.1, 0.3] * 50)) is None


def counted(robot, counts):
    return replace(robot, actuators=tuple(replace(one, encoder_counts=counts) for one in robot.actuators))


def test_the_stated_step_is_a_turn_over_the_counts(arm):
    assert stated_step(counted(arm, 4096.0), 1) == pytest.approx(2 * np.pi / 4096)


def test_the_stated_step_of_a_slide_is_a_metre_over_the_counts(arm):
    assert stated_step(counted(arm, 4096.0), 2) == pytest.approx(1 / 4096)


def test_it_has_no_column(arm, operation):
    assert EFFECT.signature(arm, operation, "tilt", ()).columns.shape == (40, 1, 0)


def test_it_has_no_torque(arm, operation):
    assert not EFFECT.torque(arm, operation, "tilt", np.array([0.01])).any()


def test_without_a_stated_step_it_is_said_how_to_state_one(arm, operation):
    said = EFFECT.untestable(arm, operation, "tilt")
    assert said.startswith("no step is stated")
    assert "give joints.tilt.encoder_counts" in said
    assert EFFECT.untestable(counted(arm, 4096.0), operation, "tilt") is None


def test_the_reading_is_rounded(arm):
    reading = EFFECT.simulated(arm, "tilt", np.array([0.1])).reading
    assert reading is not None
    np.testing.assert_allclose(reading(np.array([0.123, 0.163, 0.163])), [0.123, 0.2, 0.163])
