"""Bad input of ``phantom-dyn diagnose``: exit code 2, one sentence, nothing written.

Oracle: the contract, paragraph "Bad input". What holds for every refusal is asserted by the fixture ``refusal``; each
test here adds that the sentence names file, column, row and value, and what to do.
"""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(200)


def with_cell(path: Path, line: int, column: int, text: str) -> None:
    """Replace one cell; lines count from 1 as in an editor."""
    lines = path.read_text().splitlines()
    cells = lines[line - 1].split(",")
    cells[column] = text
    lines[line - 1] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")


def change_lines(path: Path, change) -> None:
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")


# --- values of a recording ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["nan", "inf", "-inf"])
def test_a_value_that_is_not_finite(pendulum, log, refusal, text):
    with_cell(log, 81, 1, text)
    assert re.fullmatch(
        rf"log\.csv, line 81, column q\.pin is {text}: every value must be a number; repair or delete the row\.",
        refusal(pendulum, log),
    )


def test_a_value_that_no_sensor_gives(pendulum, log, refusal):
    with_cell(log, 81, 1, "1e9")
    assert re.search(
        r"log\.csv, line 81, column q\.pin is 1e\+09, which no sensor gives .*: give SI units", refusal(pendulum, log)
    )


def test_text_for_a_number(pendulum, log, refusal):
    with_cell(log, 81, 2, "high")
    assert re.search(r"log\.csv, line 81, column tau\.pin.*'high'", refusal(pendulum, log))


def test_an_empty_cell(pendulum, log, refusal):
    with_cell(log, 81, 2, "")
    assert re.search(r"log\.csv, line 81, column tau\.pin", refusal(pendulum, log))


def test_a_time_that_goes_back(pendulum, log, refusal):
    with_cell(log, 81, 0, "0.1")
    sentence = refusal(pendulum, log)
    assert re.search(r"log\.csv, line 81: the time goes back from 0\.39 s to 0\.1 s: .*sort the rows", sentence)


def test_the_same_time_with_other_values(pendulum, log, refusal):
    with_cell(log, 81, 0, "0.39")
    assert re.search(
        r"log\.csv, line 81: the time 0\.39 s is that of the row before, but q\.pin differs: .*delete one of the rows",
        refusal(pendulum, log),
    )


@pytest.mark.parametrize("change", [lambda row: row + ",1", lambda row: row.rpartition(",")[0]])
def test_rows_of_different_length(pendulum, log, refusal, change):
    change_lines(log, lambda lines: [*lines[:80], change(lines[80]), *lines[81:]])
    assert re.search(r"log\.csv, line 81.* 3 ", refusal(pendulum, log))


def test_no_rows(pendulum, log, refusal):
    change_lines(log, lambda lines: lines[:1])
    assert re.search(r"log\.csv has no rows", refusal(pendulum, log))


def test_too_few_rows(pendulum, log, refusal):
    change_lines(log, lambda lines: lines[:31])
    assert re.search(r"log\.csv has 30 rows, too few to tell anything: record at least 50", refusal(pendulum, log))


def test_too_short_a_time(pendulum, log, refusal):
    change_lines(log, lambda lines: lines[:61])
    assert re.search(r"log\.csv lasts 0\.29 s, too short .*: record at least 10 s of motion", refusal(pendulum, log))


def test_torque_zero_on_every_joint(pendulum, log, refusal):
    change_lines(log, lambda lines: [lines[0], *(line.rpartition(",")[0] + ",0" for line in lines[1:])])
    assert re.search(r"log\.csv: the torque is zero on every joint: record the torque", refusal(pendulum, log))


# --- columns of a recording --------------------------------------------------------------------------------------


def test_no_time(pendulum, log, refusal):
    change_lines(log, lambda lines: ["stamp,q.pin,tau.pin", *lines[1:]])
    sentence = refusal(pendulum, log)
    assert re.search(r"log\.csv has no column t .*its columns are stamp, q\.pin, tau\.pin: add", sentence)
    assert sentence.endswith("saved as columns.yaml:\nt: stamp")


def test_an_unknown_joint(pendulum, log, refusal):
    change_lines(log, lambda lines: ["t,q.pim,tau.pin", *lines[1:]])
    sentence = refusal(pendulum, log)
    assert re.search(r"log\.csv: column q\.pim is of the joint pim, .*the joints are pin; did you mean pin\?", sentence)


def test_a_missing_joint(arm, log, refusal):
    change_lines(log, lambda lines: [lines[0].replace("pin", "turn"), *lines[1:]])
    lacking = r"log\.csv lacks the positions of 2 of the 3 joints of arm3: q\.tilt, q\.slide: add them"
    assert re.search(lacking, refusal(arm, log))


def test_no_torque(pendulum, log, refusal):
    change_lines(log, lambda lines: [line.rpartition(",")[0] for line in lines])
    assert re.search(r"log\.csv has no torque: there is no column tau\.pin: add tau\.<joint>", refusal(pendulum, log))


def test_current_without_torque_constant(pendulum, log, refusal):
    change_lines(log, lambda lines: [lines[0].replace("tau.", "i."), *lines[1:]])
    assert re.search(r"has i\.pin but no tau\.pin, .*add torque_constant", refusal(pendulum, log))


# --- files that are no recordings --------------------------------------------------------------------------------


def test_a_name_that_no_file_can_have(pendulum, refusal):
    # The system's own limit is 255 bytes.
    sentence = refusal(pendulum, f"{'x' * 300}.csv")
    assert re.search(r"cannot be a file \(file name too long\): write a shorter one", sentence)


def test_a_link_that_leads_nowhere(pendulum, tmp_path, refusal):
    (tmp_path / "link.csv").symlink_to("nowhere.csv")
    assert refusal(pendulum, tmp_path / "link.csv").endswith(
        "link.csv is a link that leads to no file (nowhere.csv): name the file itself."
    )


def test_a_missing_log_names_the_nearest(pendulum, log, refusal):
    assert re.search(r"lag\.csv does not exist; did you mean log\.csv\?", refusal(pendulum, log.with_name("lag.csv")))


def test_a_folder_for_a_log(pendulum, tmp_path, refusal):
    (tmp_path / "bag").mkdir()
    assert re.search(
        r"bag is a folder without metadata\.yaml, so no ROS 2 bag.*: give a file", refusal(pendulum, tmp_path / "bag")
    )


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("log.csv", b"", r"log\.csv is empty: a log needs rows of numbers"),
        ("log.csv", PNG, r"log\.csv is no log"),
        ("log.npz", b"PK\x03\x04" + bytes(100), r"log\.npz is cut off or damaged .*record or copy it again"),
        ("log.parquet", b"PAR1" + bytes(100), r"log\.parquet is cut off or damaged .*record or copy it again"),
        ("log.db3", b"SQLite format 3\x00" + bytes(100), r"log\.db3 is cut off or damaged .*record or copy it again"),
        ("log.mcap", b"\x89MCAP0\r\n" + bytes(100), r"log\.mcap is cut off or damaged .*record or copy it again"),
        ("log.bag", b"#ROSBAG V2.0\n" + bytes(100), r"log\.bag is cut off or damaged .*record or copy it again"),
    ],
)
def test_a_file_that_is_no_log(pendulum, tmp_path, refusal, name, content, message):
    (tmp_path / name).write_bytes(content)
    assert re.search(message, refusal(pendulum, tmp_path / name))


def test_a_robot_for_a_log(pendulum, refusal):
    assert re.search(r"pendulum\.urdf is no log", refusal(pendulum, pendulum))


def test_half_an_npz(pendulum, tmp_path, swing, refusal):
    whole = tmp_path / "log.npz"
    np.savez(whole, **swing)
    whole.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    assert re.search(r"log\.npz is cut off or damaged", refusal(pendulum, whole))


def test_a_topic_that_the_bag_does_not_have(pendulum, tmp_path, refusal):
    store = get_typestore(Stores.ROS2_HUMBLE)
    joint_state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", joint_state.__msgtype__, typestore=store)
        stamp = store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
        one = np.zeros(1)
        state = joint_state(
            header=header(stamp=stamp, frame_id=""), name=["pin"], position=one, velocity=one, effort=one
        )
        writer.write(connection, 1, store.serialize_cdr(state, joint_state.__msgtype__))
    sentence = refusal(pendulum, tmp_path / "bag", "--topic", "/joint_state")
    assert re.search(r"has no topic /joint_state .* did you mean /joint_states\?", sentence)


def test_a_bad_log_among_good_ones(pendulum, tmp_path, log, refusal):
    bad = tmp_path / "bad.csv"
    bad.write_text(log.read_text())
    with_cell(bad, 81, 1, "nan")
    assert re.search(r"bad\.csv, line 81, column q\.pin is nan", refusal(pendulum, log, bad))


def test_a_bad_hold_out(pendulum, tmp_path, log, refusal):
    bad = tmp_path / "bad.csv"
    bad.write_text(log.read_text())
    with_cell(bad, 81, 1, "nan")
    assert re.search(r"bad\.csv, line 81, column q\.pin is nan", refusal(pendulum, log, "--hold-out", bad))


def test_the_real_command_refuses_too(pendulum, log):
    with_cell(log, 81, 1, "nan")
    words = [sys.executable, "-m", "identification.cli", "diagnose", str(pendulum), "log.csv", "--out", "out"]
    done = subprocess.run(words, capture_output=True, text=True, cwd=log.parent, check=False)
    assert (done.returncode, done.stdout, sorted(p.name for p in log.parent.iterdir())) == (2, "", ["log.csv"])
    assert done.stderr == (
        "phantom-dyn: log.csv, line 81, column q.pin is nan: every value must be a number; repair or delete the row.\n"
    )
