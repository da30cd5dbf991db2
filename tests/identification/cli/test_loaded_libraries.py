"""Which libraries a command loads: each takes a part of the time that a small command takes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.first_run import AXIS, axis_recording

DRAWING = {"matplotlib", "plotly", "cvxpy", "clarabel", "pandas", "xarray", "yourdfpy", "trimesh", "rich", "joblib"}


def loaded_by(code: str, libraries: set[str]) -> set[str]:
    """Those of some libraries that a fresh process has loaded behind some code."""
    words = f"import sys\n{code}\nprint(*(set(sys.modules) & {libraries!r}), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    return set(done.stderr.splitlines()[-1].split())


@pytest.fixture(scope="module")
def axis(tmp_path_factory) -> Path:
    """A folder with a robot of one joint and a recording of it."""
    folder = tmp_path_factory.mktemp("axis")
    (folder / "axis.urdf").write_text(AXIS)
    axis_recording(folder / "log.csv")
    return folder


def command(*words: str | Path) -> str:
    return f"from identification.cli.main import main\nmain({[str(word) for word in words]!r})"


def test_the_whole_line_is_imported_without_what_only_some_runs_need():
    line = "import identification.cli.main, identification.pipeline, identification.reporting.page.diagnosis_report"
    assert loaded_by(line, {"numba", "mujoco", "statistics", "jinja2"} | DRAWING) == set()


def test_a_check_loads_what_it_needs(axis):
    check = command("check", axis / "axis.urdf", axis / "log.csv")
    assert loaded_by(check, {"mujoco", "jinja2", "identification.pipeline"} | DRAWING) == set()


def test_a_diagnosis_of_one_joint_loads_what_it_needs(axis):
    diagnose = command("diagnose", axis / "axis.urdf", axis / "log.csv", "--out", axis / "out")
    of_poses = {f"identification.{name}" for name in ("geometry.diagnose_poses", "geometry.result")}
    of_a_rest = {f"identification.diagnosis.{name}" for name in ("law", "rest_law")}
    haptics = {f"phantom_dyn.haptics.experiments.{name}" for name in ("frequency_identification", "relay")}
    assert loaded_by(diagnose, of_poses | of_a_rest | haptics | DRAWING) == set()
    assert (axis / "out" / "report.html").exists()
