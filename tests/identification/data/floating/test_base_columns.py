"""Columns of a base that is not bolted down. Oracle: the numbers that were put in."""

from dataclasses import replace

import numpy as np
import pytest

from floating_leg import URDF, written_leg
from identification.data.floating.base_columns import carrying_joints
from identification.data.reading import recording
from identification.data.recording import Table
from identification.data.stretches import part_of
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot

N = 100
T = np.arange(N) * 0.01


@pytest.fixture
def leg(tmp_path):
    return load_robot(written_leg(tmp_path))


def table(**changes) -> Table:
    """Columns of the leg; None leaves one out."""
    columns = {"t": T, "q.hip": np.sin(T), "q.knee": np.cos(T), "tau.hip": T, "tau.knee": 1 - T}
    for k, axis in enumerate("xyz"):
        columns |= {f"w.imu.{axis}": T + k, f"sf.trunk.{axis}": 9.0 - T + k}
    columns["contact.foot"] = (T > 0.5).astype(float)
    columns |= {name.replace("__", "."): values for name, values in changes.items()}
    return Table("log.csv", {name: values for name, values in columns.items() if values is not None})


def test_readings_stand_by_their_frames(leg):
    found = recording(table(), leg).base
    assert found is not None
    assert (found.gyroscope, found.accelerometer) == ("imu", "trunk")
    np.testing.assert_array_equal(found.w, np.column_stack([T, T + 1, T + 2]))
    np.testing.assert_array_equal(found.sf, np.column_stack([9 - T, 10 - T, 11 - T]))
    np.testing.assert_array_equal(found.contacts["foot"], T > 0.5)


def test_a_part_of_a_recording_has_its_part_of_the_readings(leg):
    found = part_of(recording(table(), leg), slice(40, 60)).base
    assert found is not None
    np.testing.assert_array_equal(found.w[:, 0], T[40:60])
    np.testing.assert_array_equal(found.contacts["foot"], T[40:60] > 0.5)


def test_a_robot_that_is_bolted_down_does_not_use_them_and_says_so(tmp_path):
    (tmp_path / "robot.urdf").write_text(URDF)
    found = recording(table(), load_robot(tmp_path / "robot.urdf"))
    assert found.base is None
    assert found.warnings == (
        "log.csv: the columns w., sf., contact. are not used, as leg is bolted down: write base: floating into "
        "robot.yaml if its base moves.",
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({f"w__imu__{axis}": None for axis in "xyz"}, r"no columns w\.<frame>\.x, \.y and \.z, and leg is not bolted"),
        ({f"sf__trunk__{axis}": None for axis in "xyz"}, r"no columns sf\.<frame>.*: add what its accelerometer"),
        ({"w__imu__y": None}, r"no column w\.imu\.y: the angular velocity of a gyroscope needs its three axes"),
        ({f"w__trunk__{axis}": T for axis in "xyz"}, r"has w\. of imu, trunk: give that of one frame on the base"),
        ({"contact__toe": T * 0}, r"column contact\.toe: leg has no frame of that name that a joint moves: .*foot"),
        ({"contact__imu": T * 0}, r"column contact\.imu: leg has no frame of that name that a joint moves"),
        ({"contact__foot": T}, r"column contact\.foot is 0\.01 at t = 0\.01 s, wanted 0 or 1: a force is no contact"),
        ({f"f__foot__{axis}": T for axis in "xyz"}, r"forces f\.<frame>, which are in world axes, and the base of leg"),
    ],
)
def test_what_is_missing_or_of_no_use_is_refused(leg, changes, said):
    with pytest.raises(LogError, match=said):
        recording(table(**changes), leg)


def test_a_sensor_on_the_leg_is_refused_with_its_column(leg):
    moved = {f"w__imu__{axis}": None for axis in "xyz"} | {f"w__shank__{axis}": T for axis in "xyz"}
    with pytest.raises(LogError, match=r"log\.csv, column w\.shank\.x: shank does not move with the base, as knee"):
        recording(table(**moved), leg)


def test_joints_of_which_no_contact_is_known_are_named(leg):
    found = recording(table(contact__foot=None, contact__thigh=T * 0), leg)
    assert found.warnings == (
        "log.csv: no contact.<frame> is of a frame that knee moves: it is assumed that nothing touches these links.",
    )


def test_a_force_puts_a_torque_on_the_joints_before_it(leg):
    assert carrying_joints(leg, "foot").tolist() == [True, True]
    assert carrying_joints(leg, "thigh").tolist() == [True, False]


def test_torques_without_gravity_are_refused_on_a_base_that_turns(leg):
    with pytest.raises(LogError, match=r"compensated: gravity is for robots that are bolted down, and the base of leg"):
        recording(replace(table(), compensated={"": ("gravity",)}), leg)
