"""Recordings of known truth, and the command run on them."""

import re
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from diagnosis_schema import Document
from identification.cli.main import main
from places import ROBOTS
from sines import rubbing_columns


def write(path: Path, columns: dict) -> Path:
    """A CSV of columns; nothing is rounded."""
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    return path


@pytest.fixture(scope="session")
def pendulum() -> Path:
    """A hanging rod, joint pin."""
    return ROBOTS / "pendulum.urdf"


@pytest.fixture(scope="session")
def arm() -> Path:
    """Joints turn, tilt and slide."""
    return ROBOTS / "arm3.urdf"


@pytest.fixture(scope="session")
def made_columns() -> Callable[..., dict]:
    """Makes the columns of a recording, see `rubbing_columns`."""
    return rubbing_columns


@pytest.fixture(scope="session")
def written() -> Callable[[Path, dict], Path]:
    """Writes columns as CSV, see `write`."""
    return write


@pytest.fixture(scope="session")
def swing(pendulum) -> dict:
    """Columns of a recording of the pendulum, 10 s at 200 Hz."""
    return rubbing_columns(pendulum)


@pytest.fixture
def log(tmp_path, swing) -> Path:
    """The pendulum's recording as CSV."""
    return write(tmp_path / "log.csv", swing)


@pytest.fixture
def refusal(tmp_path, capsys) -> Callable[..., str]:
    """Runs diagnose with ``--out``; asserts what holds for every refusal, and returns its sentence.

    Exit code 2, nothing on standard output, one line on standard error, and no folder made. Behind unknown names
    follows a map to copy, an entry a line.
    """

    def refuse(robot: Path | str, *words: object) -> str:
        out = tmp_path / "out"
        code = main(["diagnose", str(robot), *map(str, words), "--out", str(out)])
        captured = capsys.readouterr()
        assert (code, captured.out) == (2, "")
        assert not out.exists()
        assert captured.err.startswith("phantom-dyn: ")
        sentence, announced, entries = captured.err.partition(" as columns.yaml:\n")
        assert sentence.count("\n") == (0 if announced else 1)
        assert all(re.match(r"(# )?[\w.]+: ", line) for line in entries.splitlines())
        return captured.err.removeprefix("phantom-dyn: ").rstrip("\n")

    return refuse


@pytest.fixture(scope="session")
def document() -> Callable[[str | bytes], Document]:
    """Reads the text of a ``diagnosis.json`` and asserts the contract's schema; JSON itself knows no NaN."""

    def read(text: str | bytes) -> Document:
        found = msgspec.json.decode(text, type=Document, strict=True)
        for finding in found.findings:
            total = finding.probability + sum(rival.probability for rival in finding.rivals)
            assert 0 < total < 1 + 1e-9, finding
            assert finding.verdict == ("one_of" if finding.rivals else "supported")
            assert finding.gap_closed_interval[0] <= finding.gap_closed_interval[1]
        return found

    return read
