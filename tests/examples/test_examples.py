"""Every example runs, and so do those of the README and of docs/; oracles are published values and known truths."""

import json
import re
import runpy
import shutil
import sys

import numpy as np
import pytest

from called_example import EXAMPLES, ended, printed
from identification.cli.main import main
from identification.data.readers.column_map import read_column_map
from identification.scenarios.recordings_file import read_changes
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.model.robot_config import RobotConfig, read_robot_config
from phantom_dyn.motion import Motion
from places import CHECKOUT

README = (CHECKOUT / "README.md").read_text()
DOCS = CHECKOUT / "docs"
ARM_LOG = EXAMPLES / "data" / "arm" / "log.csv"
PENDULUM = CHECKOUT / "tests" / "robots" / "pendulum.urdf"

# What the examples call has tests of its own, which check its annotations.
pytestmark = pytest.mark.whole


def test_the_readme_example_finds_the_friction_that_was_put_in(rubbing_pendulum, monkeypatch, capsys):
    # Known truth: Coulomb friction on the pin.
    (block,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    monkeypatch.chdir(rubbing_pendulum)
    names = {}
    exec(block, names)
    assert "1. Coulomb friction on joint pin: " in capsys.readouterr().out
    assert list(names["table"].effect) == ["coulomb_friction"]
    assert (rubbing_pendulum / "report" / "report.html").is_file()


def test_the_notebook_runs_and_finds_both_loads(tmp_path, monkeypatch, capsys):
    # Known truth: 0.4 kg in the shipped log, 0.6 kg in the simulation. Run as Jupyter does, in the notebook's folder.
    monkeypatch.setenv("MPLBACKEND", "agg")
    shutil.copytree(EXAMPLES, tmp_path / "examples")
    monkeypatch.chdir(tmp_path / "examples")
    cells = json.loads((EXAMPLES / "first_diagnosis.ipynb").read_text())["cells"]
    names = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    sizes = [names[name].findings[0].parameters["mass"].value for name in ("diagnosis", "later")]
    assert sizes == pytest.approx([0.4, 0.6], rel=0.05)
    # The second motion is designed, and the design depends on how a processor rounds.
    said = capsys.readouterr().out
    assert re.search(r"A payload, mass: 0\.398 \(0\.3\d+ to 0\.4\d+\) kg -> 0\.\d+ \(.*\) kg, changed", said)
    assert float(names["maps"].apparent_mass.min()) > 0.0
    # What the sentence of the README says that the notebook shows.
    (shown,) = re.findall(r"where `dyn\.` also offers (.*?)\s\(\[a", README, flags=re.DOTALL)
    text = "".join("".join(cell["source"]) for cell in cells)
    assert [name for name in re.findall(r"`(\w+)`", shown) if f"dyn.{name}(" not in text] == []


def test_own_robot_finds_the_friction_that_was_put_in(rubbing_pendulum):
    # Known truth: 1.5 N m.
    out = printed("own_robot.py", rubbing_pendulum / "robot.urdf", rubbing_pendulum / "log.csv")
    found = re.search(r"^coulomb_friction pin .*'torque': Value\(value=([\d.]+)", out, flags=re.MULTILINE)
    assert found
    assert float(found[1]) == pytest.approx(1.5, rel=0.05)


def test_own_robot_says_what_it_takes():
    assert ended("own_robot.py", "robot.urdf").err.startswith("own_robot.py takes a robot file and a log")


def test_own_robot_refuses_a_log_that_is_not_there_in_one_sentence(tmp_path):
    said = ended("own_robot.py", PENDULUM, tmp_path / "log.csv").err
    assert "does not exist" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("page", [CHECKOUT / "README.md", *sorted(DOCS.glob("*.md"))], ids=lambda page: page.name)
def test_the_files_that_a_page_links_are_there(page):
    linked = re.findall(r"\]\((?!https?:)([^)#]+)\)|src=\"([^\"]+)\"", page.read_text())
    assert [name for pair in linked for name in pair if name and not (page.parent / name).exists()] == []


def test_the_readme_is_one_page():
    assert len(README.splitlines()) <= 150


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("data/*/*.yaml")), ids=lambda path: f"{path.parent.name}")
def test_the_files_beside_the_real_recordings_are_valid(path):
    # Oracle: the readers, which raise where a key or value is not theirs; every file says something.
    if path.name == "recordings.yaml":
        logs = re.findall(r"file: (\S+)", path.read_text())
        assert [change.file for change in read_changes(path, logs, ())] == logs
    elif path.name == "columns.yaml":
        assert read_column_map(path) is not None
    else:
        assert read_robot_config(path) != RobotConfig()


def test_the_column_map_of_emps_fits_the_recording_with_clear_names(data_folder, capsys):
    log, columns = data_folder / "emps" / "emps_train.npz", EXAMPLES / "data" / "emps" / "columns.yaml"
    main(["check", str(log), "--robot", "emps", "--columns", str(columns)])
    assert capsys.readouterr().out.startswith("emps_train.npz: 24841 samples, 24.84 s, 1000 Hz")


def test_the_log_of_emps_holds_newtons_and_not_volts(data_folder, mirror, tmp_path):
    # Oracle: the same recording decoded by others, with the force in newtons.
    printed("emps_log.py", tmp_path, **mirror)
    log = np.loadtxt(tmp_path / "emps.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(log[:, 2], np.load(data_folder / "emps" / "emps_train.npz")["force"], rtol=1e-8)


@pytest.fixture(scope="module")
def emps(mirror, tmp_path_factory) -> str:
    """What the example prints of EMPS."""
    return printed("diagnose_emps.py", tmp_path_factory.mktemp("emps"), **mirror)


def test_diagnose_emps_names_friction_beside_its_published_values(emps):
    assert "friction on joint axis" in emps
    assert re.search(r"torque_positive .* N +20\.1440|torque .* N +20\.3935", emps)


def test_the_readme_shows_the_answer_that_is_printed_for_its_log(capsys, monkeypatch):
    # Oracle: the run itself, by the command that the page shows.
    (command,) = re.findall(r"```\nphantom-dyn (diagnose examples/.*?) --out report/\n```", README)
    (answer,) = re.findall(r"```\n(The gap between robot and model .*?)```", README, flags=re.DOTALL)
    (rows,) = re.findall(r"```\n(t,q\.turn,.*?)```", README, flags=re.DOTALL)
    monkeypatch.chdir(CHECKOUT)
    assert main([*command.split(), "--quick"]) == 0
    assert capsys.readouterr().out.startswith(answer)
    assert (EXAMPLES / "data" / "arm" / "log.csv").read_text().startswith(rows)


def test_the_log_of_the_readme_is_what_its_script_writes(tmp_path):
    # Oracle: the numbers of the file; another processor may round the last digits otherwise.
    printed("arm_log.py", tmp_path / "log.csv")
    ours, shipped = (np.loadtxt(path, delimiter=",", skiprows=1) for path in (tmp_path / "log.csv", ARM_LOG))
    np.testing.assert_allclose(ours, shipped, atol=1e-3)


@pytest.mark.nightly
def test_the_moving_picture_of_the_readme_is_what_its_script_draws(tmp_path):
    # Oracle: the points of the file, to a pixel; the last digits of a simulation hang on the processor.
    printed("arm_picture.py", tmp_path / "arm.svg")
    ours, shipped = (
        re.findall(r"values='([^']*)'", path.read_text()) for path in (tmp_path / "arm.svg", DOCS / "arm.svg")
    )
    points = [[np.array(re.split("[ ;,]", one), dtype=float) for one in lines] for lines in (ours, shipped)]
    np.testing.assert_allclose(points[0], points[1], atol=1.0)


def test_the_readme_shows_what_is_found_on_emps(emps):
    # Oracle: the run itself.
    (shown,) = re.findall(r"friction of ([\d.]+ ± [\d.]+) and ([\d.]+ ± [\d.]+) N,", README)
    assert all(value in emps for value in shown)


def test_identify_emps_prints_estimates_within_half_a_per_cent_of_the_published_ones(mirror, tmp_path):
    # Published: mass and friction of both models; the offset and the relative errors have wider limits of their own.
    out = printed("identify_emps.py", tmp_path, **mirror)
    rows = re.findall(r"(?:\.m|torque\w*|coefficient\w*) +([\d.]+) \+- .* published +([\d.]+)", out)
    values = np.array([[float(found), float(published)] for found, published in rows])
    assert len(values) == 9
    np.testing.assert_allclose(values[:, 0], values[:, 1], rtol=0.005)


def findings(summary: str) -> list[str]:
    """The first words of every numbered finding of a summary."""
    return re.findall(r"^  \d+\. ((?:[\w-]+ ?)+)", re.sub(r"\n     +", " ", summary), flags=re.MULTILINE)


@pytest.fixture(scope="module")
def ur10(mirror) -> list[str]:
    """What the example finds on the UR10."""
    return findings(printed("diagnose_ur10.py", **mirror))


@pytest.mark.nightly
def test_every_joint_of_the_ur10_has_friction(ur10):
    # Published: refitting friction lowers the error of each joint to a third at most.
    joints = {line.split()[-1] for line in ur10 if " friction on " in line}
    assert joints == set(load_robot("example:ur10").joint_names)


@pytest.mark.nightly
def test_the_inertias_of_the_ur10s_file_are_wrong(ur10):
    assert any(line.startswith("Wrong inertial parameters") for line in ur10)


@pytest.mark.nightly
def test_the_ur10_carries_nothing(ur10):
    # A load lowers the error a little; the inertias explain what it would.
    assert not [line for line in ur10 if "payload" in line]


@pytest.fixture(scope="module")
def double_pendulum(mirror, tmp_path_factory) -> list[str]:
    """What the example prints of the plain model, and of the makers' own file."""
    out = printed("double_pendulum.py", tmp_path_factory.mktemp("double_pendulum"), **mirror)
    return out.split("== design_C1_identified.urdf")


@pytest.mark.nightly
def test_double_pendulum_names_coulomb_friction_where_it_is_not_modelled(double_pendulum):
    # Published: Coulomb torques of 0.16 and 0.12 that the plain model lacks.
    plain = {line for line in findings(double_pendulum[0]) if "Coulomb" in line}
    assert plain == {f"Coulomb friction on Joint{k}" for k in (1, 2)}


@pytest.mark.nightly
def test_double_pendulum_names_the_inertias_that_the_makers_file_has_wrong(double_pendulum):
    # Published: it counts m r^2 of both links twice.
    assert findings(double_pendulum[1])[0].startswith("Wrong inertial parameters")


def test_base_parameters_ur10_prints_the_rank_that_numpy_finds():
    # Oracle: singular values of the same kind of regressor.
    robot = load_robot("example:ur10")
    q, v, a = np.random.default_rng(2).uniform(-2, 2, (3, 300, robot.nv))
    W = rigid_body_regressor(robot, Motion(np.arange(300.0), q, v, a)).reshape(300 * robot.nv, -1)
    rank = np.linalg.matrix_rank(W / np.maximum(np.linalg.norm(W, axis=0), 1e-6), tol=1e-4)
    assert f"ur10: {rank} base parameters of 60" in printed("base_parameters_ur10.py")


@pytest.mark.parametrize(
    "script", ["emps_log.py", "diagnose_emps.py", "identify_emps.py", "diagnose_ur10.py", "double_pendulum_logs.py"]
)
def test_without_recording_and_network_an_example_says_in_one_sentence_how_to_get_it(script, offline):
    done = ended(script, **offline)
    assert done.code == 1
    assert re.fullmatch(r"(could not fetch .*: take it from|.* is published in another form at) .*\n", done.err)


FOLDER_TAKERS = (
    "diagnose_emps.py",
    "identify_emps.py",
    "emps_log.py",
    "double_pendulum.py",
    "double_pendulum_logs.py",
    "haptics_gallery.py",
    "joystick_walk.py",
    "phantom_maps.py",
    "so101_dataset.py",
)


@pytest.mark.parametrize("script", FOLDER_TAKERS)
@pytest.mark.parametrize("word", ["--help", "--no-such-option"])
def test_an_option_is_no_folder_to_write_into(script, word, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(EXAMPLES)
    monkeypatch.setattr(sys, "argv", [str(EXAMPLES / script), word])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(EXAMPLES / script), run_name="__main__")
    assert f"usage: {script} [-h] [FOLDER]" in "".join(capsys.readouterr())
    assert (ended.value.code, list(tmp_path.iterdir())) == (0 if word == "--help" else 2, [])
