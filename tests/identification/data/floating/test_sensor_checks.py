"""Mistakes in what the sensors of a base read. Oracle: the mistake that was made in a log of known truth."""

import numpy as np
import pinocchio as pin
import pytest

from floating_leg import log_of_leg, written_leg
from identification.data.checks.check_recording import checked
from identification.data.floating.sensor_checks import check_base
from identification.data.reading import recording
from identification.data.recording import Table
from phantom_dyn.model.loading import load_robot

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


def test_a_good_log_is_told_nothing(sentence):
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


def test_a_specific_force_of_another_size_is_told_with_both_figures(sentence):
    (said,), wrong = sentence(**times("sf", 1.3))
    assert wrong == ()
    assert "sf.imu is not as large as gravity: over a second its mean is 12" in said
    assert "and gravity 9.81" in said


def test_an_accelerometer_that_points_downwards_is_told(sentence):
    (said,), _ = sentence(**times("sf", -1.0))
    assert "sf.imu points downwards on the base, and an accelerometer reads upwards at rest" in said


def test_a_gyroscope_with_the_wrong_signs_is_told_with_the_right_ones(sentence):
    (said,), wrong = sentence(**times("w", -1.0))
    assert wrong == ()
    assert "w.imu and sf.imu do not turn alike" in said


@pytest.mark.parametrize(("signs", "read"), [((-1, 1, 1), "-x, y and z"), ((-1, -1, -1), "-x, -y and -z")])
def test_where_the_base_only_turns_the_right_axes_are_told(tmp_path, rng, signs, read):
    (said,), _ = told_of_turns(tmp_path, rng, signs)
    assert f", and with {read} of the gyroscope in the axes of the root, not x, y and z, 0 %: correct" in said


def test_a_specific_force_that_turns_faster_than_the_base_says_nothing_of_signs(tmp_path, rng):
    # By hand: no axes let a gyroscope that reads 0.3 of the turning explain it, so that accelerations turn the force.
    assert told_of_turns(tmp_path, rng, (-0.3, -0.3, -0.3)) == ((), ())


def told_of_turns(tmp_path, rng, signs):
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


def test_a_contact_that_says_the_contrary_is_told(sentence):
    (said,), _ = sentence(contact__foot=lambda log: 1 - log["contact.foot"])
    assert "contact.foot seems to say the contrary: where it is 0 the model leaves" in said


def test_the_checks_of_a_recording_hold_them(tmp_path, rng):
    file = written_leg(tmp_path)
    robot, log = load_robot(file), log_of_leg(file, rng)
    for axis in "xyz":
        log[f"w.imu.{axis}"] = np.degrees(log[f"w.imu.{axis}"])
    found = checked(recording(Table("log.csv", log), robot), robot)
    assert [fault.what for fault in found.wrong] == ["w.imu is in deg/s and not in rad/s"]
