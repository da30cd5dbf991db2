"""phantom-dyn diagnose without torque: at rest, known changes, motion only."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from identification.cli.main import main
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.loading import load_robot
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate
from places import ROBOTS

PENDULUM = ROBOTS / "pendulum.urdf"

GAP = 0.02


@pytest.fixture
def still_log(tmp_path) -> Path:
    """At 10 Hz, a pendulum that rests half a play below either of two references."""
    (tmp_path / "robot.yaml").write_text("joints: {pin: {encoder_side: link, encoder_counts: 65536}}\n")
    side = np.repeat(np.tile([1.0, -1.0], 5), 10)
    q_ref = 0.8 * side
    rests = q_ref - 0.5 * GAP * side
    q = np.where(np.arange(100) % 10 < 2, np.concatenate([[0.0, 0.0], rests[:-2]]), rests)
    step = 2 * np.pi / 65536
    table = np.column_stack([np.arange(100) / 10.0, step * np.round(q / step), q_ref])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,q.pin,q_ref.pin", comments="")
    return tmp_path / "log.csv"


def diagnosed(still_log: Path, *more: str) -> int:
    config = still_log.with_name("robot.yaml")
    return main(["diagnose", str(PENDULUM), str(still_log), "--robot-config", str(config), "--motion-only", *more])


def test_a_play_is_named_with_its_twin_and_all_files_are_written(still_log, capsys):
    # Known truth.
    out = still_log.with_name("out")
    assert diagnosed(still_log, "--out", str(out)) == 0, capsys.readouterr().err
    document = json.loads((out / "diagnosis.json").read_text())
    (finding,) = document["findings"]
    assert (finding["effect"], finding["verdict"]) == ("backlash", "one_of")
    assert finding["parameters"]["gap"]["value"] == pytest.approx(GAP, abs=2e-4)
    assert document["joints"][0]["unit"] == "rad"
    assert "RMS position error of held-out rests" in capsys.readouterr().out
    assert "position less reference, at rest" in (out / "report.html").read_text()
    assert (out / "corrected.yaml").is_file()


def test_an_earlier_diagnosis_is_refused_at_rest(still_log, capsys):
    corrected = still_log.with_name("corrected.yaml")
    corrected.write_text(CORRECTED, encoding="utf-8")
    assert diagnosed(still_log, "--with", str(corrected)) == 2
    words = (
        "log.csv: it is judged at rest, where every rest is held out in turn, so that held-out recordings and effects"
    )
    assert words in capsys.readouterr().err


def test_many_recordings_are_judged_at_rest_where_one_would_be_and_one_that_never_moves_says_so(still_log, capsys):
    # Known truth of the first; a pendulum that stands still shows nothing of friction or inertia.
    still = np.column_stack([np.arange(2000) / 100.0, np.full(2000, 0.3), np.full(2000, 1.45)])
    np.savetxt(still_log.with_name("still.csv"), still, delimiter=",", header="t,q.pin,tau.pin", comments="")
    json_file, config = still_log.with_name("each.txt"), still_log.with_name("robot.yaml")
    words = ["diagnose", str(PENDULUM), str(still_log), str(still_log.with_name("still.csv")), "--each", "--jobs", "1"]
    assert main([*words, "--robot-config", str(config), "--json", str(json_file)]) == 0
    first, second = json.loads(json_file.read_text())["recordings"]
    assert [finding["effect"] for finding in first["diagnosis"]["findings"]] == ["backlash"]
    assert second["verdict"] == "not_testable"
    shown = " ".join(capsys.readouterr().out.split())
    assert "still.csv not_testable This recording cannot show a gap at all, as no joint moves" in shown


# What the pin has besides its model in both recordings, as an earlier diagnosis would have written it.
CORRECTED = """schema: phantom-dyn-model/1
robot: {source: pendulum.urdf, sha256: '0'}
effects:
- {effect: coulomb_friction, joint: pin, parameters: {torque: {value: 0.4, std: 0.01, unit: N m}}, gap_closed: 0.9}
adjusted: []
"""


@pytest.fixture
def two(tmp_path, pendulum, swing, made_columns, written):
    """The pendulum with 0.4 N m too much friction, twice; the second time it carries 1.5 kg 0.9 m below the pin."""
    # A motion of its own: noise that both recordings share would be structure.
    other = made_columns(pendulum, seed=1)
    q, t = other["q.pin"], other["t"]
    a = make_interp_spline(t, q, k=5).derivative(2)(t)
    loaded = other | {"tau.pin": other["tau.pin"] + 1.5 * 0.9**2 * a + 1.5 * 9.81 * 0.9 * np.sin(q)}
    return written(tmp_path / "a.csv", swing), written(tmp_path / "b.csv", loaded)


def stated(tmp_path, text):
    path = tmp_path / "recordings.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_is_known_of_all_and_of_one_recording_leaves_no_gap(two, tmp_path, pendulum):
    # Known truth: friction of the corrected model in both, and the mass in the second.
    corrected, out = tmp_path / "corrected.yaml", tmp_path / "d.json"
    corrected.write_text(CORRECTED, encoding="utf-8")
    known = stated(tmp_path, "recordings: [{file: b.csv, payload: {mass: 1.5, center: [0, 0, -0.9]}}]")
    words = ["--with", corrected, "--recordings", known, "--json", out]
    assert main(["diagnose", str(pendulum), *map(str, (*two, *words))]) == 0
    found = json.loads(out.read_text())
    assert (found["verdict"], found["findings"]) == ("no_gap", [])


def test_recordings_by_themselves_have_nothing_between_them(refusal, log, pendulum, tmp_path):
    said = refusal(pendulum, log, "--each", "--recordings", stated(tmp_path, "recordings: []"))
    assert "--recordings was given with --each" in said


CONTROLLER = "joints: {pin: {controller: {kind: pd, kp: 60, kd: 6}}}\n"


@pytest.fixture(scope="module")
def rubbing_motion() -> np.ndarray:
    """Times, positions and references, 12 s, of a pendulum that rubs more than its model."""
    robot, t = load_robot(PENDULUM), np.arange(2400) / 200.0
    q_ref = (0.6 * np.sin(1.3 * t) + 0.3 * np.sin(5.1 * t + 1.0))[:, None]
    law = position_control(t, q_ref, np.zeros_like(q_ref), kp=np.array([60.0]), kd=np.array([6.0]))
    rubs = Cause(effect_named("coulomb_friction"), "pin", np.array([1.0]))
    q = simulate(robot, (rubs,), law, t, np.zeros(1)).q + 1e-5 * np.random.default_rng(2).standard_normal((2400, 1))
    return np.column_stack([t, q, q_ref])


def written_to(folder: Path, table: np.ndarray) -> Path:
    np.savetxt(folder / "log.csv", table, delimiter=",", header="t,q.pin,q_ref.pin", comments="")
    return folder / "log.csv"


@pytest.fixture
def motion_log(tmp_path, rubbing_motion) -> Path:
    return written_to(tmp_path, rubbing_motion)


@pytest.fixture(scope="module")
def by_motion_only(tmp_path_factory, rubbing_motion) -> dict:
    """What is said of this recording with ``--motion-only``."""
    log = written_to(tmp_path_factory.mktemp("motion"), rubbing_motion)
    code, out = diagnosed_motion(log, CONTROLLER, "--motion-only")
    assert code == 0
    return json.loads(out.read_text())


def diagnosed_motion(motion_log: Path, controller: str, *more: str) -> tuple[int, Path]:
    config, out = motion_log.with_name("robot.yaml"), motion_log.with_name("diagnosis.json")
    config.write_text(controller)
    return main(
        ["diagnose", str(PENDULUM), str(motion_log), "--robot-config", str(config), "--json", str(out), *more]
    ), out


def test_a_log_of_positions_and_references_needs_no_option(motion_log, by_motion_only, capsys):
    code, out = diagnosed_motion(motion_log, CONTROLLER)
    assert code == 0, capsys.readouterr().err
    document = json.loads(out.read_text())
    assert "positions and references only" in " ".join(document["data_warnings"])
    assert document["findings"] == by_motion_only["findings"]


def test_a_log_of_positions_alone_is_refused_in_a_sentence(motion_log, capsys):
    t, q, _ = np.loadtxt(motion_log, delimiter=",", skiprows=1, unpack=True)
    np.savetxt(motion_log, np.column_stack([t, q]), delimiter=",", header="t,q.pin", comments="")
    code, out = diagnosed_motion(motion_log, "joints: {pin: {}}\n")
    words = capsys.readouterr().err
    assert code == 2
    assert "log.csv has no torque: there is no column tau.pin" in words
    assert "or the references q_ref.<joint> of its position controllers" in words
    assert not out.exists()


def test_logs_with_and_without_torque_do_not_go_together(motion_log, capsys):
    other = motion_log.with_name("other.csv")
    t, q, q_ref = np.loadtxt(motion_log, delimiter=",", skiprows=1, unpack=True)
    table = np.column_stack([t, q, q_ref, np.cos(t)])
    np.savetxt(other, table, delimiter=",", header="t,q.pin,q_ref.pin,tau.pin", comments="")
    code, _ = diagnosed_motion(motion_log, CONTROLLER, "--hold-out", str(other))
    assert code == 2
    assert "other.csv has one: diagnose them apart" in capsys.readouterr().err


def test_the_option_does_not_go_with_each(motion_log, capsys):
    code, _ = diagnosed_motion(motion_log, CONTROLLER, "--motion-only", "--each")
    assert code == 2
    assert "--motion-only does not go with --each" in capsys.readouterr().err


def test_each_diagnoses_logs_without_torque_too(motion_log, capsys):
    config = motion_log.with_name("robot.yaml")
    config.write_text("joints: {pin: {}}\n")
    code = main(["diagnose", str(PENDULUM), str(motion_log), "--robot-config", str(config), "--each", "--jobs", "1"])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert "friction" in said.out
