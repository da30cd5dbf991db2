"""Benchmarks of one question each: common causes, known changes, the next experiment."""

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks.common_causes import Case
from benchmarks.fresh_noise import fresh_noise
from benchmarks.gapbench.makes.field.case import draw_open
from benchmarks.gapbench.makes.field.records import LEAD, columns
from benchmarks.known_changes import gain_case, load_case, separated
from benchmarks.next_experiment_cases import drawn_case
from benchmarks.next_experiment_field import fresh_recorder, log_of, reference_at_steps, task_along, world_with
from benchmarks.next_experiment_figures import lines_of, paired_difference
from identification.data.changes import KnownPayload
from identification.pipeline import diagnose
from phantom_dyn.motion import Motion

# Seeds that draw each of the three arms.
SEEDS = range(6)


@pytest.mark.parametrize("kind", ["scale", "line", "load"])
def test_a_case_of_every_arm_has_recordings_of_its_joints_and_says_what_was_put_in(kind):
    drawn = [Case(kind, seed, null=False) for seed in SEEDS]
    assert {case.robot.name for case in drawn} == {"ur5", "ur10", "panda"}
    for case in drawn:
        assert case.truth.sizes
        for recording in case.recordings:
            assert recording.tau.shape == recording.q.shape == (len(recording.t), case.robot.nv)


def test_readings_times_the_ratio_of_a_case_are_its_torques():
    # By hand: the same seed without the cause draws the same motion, friction and joints.
    for seed in SEEDS:
        scaled, plain = (Case("scale", seed, null=null) for null in (False, True))
        (place,) = [place for place in scaled.truth.sizes if place[0] == "torque_constant"]
        rows = np.array([name in str(place[1]).split("+") for name in scaled.robot.joint_names])
        ratio = np.where(rows, scaled.truth.sizes[place], 1.0)
        (read,), (true,) = scaled.recordings, plain.recordings
        # Noise of 4 per mil of each.
        left = np.sqrt(np.mean((read.tau * ratio - true.tau) ** 2, axis=0) / np.mean(true.tau**2, axis=0))
        assert np.all((left < 0.02) | (np.abs(true.tau).max(axis=0) < 0.5))


def test_joints_of_a_case_on_one_line_move_alike():
    for seed in SEEDS:
        v = np.diff(Case("line", seed, null=False).recordings[0].q, axis=0)
        assert np.abs(np.corrcoef(v.T)).min() > 0.98


@pytest.mark.whole
@pytest.mark.parametrize("make", [gain_case, load_case])
def test_two_recordings_with_a_known_change_tell_causes_apart(make):
    # Known truth: the project's simulator with one cause, a softer controller or a known mass in the second recording.
    case = make(np.random.default_rng(5))
    found = diagnose(case.robot, case.recordings, changes=case.changes)
    assert separated(found, case.truth, case.other)


@pytest.mark.whole
@pytest.mark.parametrize("make", [gain_case, load_case])
def test_a_case_is_drawn_from_its_seed(make):
    first, again = (make(np.random.default_rng(4)).recordings[1].tau for _ in range(2))
    np.testing.assert_array_equal(first, again)


GANTRY = 3  # a seed whose robot has three axes at right angles, the last one upright


@pytest.fixture(scope="module")
def gantry():
    """A single case of users' robots, with all that it hides."""
    drawn = draw_open(GANTRY)
    assert drawn is not None
    return drawn[1:]


def again(setting, one, payload=None):
    """The log of the very same recording once more."""
    task = task_along(setting, setting.task.ref, setting.task.extra)
    return log_of(setting, world_with(one, setting.world, len(task.ref), payload), task, setting.recorder)


def test_fresh_noise_has_the_autocovariance_of_the_noise_that_it_is_drawn_from():
    # A first-order colour: its autocovariance falls by 0.8 a step.
    rng = np.random.default_rng(1)
    noise = lfilter([0.6], [1.0, -0.8], rng.standard_normal((40000, 1)), axis=0)
    drawn = np.concatenate([fresh_noise(noise, 5000, rng) for _ in range(40)], axis=1)
    lags = [float(np.mean(drawn[lag:] * drawn[: len(drawn) - lag])) for lag in range(3)]
    np.testing.assert_allclose(lags, [1.0, 0.8, 0.64], rtol=0.04)


def test_fresh_noise_has_nothing_in_common_with_the_noise_that_it_is_drawn_from():
    rng = np.random.default_rng(2)
    noise = rng.standard_normal((20000, 1))
    assert abs(np.corrcoef(noise[:, 0], fresh_noise(noise, 20000, rng)[:, 0])[0, 1]) < 0.03


def test_a_robot_that_is_recorded_again_along_its_own_reference_with_its_own_noise_gives_the_same_log(gantry):
    setting, one = gantry
    first = columns(setting.robot, one.run, setting.task.ref, setting.recorder, setting.world.quantum)
    second = again(setting, one)
    for name, values in first.items():
        np.testing.assert_array_equal(second[name], values)


def test_a_known_mass_weighs_on_the_upright_axis(gantry):
    setting, one = gantry
    mass = 1.0
    with_mass, without = again(setting, one, KnownPayload(mass, (0.0, 0.0, -0.1))), again(setting, one)
    name = next(name for name in without if name in ("tau.z", "i.z"))
    scale = np.prod(setting.recorder.constants["z"]) if name == "i.z" else 1.0
    assert scale * np.mean(with_mass[name] - without[name]) == pytest.approx(mass * 9.81, rel=0.03)


def test_a_motion_begins_once_the_robot_has_rested():
    t = np.linspace(0.0, 2.0, 201)
    motion = Motion(t, (1.0 - np.cos(np.pi * t))[:, None], np.zeros((201, 1)), np.zeros((201, 1)))
    ref = reference_at_steps(motion)[:, 0]
    steps = round(LEAD / 2.5e-4)
    assert np.all(ref[:steps] == 0.0)
    assert ref[steps + 4000] == pytest.approx(2.0, abs=1e-6)


def test_another_log_has_its_own_stamps_and_noise_at_the_same_rate(gantry):
    before = gantry[0].recorder
    other = fresh_recorder(before, 12.0, np.random.default_rng(3))
    assert len(other.taken) == len(other.noise) == int(12.0 * before.rate)
    assert np.all(np.diff(other.stamp) > 0.0)
    assert np.median(np.diff(other.stamp)) == pytest.approx(1.0 / before.rate, rel=0.05)


def test_two_noises_of_one_motion_differ_and_the_same_one_does_not():
    case = drawn_case(0)
    assert case is not None
    t = np.linspace(0.0, 2.0, 401)
    rise = (10.0 - 15.0 * (t / 2.0) + 6.0 * (t / 2.0) ** 2) * (t / 2.0) ** 3
    motion = Motion(t, 0.3 * rise[:, None], np.zeros((401, 1)), np.zeros((401, 1)))
    one, other, same = (case.again(motion, noise) for noise in (1, 2, 1))
    assert np.array_equal(one.tau, same.tau)
    assert not np.array_equal(one.tau, other.tau)


def test_the_paired_difference_is_the_mean_of_the_differences_within_its_interval():
    # Of forty cases one motion alone decides ten, the other alone two.
    one, other = [True] * 10 + [False] * 30, [False] * 10 + [True] * 2 + [False] * 28
    value, interval = paired_difference(one, other)
    assert value == pytest.approx(0.2)
    # The deviation of a mean of forty values: ten of 1, two of -1, all others 0.
    deviation = np.sqrt((10 + 2) / 40 - 0.2**2) / np.sqrt(40)
    np.testing.assert_allclose(interval, (0.2 - 1.96 * deviation, 0.2 + 1.96 * deviation), atol=0.03)


def test_no_interval_is_stated_where_no_case_differs():
    assert paired_difference([True, False], [True, False]) == (0.0, None)


def test_cases_without_a_proposal_are_counted_apart():
    asked = {"make": "own", "proposed": True, "random": False, "D-optimal": True, "expected": 0.9, "left": False}
    shares = {"proposed": 1.0, "random": 0.0, "D-optimal": 1.0}
    rows = [asked | {"struck": shares, "sure": shares}, {"make": "own", "proposed": None, "any": None}]
    text = "\n".join(lines_of("own", rows, 5, 8))
    assert "2 of 5 cases leave a set that holds the truth; a motion is proposed for 1" in text
    assert "proposed less random: 100 points" in text
    assert "Where none is proposed, one of 8 random ones does on two noises in 0 of 1." in text
