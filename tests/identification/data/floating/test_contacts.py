"""Contacts, swings and sensors of legs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from floating_leg import log_of_leg, written_leg
from identification.data.checks.check_recording import checked
from identification.data.floating.detected_contacts import with_detected_contacts
from identification.data.floating.sensor_checks import check_base
from identification.data.floating.stance_rows import stance_words
from identification.data.floating.swings import band_of_swings, require_swings, touched_rows
from identification.data.reading import recording
from identification.data.recording import Table
from identification.data.signals import process
from identification.data.unknown_drives import with_model_torque
from identification.diagnosis.noise.reading_noise import ReadingNoise
from identification.diagnosis.noise.sensor_floor import reading_error_torque
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot


def without_contacts(folder, rng, *, steps):
    """The recording of a leg whose log states no contacts, and the stances that were put in."""
    file = written_leg(folder)
    robot, log = load_robot(file), log_of_leg(file, rng, steps=steps)
    stands = log.pop("contact.foot")
    return recording(Table("log.csv", log), robot), robot, stands > 0.5


def test_every_stance_is_within_a_detected_contact(tmp_path, rng):
    found, _, stands = without_contacts(tmp_path, rng, steps=True)
    (touches,) = found.base.contacts.values()
    assert np.all(touches[stands] == 1.0)
    # With margins on both sides of five stances in six seconds.
    assert touches.mean() < stands.mean() + 0.25
    assert "contacts were detected from torques" in found.warnings[-1]


def test_a_leg_that_hangs_touches_nothing(tmp_path, rng):
    found, _, _ = without_contacts(tmp_path, rng, steps=False)
    (touches,) = found.base.contacts.values()
    assert not touches.any()


def test_contacts_that_are_stated_stay(tmp_path, rng):
    file = written_leg(tmp_path)
    log = log_of_leg(file, rng, steps=True)
    found = recording(Table("log.csv", log), load_robot(file))
    assert np.array_equal(found.base.contacts["foot"], log["contact.foot"])
    assert not any("detected" in sentence for sentence in found.warnings)


def test_without_torques_nothing_can_be_detected(tmp_path, rng):
    found, robot, _ = without_contacts(tmp_path, rng, steps=True)
    nothing = replace(found, tau=None, base=replace(found.base, contacts={}))
    with pytest.raises(
        LogError, match=r"neither a column contact\.<frame> nor torques .*0 throughout if the robot hangs"
    ):
        with_detected_contacts(nothing, robot)


@pytest.fixture
def said(tmp_path, rng):
    """The sentence on a leg, which stands by turns or hangs."""
    robot = load_robot(written_leg(tmp_path))

    def words(*, steps: bool) -> str:
        log = log_of_leg(tmp_path / "robot.urdf", rng, steps=steps)
        return stance_words(recording(Table("log.csv", log), robot), robot)

    return words


def test_rows_of_the_base_less_three_of_the_foot_are_added_while_it_stands(said):
    # By hand: of 6 rows of the base and 2 of the leg a point takes 3, half of the time; else its 2 joints are free.
    words = said(steps=True)
    assert words.startswith("log.csv: stance adds 2.5 equations per sample that hold for any contact forces")
    assert "beside 1.0 of joints free of contact" in words


def test_a_leg_that_hangs_gains_nothing(said):
    assert said(steps=False) == "log.csv: stance adds nothing, as nothing touches the ground."


@pytest.fixture
def stepping(tmp_path, rng):
    """A robot, and its recording at 500 Hz whose foot stands from 0.6 to 1.2 s, 1.8 to 2.4 s, and so on."""
    file = written_leg(tmp_path)
    robot = load_robot(file)
    return robot, recording(Table("log.csv", log_of_leg(file, rng, steps=True)), robot)


def standing(t):
    return (t % 1.2) > 0.6


def test_no_row_is_free_while_the_foot_stands_nor_a_fiftieth_of_a_second_around_it(stepping):
    robot, log = stepping
    touched = touched_rows(log, robot, log.t)
    assert touched is not None
    near = np.any([standing(log.t + shift) for shift in np.linspace(-0.019, 0.019, 20)], axis=0)
    far = ~np.any([standing(log.t + shift) for shift in np.linspace(-0.023, 0.023, 20)], axis=0)
    inside = (log.t > 0.1) & (log.t < log.t[-1] - 0.1)
    assert touched[near & inside].all()
    assert not touched[far & inside].any()


def test_an_impact_of_another_foot_leaves_out_a_moment_of_every_row(stepping):
    robot, log = stepping
    # The thigh alone carries that frame: the knee is free but for the impacts.
    contacts = {"thigh": log.base.contacts["foot"]}
    touched = touched_rows(replace(log, base=replace(log.base, contacts=contacts)), robot, log.t)
    assert touched is not None
    assert touched[:, 0].mean() > 0.5
    changes = 2 * log.t[-1] / 1.2
    assert touched[:, 1].sum() == pytest.approx(0.022 * 500 * changes, rel=0.1)


def test_the_band_of_a_swing_of_half_a_second_holds_its_filter_once_and_half(stepping):
    robot, log = stepping
    # Of 0.6 s a fiftieth is left out at both ends.
    assert band_of_swings((log,), robot, 5.0) == pytest.approx(6 / 0.56, rel=0.02)


def test_a_band_of_swings_is_no_lower_than_that_of_the_motion_up_to_a_limit(stepping):
    robot, log = stepping
    assert band_of_swings((log,), robot, 15.0) == 15.0
    assert band_of_swings((log,), robot, 60.0) == 20.0


def test_a_robot_that_hangs_has_no_edge_of_swings(stepping, tmp_path, rng):
    robot, _ = stepping
    hanging = recording(Table("log.csv", log_of_leg(tmp_path / "robot.urdf", rng)), robot)
    assert band_of_swings((hanging,), robot, 5.0) is None


def test_samples_in_the_band_are_free_where_the_whole_filter_is(stepping):
    robot, recorded = stepping
    log = process(recorded, robot, cutoff_hz=20.0)
    at = log.motion.t[log.samples][3:-3]
    reach = log.band.half / log.band.rate_hz
    # Two samples less than the margin: the times of contacts are those of samples.
    whole = np.linspace(-reach - 0.016, reach + 0.016, 99)
    free = ~np.any([standing(at + shift) for shift in whole], axis=0)
    found = log.untouched_in_band[3:-3, 1]
    assert not found[~free].any()
    assert found[free].mean() > 0.9
    assert free.sum() > 100


def test_swings_shorter_than_the_filter_are_refused(stepping):
    robot, recorded = stepping
    log = process(recorded, robot, cutoff_hz=5.0)
    with pytest.raises(LogError, match=r"no joint is free of contacts for 0\.8 s, which the filter needs at 500 Hz"):
        require_swings((log,))


def test_where_the_foot_stands_the_torque_is_that_of_the_model(stepping):
    robot, recorded = stepping
    log = process(recorded, robot, cutoff_hz=20.0)
    found = with_model_torque(robot, log)
    np.testing.assert_array_equal(found.tau[log.touched], inverse_dynamics(robot, log.motion)[log.touched])
    np.testing.assert_array_equal(found.tau[~log.touched], log.tau[~log.touched])
    assert np.abs(log.tau - found.tau)[log.touched].max() > 10.0


def with_noise(log, of_accelerometer):
    assert log.base_sensors is not None
    return replace(log, base_sensors=replace(log.base_sensors, noise=(0.0, of_accelerometer)))


def test_the_noise_of_the_bases_sensors_is_noise_of_the_torque(stepping):
    robot, recorded = stepping
    log = process(recorded, robot, cutoff_hz=20.0)
    readings = (ReadingNoise(0.0, 0.0),) * 2
    quiet = reading_error_torque(robot, with_noise(log, 0.0), readings, np.random.default_rng(1))
    noisy = reading_error_torque(robot, with_noise(log, 0.3), readings, np.random.default_rng(1)) - quiet
    # A mass point of 0.4 kg, 0.1 m from the knee, in a noise of 0.3 m/s^2 up to 50 of 250 Hz.
    assert np.std(noisy[:, 1]) == pytest.approx(0.4 * 0.1 * 0.3 * np.sqrt(50 / 250), rel=0.1)


AXES = [f"{quantity}.imu.{axis}" for quantity in ("w", "sf") for axis in "xyz"]


@pytest.fixture
def sentence(tmp_path, rng):
    """What is said, and what is certainly wrong, after a change of a good log."""
    file = written_leg(tmp_path)
    robot, log = load_robot(file), log_of_leg(file, rng, steps=True)

    def of(**changes):
        columns = log | {name.replace("__", "."): change(log) for name, change in changes.items()}
        return check_base(recording(Table("log.csv", columns), robot), robot)

    return of


def times(quantity: str, factor: float) -> dict:
    names = [name for name in AXES if name.startswith(f"{quantity}.")]
    return {name.replace(".", "__"): lambda log, name=name: factor * log[name] for name in names}


def test_a_good_log_gets_no_warning(sentence):
    assert sentence() == ((), ())


@pytest.mark.parametrize(
    ("quantity", "factor", "what", "entry"),
    [
        ("w", 180 / np.pi, "w.imu is in deg/s and not in rad/s", "w.imu.x: {from: w.imu.x, unit: deg/s}"),
        ("sf", 1 / 9.80665, "sf.imu is in g and not in m/s^2", "sf.imu.z: {from: sf.imu.z, unit: g}"),
    ],
)
def test_another_unit_is_certainly_wrong_and_its_entry_is_given(sentence, quantity, factor, what, entry):
    said, (wrong,) = sentence(**times(quantity, factor))
    assert said == ()
    assert wrong.what == what
    assert entry in wrong.mend


def test_a_base_that_hardly_tilts_shows_a_gyroscope_in_degrees(tmp_path, rng):
    file = written_leg(tmp_path)
    robot, log = load_robot(file), log_of_leg(file, rng)
    t = log["t"]
    for k, axis in enumerate("xyz"):
        log[f"w.imu.{axis}"] = 57.3 * 0.06 * np.sin(3 * t + k) + 0.01 * rng.normal(size=len(t))
        log[f"sf.imu.{axis}"] = (9.8 if axis == "z" else 0.0) + 0.03 * rng.normal(size=len(t))
    _, (wrong,) = check_base(recording(Table("log.csv", log), robot), robot)
    assert wrong.what == "w.imu is in deg/s and not in rad/s"


def test_an_accelerometer_without_gravity_is_certainly_wrong(sentence):
    mean = {f"sf__imu__{axis}": lambda log, axis=axis: log[f"sf.imu.{axis}"] * 0.05 for axis in "xyz"}
    said, (wrong,) = sentence(**mean)
    assert (said, wrong.what) == ((), "gravity was taken out of sf.imu")


def test_a_specific_force_of_another_size_is_reported_with_both_figures(sentence):
    (said,), wrong = sentence(**times("sf", 1.3))
    assert wrong == ()
    assert "sf.imu is not as large as gravity: over a second its mean is 12" in said
    assert "and gravity 9.81" in said


def test_an_accelerometer_that_points_downwards_is_reported(sentence):
    (said,), _ = sentence(**times("sf", -1.0))
    assert "sf.imu points downwards on the base, and an accelerometer reads upwards at rest" in said


def test_a_gyroscope_with_the_wrong_signs_is_reported_with_the_right_ones(tmp_path, rng):
    # Known truth: the base rolls and pitches by 0.3 rad, and the gyroscope reads that with the wrong sign.
    file = written_leg(tmp_path)
    robot, log = load_robot(file), log_of_leg(file, rng)
    t = log["t"]
    roll, pitch = 0.3 * np.sin(3 * t), 0.3 * np.sin(2 * t)
    roll_rate, pitch_rate = 0.9 * np.cos(3 * t), 0.6 * np.cos(2 * t)
    # Of roll about x after pitch about y, in the axes of the base.
    turning = (roll_rate, pitch_rate * np.cos(roll), -pitch_rate * np.sin(roll))
    upwards = 9.81 * np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    for k, axis in enumerate("xyz"):
        log[f"w.imu.{axis}"] = -turning[k] + 0.01 * rng.normal(size=len(t))
        log[f"sf.imu.{axis}"] = upwards[k] + 0.03 * rng.normal(size=len(t))
    (said,), wrong = check_base(recording(Table("log.csv", log), robot), robot)
    assert wrong == ()
    assert "w.imu and sf.imu do not turn alike" in said


@pytest.mark.parametrize(("signs", "read"), [((-1, 1, 1), "-x, y and z"), ((-1, -1, -1), "-x, -y and -z")])
def test_where_the_base_only_turns_the_right_axes_are_reported(tmp_path, rng, signs, read):
    (said,), _ = warnings_of_turns(tmp_path, rng, signs)
    assert (
        f", but only 0 % with {read} of the gyroscope in the axes of the root in place of x, y and z: correct" in said
    )


def test_a_specific_force_that_turns_faster_than_the_base_says_nothing_of_signs(tmp_path, rng):
    # By hand: no axes let a gyroscope that reads 0.3 of the turning explain it, so that accelerations turn the force.
    assert warnings_of_turns(tmp_path, rng, (-0.3, -0.3, -0.3)) == ((), ())


def warnings_of_turns(tmp_path, rng, signs):
    """What is said, and what is certainly wrong, of a base that turns alone."""
    file = written_leg(tmp_path)
    robot, log = load_robot(file), log_of_leg(file, rng)
    log = {name: values for name, values in log.items() if name not in AXES}
    t, turn = log["t"], np.eye(3)
    w = 0.6 * np.sin(2 * np.pi * np.array([0.31, 0.23, 0.4]) * t[:, None])
    up = np.empty_like(w)
    for k in range(len(t)):
        turn = turn @ pin.exp3(w[k] / 500)
        up[k] = 9.81 * turn[2]
    for k, axis in enumerate("xyz"):
        log |= {f"w.trunk.{axis}": signs[k] * w[:, k], f"sf.trunk.{axis}": up[:, k]}
    return check_base(recording(Table("log.csv", log), robot), robot)


def test_a_contact_that_says_the_contrary_is_reported(sentence):
    (said,), _ = sentence(contact__foot=lambda log: 1 - log["contact.foot"])
    assert "contact.foot seems to be inverted: the model leaves" in said


def test_the_checks_of_a_recording_hold_them(tmp_path, rng):
    file = written_leg(tmp_path)
    robot, log = load_robot(file), log_of_leg(file, rng)
    for axis in "xyz":
        log[f"w.imu.{axis}"] = np.degrees(log[f"w.imu.{axis}"])
    found = checked(recording(Table("log.csv", log), robot), robot)
    assert [fault.what for fault in found.wrong] == ["w.imu is in deg/s and not in rad/s"]
