"""Shapes of exciting motions."""

import numpy as np
import pinocchio as pin
import pytest

from identification.excitation.closable import CLEAR, ordinary_postures
from identification.excitation.excite import excite
from identification.excitation.limits import limits_of
from identification.excitation.motion_shapes import (
    BSplines,
    FourierSeries,
    Sine,
    Triangle,
    TrianglesAndSines,
    wave_motion,
)
from phantom_dyn.errors import ParameterError
from phantom_dyn.loops.solver import distance_from_singularity
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS

FAMILIES = [FourierSeries(4.0, 3), BSplines(4.0, 5), BSplines(4.0, 1), TrianglesAndSines(4.0), FourierSeries(4.0, 2)]


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_any_sum_begins_and_ends_at_rest(shapes, rng):
    values = shapes.values(np.array([0.0, 4.0]))
    weights = rng.normal(size=values.shape[2])
    np.testing.assert_allclose(values[1:] @ weights, 0.0, atol=1e-12)


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_velocity_and_acceleration_are_the_slopes(shapes):
    # Oracle: central differences.
    t, h = np.linspace(0.01, 3.99, 801), 1e-6
    before, at, after = (shapes.values(t + step) for step in (-h, 0.0, h))
    np.testing.assert_allclose(at[1], (after[0] - before[0]) / (2 * h), atol=1e-7)
    # The slope of a triangle's acceleration jumps at the ends of a turn.
    np.testing.assert_allclose(at[2], (after[1] - before[1]) / (2 * h), atol=2e-4)


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_the_first_shape_is_a_posture(shapes):
    first = shapes.values(np.linspace(0.0, 4.0, 5))[:, :, 0]
    np.testing.assert_array_equal(first, [[1.0] * 5, [0.0] * 5, [0.0] * 5])


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_no_shape_is_a_sum_of_the_others(shapes):
    positions = shapes.values(np.linspace(0.0, 4.0, 500))[0]
    assert np.linalg.matrix_rank(positions) == positions.shape[1]


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_samples_show_the_peak_speed_within_a_per_cent(shapes, rng):
    weights = rng.normal(size=shapes.values(np.zeros(1)).shape[2])
    peaks = [
        np.abs(shapes.values(np.linspace(0.0, 4.0, n))[1] @ weights).max()
        for n in (shapes.samples, 50 * shapes.samples)
    ]
    assert peaks[0] > 0.99 * peaks[1]


def test_fourier_series_hold_what_harmonics_at_rest_allow():
    # Two weights of each harmonic less two conditions, as the motion is periodic, and the posture.
    assert FourierSeries(4.0, 5).values(np.zeros(1)).shape[2] == 2 * 5 - 2 + 1


def test_between_its_turns_a_triangle_adds_no_acceleration_to_the_sines():
    # Closed form: its turns take 0.15 of 4 s about 0, 2 and 4 s; what is left is one sine and one cosine.
    t = np.linspace(0.31, 1.69, 200)
    moving = TrianglesAndSines(4.0, triangles=1, harmonics=1).values(t)[2, :, 1:]
    sines = np.column_stack([np.sin(0.5 * np.pi * t), np.cos(0.5 * np.pi * t)])
    _, left, *_ = np.linalg.lstsq(sines, moving, rcond=None)
    assert np.abs(moving).max() > 0.1
    np.testing.assert_allclose(left, 0.0, atol=1e-20)


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan, np.inf])
def test_a_duration_that_is_none_is_refused(duration):
    with pytest.raises(ParameterError, match=r"The duration of a motion is \S+: give a number above 0\."):
        FourierSeries(duration)


@pytest.mark.parametrize(
    ("kind", "count", "said"),
    [
        (FourierSeries, 1, "A motion of 1 harmonics was asked for: give at least 2"),
        (BSplines, 0, "A motion of 0 pieces was asked for: give at least 1"),
    ],
)
def test_one_harmonic_and_a_spline_without_a_piece_are_refused(kind, count, said):
    with pytest.raises(ParameterError, match=said):
        kind(4.0, count)


WAVES = [Sine(0.4, 0.7, 0.2), Triangle(0.4, 0.7, 0.2), Triangle(0.4, 0.7, turn=0.5)]


@pytest.mark.parametrize("wave", WAVES, ids=repr)
def test_velocity_and_acceleration_of_waves_are_the_slopes(wave):
    # Oracle: central differences.
    t, h = np.linspace(0, 5, 3001), 1e-6
    _, v, a = wave.motion(t)
    before, after = wave.motion(t - h), wave.motion(t + h)
    np.testing.assert_allclose(v, (after[0] - before[0]) / (2 * h), atol=1e-8)
    # The slope of the acceleration jumps at the ends of a turn.
    np.testing.assert_allclose(a, (after[1] - before[1]) / (2 * h), atol=1e-3)


@pytest.mark.parametrize("wave", WAVES, ids=repr)
def test_a_wave_swings_between_plus_and_minus_its_amplitude(wave):
    q = wave.motion(np.linspace(0, 1 / 0.7, 20001))[0]
    assert q.max() == pytest.approx(0.4, rel=1e-6)
    assert q.min() == pytest.approx(-0.4, rel=1e-6)


@pytest.mark.parametrize("wave", WAVES, ids=repr)
def test_a_wave_repeats_after_its_period(wave):
    t = np.linspace(0, 1, 501)
    np.testing.assert_allclose(wave.motion(t + 10 / 0.7), wave.motion(t), atol=1e-11)


def test_a_triangle_holds_its_speed_but_in_the_turns():
    t = np.linspace(0, 10, 100000, endpoint=False)
    wave = Triangle(0.3, 0.5, turn=0.1)
    straight = wave.motion(t)[2] == 0
    np.testing.assert_allclose(np.abs(wave.motion(t)[1][straight]), wave.speed)
    # Closed form: two turns of a tenth of the period.
    assert straight.mean() == pytest.approx(0.8, abs=1e-3)


def test_a_sharp_triangle_has_the_speed_of_its_way():
    # Closed form: four amplitudes a period.
    assert Triangle(0.3, 0.5, turn=1e-9).speed == pytest.approx(4 * 0.3 * 0.5)


def test_a_triangle_that_only_turns_is_a_sine():
    t = np.linspace(0, 5, 500)
    np.testing.assert_allclose(Triangle(0.3, 0.5, 0.1, turn=0.5).motion(t), Sine(0.3, 0.5, 0.1).motion(t), atol=1e-12)


def test_waves_of_a_joint_add_up_about_its_center():
    t = np.linspace(0, 3, 50)
    motion = wave_motion(t, [WAVES[:2], []], np.array([1.0, -2.0]))
    first, second = WAVES[0].motion(t), WAVES[1].motion(t)
    np.testing.assert_allclose(motion.q, np.stack([1 + first[0] + second[0], np.full(50, -2.0)], axis=1))
    np.testing.assert_allclose(motion.v, np.stack([first[1] + second[1], np.zeros(50)], axis=1))
    np.testing.assert_allclose(motion.a, np.stack([first[2] + second[2], np.zeros(50)], axis=1))


@pytest.mark.parametrize("turn", [0.0, 0.6, np.nan])
def test_a_turn_that_does_not_fit_the_period_is_refused(turn):
    with pytest.raises(ParameterError, match=r"of its period: give more than 0 and at most 0\.5"):
        Triangle(0.3, 0.5, turn=turn)


@pytest.mark.parametrize("wave", [Sine, Triangle])
def test_a_frequency_of_zero_is_refused(wave):
    with pytest.raises(ParameterError, match=r"The frequency of a wave is 0\.0: give a number above 0"):
        wave(0.3, 0.0)


# Base, platform, arm and rod [m].
BASE, PLATFORM, ARM, ROD = 0.15, 0.05, 0.2, 0.4


@pytest.fixture(scope="module")
def delta() -> Robot:
    return load_robot(ROBOTS / "delta.xml", config=ROBOTS / "delta.yaml")


def platform(robot: Robot, posture: np.ndarray) -> pin.SE3:
    """Place of the platform's centre."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.configuration(posture[None])[0])
    return data.oMf[robot.model.getFrameId("tip")]


def test_three_drives_move_a_delta(delta):
    assert delta.joint_names == ("drive0", "drive1", "drive2")
    assert len(delta.passive_names) == 8


def test_the_platform_is_a_rod_away_from_each_elbow_and_level(delta):
    # Closed form of a Delta: circles of the elbows about the base, moved inwards by the platform.
    for posture in ordinary_postures(delta, 20):
        place = platform(delta, posture)
        np.testing.assert_allclose(place.rotation, np.eye(3), atol=1e-9)
        for k, angle in enumerate(posture):
            out = np.array([np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3), 0.0])
            elbow = (BASE - PLATFORM + ARM * np.cos(angle)) * out - ARM * np.sin(angle) * np.array([0.0, 0.0, 1.0])
            assert np.linalg.norm(place.translation - elbow) == pytest.approx(ROD, abs=1e-6)


@pytest.mark.nightly
@pytest.mark.whole
def test_an_exciting_motion_of_a_delta_stays_clear_of_a_singularity(delta):
    limits = limits_of(delta, velocity=3.0, acceleration=40.0)
    design = excite(delta, FourierSeries(4.0, 2), limits=limits, starts=2)
    motion = design.motion(300.0)
    assert distance_from_singularity(delta.solutions.at(motion.q).inverse).min() >= CLEAR
    assert np.abs(motion.v).max() <= 3.0
    assert design.condition < 0.5 * design.start
