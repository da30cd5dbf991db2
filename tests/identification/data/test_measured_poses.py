"""Measured poses and loops of drives."""

from pathlib import Path

import numpy as np
import pytest

from identification.data.checked_file import checked_file
from identification.data.drive_loop import DriveLoop, delay_intervals, drive_loop
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


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            lambda given: {name: x for name, x in given.items() if name != "o.tool.qw"},
            r"has no column o\.tool\.qw: an orientation needs all of qx, qy, qz, qw; add",
        ),
        (
            lambda given: given | {"o.tool.qw": np.where(given["t"] == 540.0, 0.5, given["o.tool.qw"])},
            r"a quaternion of length 0\.581 at t = 540 s, wanted 1",
        ),
        (
            lambda given: {name.replace(".tool.", ".tol."): x for name, x in given.items()},
            r"p\.tol\.x, \.y and \.z are a position at a frame that .* does not have",
        ),
        (
            lambda given: {name.replace("o.tool.qw", "o.tool.w"): x for name, x in given.items()},
            r"an orientation is written o\.<frame>\.qx, o\.<frame>\.qy, o\.<frame>\.qz or o\.<frame>\.qw, not",
        ),
    ],
    ids=["not all axes", "a quaternion of another length", "a frame that the robot lacks", "a misspelt axis"],
)
def test_a_pose_that_cannot_be_is_refused(arm, tmp_path, changed, message):
    with pytest.raises(LogError, match=message):
        read_recording(write(tmp_path, changed(columns())), arm, torque_needed=False)


def test_an_orientation_without_a_position_is_refused(arm, tmp_path):
    given = {name: values for name, values in columns().items() if not name.startswith("p.")}
    given |= {f"q_ref.{joint}": given[f"q.{joint}"] for joint in ("turn", "tilt", "slide")}
    given = {name: np.resize(values, 60) for name, values in given.items()} | {"t": np.arange(60.0)}
    with pytest.raises(LogError, match=r"has the orientation of tool and not its position: add p\.tool\.x"):
        read_recording(write(tmp_path, given), arm, torque_needed=False)


def test_a_column_map_converts_millimetres(arm, tmp_path):
    given = columns()
    given["track_x"] = 1000 * given.pop("p.tool.x")
    path, names = write(tmp_path, given), tmp_path / "columns.yaml"
    names.write_text("p.tool.x: {from: track_x, unit: mm}\n")
    found = read_recording(path, arm, columns=names, torque_needed=False)
    np.testing.assert_allclose(found.positions["tool"][:, 0], columns()["p.tool.x"], atol=1e-15)


T = np.arange(1500) / 100.0

GAIN, LIMIT = 24.0, 6.0


def moving(t: np.ndarray) -> np.ndarray:
    return 0.8 * np.sin(2 * np.pi * 0.3 * t) + 0.4 * np.sin(2 * np.pi * 0.8 * t + 1.0)


@pytest.fixture
def q() -> np.ndarray:
    """A joint that trails its reference by a tenth of a second."""
    return 0.9 * moving(T - 0.1)


def loop_of(q: np.ndarray, y: np.ndarray) -> DriveLoop:
    found = drive_loop("u", T, y, moving(T), q)
    assert found is not None
    return found


@pytest.mark.parametrize("delay", [0.013, 0.03, 0.0555])
def test_gain_and_delay_are_those_of_the_loop(q, delay, rng):
    y = GAIN * (moving(T - delay) - q) + 0.1 * rng.standard_normal(len(T))
    found = loop_of(q, y)
    assert found.gain == pytest.approx(GAIN, abs=3 * found.gain_std + 0.01)
    assert found.delay == pytest.approx(delay, abs=3 * found.delay_std)
    assert found.delay_std < 0.003
    assert not found.computed


def test_rows_at_the_limit_are_censored(q, rng):
    y = GAIN * (moving(T - 0.03) - q)
    found = loop_of(q, np.clip(y + 0.05 * rng.standard_normal(len(T)), -LIMIT, LIMIT))
    assert found.limit == pytest.approx(LIMIT)
    assert found.at_limit == pytest.approx(np.mean(np.abs(y) > LIMIT), abs=0.02)
    assert found.gain == pytest.approx(GAIN, rel=0.01)
    assert found.delay == pytest.approx(0.03, abs=0.001)


def test_the_peaks_of_an_output_are_no_limit(q):
    # Of a hundred samples a second more than one in a hundred are within a per cent of the largest.
    y = GAIN * (moving(T - 0.03) - q)
    assert np.mean(np.abs(y) > 0.985 * np.abs(y).max()) > 0.01
    assert loop_of(q, y).limit is None


def test_an_output_up_to_rounding_was_computed(q):
    found = loop_of(q, np.round(GAIN * (moving(T) - q), 3))
    assert found.computed
    assert found.delay == 0.0


def test_a_late_loop_without_noise_was_not_computed_from_the_reference(q):
    assert not loop_of(q, GAIN * (moving(T - 0.03) - q)).computed


def protected(q: np.ndarray, beyond: float = 0.2, most: float = 1.2) -> np.ndarray:
    """Output of a loop that puts out no more than ``most`` beyond an error."""
    error = moving(T - 0.03) - q
    return np.where(np.abs(error) > beyond, np.clip(GAIN * error, -most, most), GAIN * error)


def test_a_drive_that_protects_itself_has_its_error_and_its_output(q, rng):
    found = loop_of(q, protected(q) + 0.02 * rng.standard_normal(len(T)))
    assert found.drops_beyond == pytest.approx(0.2, rel=0.03)
    assert found.drops_to == pytest.approx(1.2, rel=0.03)
    assert found.dropped == pytest.approx(np.mean(np.abs(moving(T - 0.03) - q) > 0.2), abs=0.01)
    assert found.gain == pytest.approx(GAIN, rel=0.01)
    assert found.delay == pytest.approx(0.03, abs=0.001)


def test_its_law_is_that_of_the_loop(q):
    found = loop_of(q, protected(q))
    np.testing.assert_allclose(found.output_at(moving(T - 0.03) - q), protected(q), atol=0.02)


def test_a_limit_is_no_protection(q, rng):
    y = np.clip(GAIN * (moving(T - 0.03) - q) + 0.05 * rng.standard_normal(len(T)), -LIMIT, LIMIT)
    assert loop_of(q, y).dropped == 0.0


def test_bad_readings_are_no_protection(q):
    bad = q.copy()
    bad[100::90] = -np.pi
    assert loop_of(bad, GAIN * (moving(T - 0.03) - q)).dropped == 0.0


def test_a_dead_band_is_the_error_below_which_nothing_is_put_out(q):
    error = moving(T - 0.03) - q
    found = loop_of(q, np.where(np.abs(error) < 0.06, 0.0, GAIN * error))
    assert found.dead_band == pytest.approx(0.06, rel=0.1)


def test_without_a_dead_band_none_is_stated(q):
    assert loop_of(q, GAIN * (moving(T - 0.03) - q)).dead_band is None


def test_a_reference_that_is_repeated_is_held(q):
    held = moving(np.floor(T * 25.0 + 1e-9) / 25.0)
    found = drive_loop("u", T, GAIN * (held - q), held, q)
    assert found is not None
    assert found.hold == pytest.approx(0.04, rel=0.02)


def test_an_output_that_does_not_follow_the_error_has_no_loop(q, rng):
    assert drive_loop("tau", T, np.sin(7 * T) + rng.standard_normal(len(T)), moving(T), q) is None


def test_single_bad_readings_do_not_move_the_gain(q, rng):
    bad = q.copy()
    bad[[300, 900]] = -np.pi
    found = loop_of(bad, GAIN * (moving(T - 0.03) - q) + 0.05 * rng.standard_normal(len(T)))
    assert found.gain == pytest.approx(GAIN, rel=0.01)


@pytest.mark.nightly
def test_the_interval_of_the_delay_covers_it(q):
    # Deviations are of a jackknife: over noise that lasts for ten samples, three of them cover nearly always.
    inside = 0
    for seed in range(40):
        noise = np.convolve(np.random.default_rng(seed).standard_normal(len(T) + 9), np.ones(10) / 10, "valid")
        found = loop_of(q, GAIN * (moving(T - 0.03) - q) + noise)
        least, most = delay_intervals((found,), 1)
        inside += least[0] <= 0.03 <= most[0]
    assert inside >= 38


def test_a_held_reference_came_up_to_a_frame_earlier(q):
    found = loop_of(q, GAIN * (moving(T - 0.03) - q))
    (least,), (most,) = delay_intervals((found,), 1, frame=0.01)
    assert least < 0.0201
    assert most == pytest.approx(0.03, abs=0.003)


def test_a_computed_output_says_nothing_of_the_delay(q):
    least, most = delay_intervals((loop_of(q, GAIN * (moving(T) - q)),), 1)
    assert (least[0], most[0]) == (0.0, np.inf)
