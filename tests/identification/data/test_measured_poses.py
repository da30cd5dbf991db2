"""Columns of measured poses of a frame. Oracle: the numbers that were written into the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from identification.data.checked_file import checked_file
from identification.data.drives.joint_torque import NoTorqueError
from identification.data.reading import read_recording
from phantom_dyn.errors import LogError


def columns(rows: int = 25) -> dict[str, np.ndarray]:
    """Poses of the arm at rest, minutes apart, without a torque."""
    k = np.arange(float(rows))
    out = {"t": 180.0 * k}
    out |= {f"q.{joint}": np.sin(k + j) for j, joint in enumerate(("turn", "tilt", "slide"))}
    out |= {f"p.tool.{axis}": np.cos(k + j) for j, axis in enumerate("xyz")}
    return out | {"o.tool.qx": np.sin(0.1 * k), "o.tool.qy": 0 * k, "o.tool.qz": 0 * k, "o.tool.qw": np.cos(0.1 * k)}


def write(folder: Path, found: dict[str, np.ndarray]) -> Path:
    path = folder / "poses.csv"
    rows = zip(*found.values(), strict=True)
    path.write_text("\n".join([",".join(found), *(",".join(repr(float(x)) for x in row) for row in rows)]) + "\n")
    return path


def test_positions_and_orientations_of_a_frame_are_read_as_they_stand(arm, tmp_path):
    given = columns()
    found = read_recording(write(tmp_path, given), arm, torque_needed=False)
    np.testing.assert_array_equal(found.positions["tool"], np.column_stack([given[f"p.tool.{a}"] for a in "xyz"]))
    turn = np.column_stack([given[f"o.tool.{a}"] for a in ("qx", "qy", "qz", "qw")])
    np.testing.assert_allclose(found.orientations["tool"], turn, atol=1e-15)


def test_poses_minutes_apart_are_no_motion_and_nothing_is_said_of_their_rate(arm, tmp_path):
    found = read_recording(write(tmp_path, columns()), arm, torque_needed=False)
    assert (found.poses_alone, found.warnings) == (True, ())


def test_where_a_torque_is_needed_poses_alone_are_refused_as_any_log_without_torque(arm, tmp_path):
    with pytest.raises(NoTorqueError, match="no torque"):
        read_recording(write(tmp_path, columns()), arm)


def test_too_few_poses_are_refused(arm, tmp_path):
    with pytest.raises(LogError, match="has 19 rows, too few poses to tell anything: record at least 20 in different"):
        read_recording(write(tmp_path, columns(19)), arm, torque_needed=False)


def test_check_says_which_poses_it_recognised(arm, tmp_path):
    path = write(tmp_path, columns())
    for robot in (arm, None):
        assert "measured positions and orientations of frame tool" in repr(checked_file(path, robot))


def test_a_pose_without_all_axes_is_refused(arm, tmp_path):
    given = columns()
    del given["o.tool.qw"]
    with pytest.raises(LogError, match=r"has no column o\.tool\.qw: an orientation needs all of qx, qy, qz, qw; add"):
        read_recording(write(tmp_path, given), arm, torque_needed=False)


def test_an_orientation_without_a_position_is_refused(arm, tmp_path):
    given = {name: values for name, values in columns().items() if not name.startswith("p.")}
    given |= {f"q_ref.{joint}": given[f"q.{joint}"] for joint in ("turn", "tilt", "slide")}
    given = {name: np.resize(values, 60) for name, values in given.items()} | {"t": np.arange(60.0)}
    with pytest.raises(LogError, match=r"has the orientation of tool and not its position: add p\.tool\.x"):
        read_recording(write(tmp_path, given), arm, torque_needed=False)


def test_a_quaternion_of_another_length_than_one_is_refused_with_its_time(arm, tmp_path):
    given = columns()
    given["o.tool.qw"][3] = 0.5
    with pytest.raises(LogError, match=r"a quaternion of length 0\.581 at t = 540 s, wanted 1"):
        read_recording(write(tmp_path, given), arm, torque_needed=False)


def test_a_frame_that_the_robot_lacks_is_refused_with_those_it_has(arm, tmp_path):
    given = {name.replace(".tool.", ".tol."): values for name, values in columns().items()}
    with pytest.raises(LogError, match=r"p\.tol\.x, \.y and \.z are a position at a frame that .* does not have"):
        read_recording(write(tmp_path, given), arm, torque_needed=False)


def test_a_misspelt_axis_is_refused_with_the_names_that_are_meant(arm, tmp_path):
    given = columns()
    given["o.tool.w"] = given.pop("o.tool.qw")
    wanted = r"an orientation is written o\.<frame>\.qx, o\.<frame>\.qy, o\.<frame>\.qz or o\.<frame>\.qw, not"
    with pytest.raises(LogError, match=wanted):
        read_recording(write(tmp_path, given), arm, torque_needed=False)


def test_a_column_map_converts_millimetres(arm, tmp_path):
    given = columns()
    given["track_x"] = 1000 * given.pop("p.tool.x")
    path, names = write(tmp_path, given), tmp_path / "columns.yaml"
    names.write_text("p.tool.x: {from: track_x, unit: mm}\n")
    found = read_recording(path, arm, columns=names, torque_needed=False)
    np.testing.assert_allclose(found.positions["tool"][:, 0], columns()["p.tool.x"], atol=1e-15)
