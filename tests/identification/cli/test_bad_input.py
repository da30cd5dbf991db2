"""Bad input of ``phantom-dyn diagnose``: exit code 2, one sentence, nothing written.

Oracle: the contract, paragraph "Bad input". What holds for every refusal is asserted by the fixture ``refusal``; each
test here adds that the sentence names file, column, row and value, and what to do.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

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


def test_text_for_a_number(pendulum, log, refusal):
    with_cell(log, 81, 2, "high")
    assert re.search(r"log\.csv, line 81, column tau\.pin.*'high'", refusal(pendulum, log))


# --- columns of a recording --------------------------------------------------------------------------------------


def test_no_time(pendulum, log, refusal):
    change_lines(log, lambda lines: ["stamp,q.pin,tau.pin", *lines[1:]])
    sentence = refusal(pendulum, log)
    assert re.search(r"log\.csv has no column t .*its columns are stamp, q\.pin, tau\.pin: add", sentence)
    assert sentence.endswith("saved as columns.yaml:\nt: stamp")


def test_a_missing_joint(arm, log, refusal):
    change_lines(log, lambda lines: [lines[0].replace("pin", "turn"), *lines[1:]])
    lacking = r"log\.csv lacks the positions of 2 of the 3 joints of arm3: q\.tilt, q\.slide: add them"
    assert re.search(lacking, refusal(arm, log))


# --- files that are no recordings --------------------------------------------------------------------------------


def test_a_link_that_leads_nowhere(pendulum, tmp_path, refusal):
    (tmp_path / "link.csv").symlink_to("nowhere.csv")
    assert refusal(pendulum, tmp_path / "link.csv").endswith(
        "link.csv is a link that leads to no file (nowhere.csv): name the file itself."
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


@pytest.mark.parametrize("words", [(), ("--hold-out",)], ids=["a log", "a hold-out"])
def test_a_bad_log_among_good_ones(pendulum, tmp_path, log, refusal, words):
    bad = tmp_path / "bad.csv"
    bad.write_text(log.read_text())
    with_cell(bad, 81, 1, "nan")
    assert re.search(r"bad\.csv, line 81, column q\.pin is nan", refusal(pendulum, log, *words, bad))


def test_the_real_command_refuses_too(pendulum, log):
    with_cell(log, 81, 1, "nan")
    words = [sys.executable, "-m", "identification.cli", "diagnose", str(pendulum), "log.csv", "--out", "out"]
    done = subprocess.run(words, capture_output=True, text=True, cwd=log.parent, check=False)
    assert (done.returncode, done.stdout, sorted(p.name for p in log.parent.iterdir())) == (2, "", ["log.csv"])
    assert done.stderr == (
        "phantom-dyn: log.csv, line 81, column q.pin is nan: every value must be a number; repair or delete the row.\n"
    )
