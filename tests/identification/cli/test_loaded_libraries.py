"""What a command loads, and which options name effects."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.first_run import AXIS, axis_recording
from identification.cli.main import main
from places import CHECKOUT, ROBOTS

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
    of_a_rest = {"identification.diagnosis.law"}
    haptics = {f"phantom_dyn.haptics.experiments.{name}" for name in ("frequency_identification", "relay")}
    assert loaded_by(diagnose, of_poses | of_a_rest | haptics | DRAWING) == set()
    assert (axis / "out" / "report.html").exists()


FILE = CHECKOUT / "examples" / "own_effect.py"

ARM = ROBOTS / "planar2.urdf"

TRUTH = 0.5


@pytest.fixture(scope="module")
def clean(tmp_path_factory, lab, planar2, written) -> Path:
    """A recording of the planar arm without a gap."""
    recording = lab.recording(planar2, lab.motion(2, 3, seconds=12.0, swing=1.5))
    columns = {"t": recording.t}
    for name, values in (("q", recording.q), ("tau", recording.tau)):
        columns |= {f"{name}.{joint}": values[:, k] for k, joint in enumerate(planar2.joint_names)}
    return written(tmp_path_factory.mktemp("clean") / "clean.csv", columns)


@pytest.fixture(scope="module")
def covered(clean) -> Path:
    """The same with bellows on the elbow, as `degrade` writes it."""
    out = clean.with_name("covered.csv")
    words = ["--effect", "bellows", "--joint", "elbow", "--set", f"coefficient={TRUTH}", "--out", str(out)]
    assert main(["degrade", str(ARM), str(clean), "--effects", str(FILE), *words]) == 0
    return out


@pytest.fixture(scope="module")
def diagnosed(covered) -> Path:
    out = covered.with_name("report")
    assert main(["diagnose", str(ARM), str(covered), "--effects", str(FILE), "--out", str(out)]) == 0
    return out


@pytest.mark.whole
def test_degrade_adds_the_law_along_the_motion(clean, covered):
    # Closed form: the drive has to give c q^3 more.
    before, after = (np.genfromtxt(file, delimiter=",", names=True) for file in (clean, covered))
    law = before["qelbow"] ** 3
    more = after["tauelbow"] - before["tauelbow"]
    assert np.corrcoef(more[50:-50], law[50:-50])[0, 1] > 0.999
    assert np.polyfit(law[50:-50], more[50:-50], 1)[0] == pytest.approx(TRUTH, rel=0.03)
    np.testing.assert_array_equal(after["taushoulder"], before["taushoulder"])


@pytest.mark.whole
def test_diagnose_names_it_with_the_size_that_was_put_in(diagnosed):
    document = json.loads((diagnosed / "diagnosis.json").read_text())
    (finding,) = document["findings"]
    found = finding["parameters"]["coefficient"]
    assert (finding["effect"], finding["joint"], document["verdict"]) == ("bellows", "elbow", "explained")
    assert abs(found["value"] - TRUTH) < 2.0 * found["std"] < 0.1 * TRUTH


@pytest.mark.whole
def test_the_models_say_that_they_have_no_place_for_it(diagnosed):
    text = "".join((diagnosed / name).read_text() for name in ("corrected.urdf", "corrected.xml", "feedforward.py"))
    assert text.count("stiff bellows") >= 3


@pytest.mark.whole
@pytest.mark.nightly
def test_with_reads_the_finding_back(covered, diagnosed, capsys):
    known = ["--with", str(diagnosed / "corrected.yaml")]
    assert main(["diagnose", str(ARM), str(covered), *known, "--effects", str(FILE)]) == 0
    assert "stiff bellows" not in capsys.readouterr().out
    assert main(["diagnose", str(ARM), str(covered), *known]) == 2
    assert "Unknown effect 'bellows'" in capsys.readouterr().err


@pytest.mark.whole
def test_compare_reads_a_diagnosis_that_names_it(diagnosed, capsys):
    assert main(["compare", str(diagnosed), str(diagnosed)]) == 0
    assert "Stiff bellows on joint elbow, coefficient" in capsys.readouterr().out


@pytest.mark.whole
@pytest.mark.parametrize("command", ["diagnose", "degrade", "view"])
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1", "mine.py defines no effect, wanted a class of LawEffect or Effect"),
        ("def", "mine.py is no Python (SyntaxError in line 1: invalid syntax)"),
        (None, "mine.py cannot be read (No such file or directory)"),
        (FILE.read_text().replace("bellows", "payload"), "Bellows has the name payload, which the catalogue"),
        (FILE.read_text().replace("theta[0] *", "1e999 *"), "class Bellows: torque gave values that are not"),
    ],
    ids=["no effect", "no Python", "no file", "taken name", "not finite"],
)  # fmt: skip
def test_a_file_that_cannot_be_used_is_refused_in_one_sentence(clean, tmp_path, capsys, command, text, said):
    if command == "view":
        pytest.importorskip("viser", reason="viser comes with make setup")
    mine = tmp_path / "mine.py"
    if text is not None:
        mine.write_text(text)
    out = tmp_path / "out.csv"
    more = ["--effect", "bellows", "--out", str(out)] if command == "degrade" else []
    assert main([command, str(ARM), str(clean), "--effects", str(mine), *more]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert not out.exists()


@pytest.fixture
def broken_package(tmp_path, monkeypatch):
    """An installed package, as pip leaves it, whose effects cannot be loaded."""
    info = tmp_path / "site" / "made_up-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: made-up\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[phantom_dyn.effects]\nmine = no_such_module:Drag\n")
    monkeypatch.syspath_prepend(tmp_path / "site")


@pytest.mark.whole
@pytest.mark.usefixtures("broken_package")
def test_a_broken_package_stops_the_commands_that_need_effects_alone(clean, capsys):
    assert main(["diagnose", str(ARM), str(clean)]) == 2
    said = capsys.readouterr().err
    assert "The plug-in mine of the package made-up cannot be loaded (ModuleNotFoundError" in said
    assert said.count("\n") == 1
    assert main(["check", str(ARM), str(clean)]) == 0


@pytest.mark.whole
@pytest.mark.usefixtures("broken_package")
def test_doctor_names_packages_that_bring_effects(capsys):
    assert main(["doctor"]) == 0
    assert "effects of installed packages: mine (made-up)" in capsys.readouterr().out
