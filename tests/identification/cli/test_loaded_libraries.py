"""Which libraries a command loads: each takes a part of the time that a small command takes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.first_run import AXIS, axis_recording

DRAWING = {"matplotlib", "plotly", "cvxpy", "clarabel", "pandas", "xarray", "yourdfpy", "trimesh", "rich", "joblib"}
# What takes 20 to 60 ms each, for a function or two that `phantom_dyn.signals` has as well.
OF_SCIPY = {f"scipy.{part}" for part in ("fft", "interpolate", "ndimage", "optimize", "signal", "sparse", "spatial")}


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
    assert (
        loaded_by(line, {"scipy", "numba", "mujoco", "statistics", "jinja2", "importlib.metadata"} | DRAWING) == set()
    )


def test_a_check_loads_what_it_needs(axis):
    check = command("check", axis / "axis.urdf", axis / "log.csv")
    assert (
        loaded_by(check, {"scipy.special", "mujoco", "jinja2", "identification.pipeline"} | OF_SCIPY | DRAWING) == set()
    )


def test_a_diagnosis_of_one_joint_loads_what_it_needs(axis):
    diagnose = command("diagnose", axis / "axis.urdf", axis / "log.csv", "--out", axis / "out")
    of_poses = {f"identification.{name}" for name in ("geometry.diagnose_poses", "geometry.result")}
    of_a_rest = {f"identification.diagnosis.{name}" for name in ("law", "rest_law")}
    haptics = {f"phantom_dyn.haptics.experiments.{name}" for name in ("frequency_identification", "relay")}
    assert loaded_by(diagnose, of_poses | of_a_rest | haptics | OF_SCIPY | DRAWING) == set()
    assert (axis / "out" / "report.html").exists()


def started(axis: Path, behind: str) -> str:
    """What some code prints in the process of a check, when that is over."""
    words = ["x", "check", str(axis / "axis.urdf"), str(axis / "log.csv")]
    code = f"import sys\nsys.argv = {words!r}\nfrom identification.cli.__main__ import started\nstarted()\n{behind}"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_a_command_does_not_load_the_parts_of_numpy_that_only_their_names_are_asked_of(axis):
    behind = "print('numpy.f2py' in sys.modules, 'numpy.f2py.f2py2e' in sys.modules)"
    assert started(axis, behind).splitlines()[-1] == "True False"


def test_such_a_part_of_numpy_loads_when_something_uses_it(axis):
    behind = "import numpy\nprint(numpy.testing.assert_equal(1, 1), numpy.f2py.__all__)"
    assert started(axis, behind).splitlines()[-1] == "None ['run_main', 'get_include']"
