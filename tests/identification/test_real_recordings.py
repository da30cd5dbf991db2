# pyright: reportMissingImports=false
"""Public recordings of servos and of a brushless motor: their logs, their robot files, and what a diagnosis finds."""

import csv
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from identification.data.reading import read_recording
from identification.pipeline import diagnose
from identification.scenarios.at_rest.diagnose_at_rest import diagnose_at_rest, judged_at_rest
from identification.scenarios.recordings_file import read_changed, read_changes
from phantom_dyn import load_robot
from phantom_dyn.errors import LogError
from places import CHECKOUT

EXAMPLES = CHECKOUT / "examples"
DATA = EXAMPLES / "data"


@pytest.fixture(scope="module", autouse=True)
def examples() -> Iterator[None]:
    """Examples import each other by name, as their folder is on the path when one of them is called."""
    sys.path.insert(0, str(EXAMPLES))
    yield
    sys.path.remove(str(EXAMPLES))


@pytest.fixture
def mirror(data_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PHANTOM_DYN_DATA", str(data_folder))
    return data_folder


def test_the_torque_of_the_xl330_is_that_of_a_motor_at_its_voltage(mirror, tmp_path):
    # Closed form: k/R (duty cycle * supply - k * speed), speed by differences of the position.
    from real_logs import write_xl330_logs

    (log,) = [path for path in write_xl330_logs(tmp_path) if path.stem == "r10h28m32"]
    tau = read_recording(log, load_robot(DATA / "xl330" / "robot.urdf")).tau
    with np.load(mirror / "bam_xl330" / "bam_xl330.npz") as runs:
        t, q, load, volts = (
            runs[f"r10h28m32__{name}"].astype(float) for name in ("timestamp", "position", "load", "input_volts")
        )
    wanted = 0.3867 / 4.017 * (load / 885 * volts - 0.3867 * np.gradient(q, t))
    assert tau is not None
    np.testing.assert_allclose(tau[:, 0], wanted, atol=1e-6)


def test_the_drive_of_the_xl330_is_on_throughout_every_log(mirror, tmp_path):
    # Oracle: the recording's own flag; without drive the bridge is open and the voltage gives no current.
    from real_logs import write_xl330_logs

    logs = write_xl330_logs(tmp_path)
    with np.load(mirror / "bam_xl330" / "bam_xl330.npz") as runs:
        assert [runs[f"{log.stem}__torque_enable"].all() for log in logs] == [True] * 4


@pytest.mark.nightly
@pytest.mark.whole
def test_the_gap_of_the_xl330_is_friction_of_its_servo(mirror, tmp_path):
    # Published: Coulomb and viscous friction at least (Duclusaud et al. 2025); load and rotor inertia are in the model.
    from real_logs import write_xl330_logs

    robot = load_robot(DATA / "xl330" / "robot.urdf")
    found = diagnose(robot, tuple(read_recording(log, robot) for log in write_xl330_logs(tmp_path))).findings
    assert found
    assert {finding.effect for finding in found} <= {
        "coulomb_friction",
        "viscous_friction",
        "direction_dependent_friction",
        "presliding_friction",
        "stribeck_friction",
        "load_dependent_friction",
    }


def test_where_the_xl330_moves_its_friction_grows_with_the_load(mirror, tmp_path):
    # Published: friction that grows with the load fits better than Coulomb and viscous friction alone (Duclusaud 2025).
    from real_logs import write_xl330_logs

    robot, logs = load_robot(DATA / "xl330" / "robot.urdf"), write_xl330_logs(tmp_path)
    changes = read_changes(DATA / "xl330" / "recordings.yaml", logs, robot.joint_names)
    recordings = tuple(read_changed(log, robot, change) for log, change in zip(logs, changes, strict=True))
    assert all(recording.excluded for recording in recordings)
    laws = {finding.effect for finding in diagnose(robot, recordings, changes=changes).findings}
    assert "load_dependent_friction" in laws
    assert all(name.endswith("_friction") for name in laws)


def test_counts_of_the_brushless_motor_become_radians_and_amperes_stay(mirror, tmp_path):
    # Oracle: the recording itself, 8192 counts a turn.
    from real_logs import write_odrive_logs

    robot, columns = load_robot(DATA / "odrive_cogging" / "robot.urdf"), DATA / "odrive_cogging" / "columns.yaml"
    read = read_recording(write_odrive_logs(tmp_path)[0], robot, columns=columns)
    with np.load(mirror / "odrive_cogging" / "slow_and_pull.npz") as runs:
        counts, current = runs["slow2_nocomp_1__pos_counts"], runs["slow2_nocomp_1__iq_A"]
    assert read.tau is not None
    np.testing.assert_allclose(read.q[:, 0], counts * 2 * np.pi / 8192)
    np.testing.assert_allclose(read.tau[:, 0], current)


@pytest.mark.whole
def test_cogging_of_the_brushless_motor_has_the_orders_of_its_published_map(mirror, tmp_path):
    # Published: 7, 28, 14, 36 and 12 cycles a turn lead the map of holding currents; all others are below 0.1 A there.
    from real_logs import write_odrive_logs

    robot, columns = load_robot(DATA / "odrive_cogging" / "robot.urdf"), DATA / "odrive_cogging" / "columns.yaml"
    logs = write_odrive_logs(tmp_path)
    found = diagnose(robot, tuple(read_recording(log, robot, columns=columns) for log in logs)).findings
    (cogging,) = [finding for finding in found if finding.effect == "cogging"]
    orders, amplitudes = (cogging.parameters[name].value for name in ("order", "amplitude"))
    assert isinstance(orders, list)
    assert isinstance(amplitudes, list)
    strongest = sorted(zip(amplitudes, orders, strict=True), reverse=True)[:5]
    assert {order for _, order in strongest} == {7.0, 28.0, 14.0, 36.0, 12.0}


def test_the_load_register_of_the_sts3215_is_its_own_law_of_the_error(mirror):
    # Why it is left out of the log. Oracle: eight thousandths of the supply a count beyond a dead band of one count.
    with (mirror / "robonine_backlash" / "single.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    target, position, load = (
        np.array([float(row[name]) for row in rows]) for name in ("target pos (5)", "pos (5)", "load (5)")
    )
    error, duty = target - position, np.where(load >= 1024, load - 1024, -load)
    still = (np.abs(error) < 20) & (np.abs(np.gradient(position)) < 0.1)
    assert np.median(np.abs(duty - 8 * (error - np.sign(error)))[still]) < 1e-9


def test_the_sts3215_rests_apart_by_the_published_width_for_play_or_give(mirror, tmp_path):
    # Published: 14.78 counts under load, where play and the give of its controller are mixed.
    from real_logs import write_sts3215_log

    robot, columns = load_robot(DATA / "sts3215" / "robot.urdf"), DATA / "sts3215" / "columns.yaml"
    recording = read_recording(write_sts3215_log(tmp_path)[0], robot, columns=columns, torque_needed=False)
    assert judged_at_rest(robot, (recording,))
    (finding,) = diagnose_at_rest(robot, (recording,)).findings
    assert (finding.effect, finding.verdict) == ("backlash", "one_of")
    assert [effect.effect for rival in finding.rivals for effect in rival.effects] == ["transmission_compliance"]
    gap = finding.parameters["gap"].value
    assert isinstance(gap, float)
    assert gap * 4096 / (2 * np.pi) == pytest.approx(14.78, abs=3.0)


def test_the_so101_is_read_without_gripper_and_without_torque(mirror, tmp_path):
    # Oracle: the recording itself.
    from real_logs import write_so101_logs

    robot = load_robot("example:so101", config=DATA / "so101" / "robot.yaml")
    (log,) = [path for path in write_so101_logs(tmp_path) if path.stem == "multisine"]
    read = read_recording(log, robot, torque_needed=False)
    with np.load(mirror / "sage_so101" / "so101.npz") as runs:
        first = runs["multisine__q_cmd"][0]
    assert read.tau is None
    assert read.q_ref is not None
    commanded = dict(zip(read.joint_names, read.q_ref[0], strict=True))
    assert commanded["shoulder_pan"] == pytest.approx(first[0])
    assert commanded["wrist_roll"] == pytest.approx(first[4])


@pytest.mark.parametrize("name", ["xl330", "odrive_cogging", "sts3215"])
def test_the_robot_files_of_the_recordings_load_without_a_warning(name, recwarn):
    assert load_robot(DATA / name / "robot.urdf").nv == 1
    assert not recwarn.list


FINDING = {
    "effect": "coulomb_friction",
    "joint": "j1",
    "parameters": {"torque": {"value": 0.5123, "std": 0.01, "unit": "N m"}},
    "share": 0.913,
    "rivals": [],
}
EXPLAINED = {
    "verdict": "explained",
    "findings": [FINDING],
    "unexplained": {"fraction_of_explainable": 0.02, "structured": False, "where": {"joint": None, "regime": None}},
}


def test_a_cell_of_the_table_gives_size_and_share_of_a_finding():
    from real_words import said

    assert said(EXPLAINED) == "Explained. Coulomb friction: j1 (torque 0.512 N m; 91 % of the gap)."


def test_a_cell_of_the_table_names_rivals_with_their_probability():
    from real_words import said

    rivals = [{"effects": [{"effect": "viscous_friction", "joint": "j1"}], "probability": 0.25}]
    cell = said({**EXPLAINED, "findings": [{**FINDING, "probability": 0.75, "rivals": rivals}]})
    assert "91 % of the gap; probability 0.75, or viscous friction (0.25)" in cell


def test_a_cell_of_the_table_gives_orders_of_cogging_largest_first():
    from real_words import said

    lists = {"order": [12.0, 7.0], "amplitude": [0.2, 0.9], "phase": [0.0, 1.0]}
    parameters = {name: {"value": value, "std": [0.0, 0.0], "unit": "A"} for name, value in lists.items()}
    cell = said({**EXPLAINED, "findings": [{**FINDING, "effect": "cogging", "parameters": parameters}]})
    assert "7 a turn with 0.9 A, 12 a turn with 0.2 A" in cell


def test_a_cell_of_the_table_gives_no_unit_to_a_ratio():
    from real_words import said

    finding = {**FINDING, "parameters": {"ratio": {"value": 0.328, "std": 0.04, "unit": "1"}}}
    assert "(ratio 0.328; 91 %" in said({**EXPLAINED, "findings": [finding]})


def test_a_cell_of_the_table_tells_what_rests():
    from real_words import said

    rest = {"fraction_of_explainable": 0.65, "structured": True, "where": {"joint": "j1", "regime": "everywhere"}}
    cell = said({"verdict": "unknown", "findings": [], "unexplained": rest})
    assert cell == "Unknown: most of the gap has no name in the catalogue (65 % of what the motion predicts, j1)."


def test_a_cell_of_many_findings_gives_places_and_marks_those_with_rivals():
    from real_words import said

    rivals = [{"effects": [{"effect": "viscous_friction", "joint": "j1"}], "probability": 0.25}]
    many = [{**FINDING, "joint": f"j{k}", "rivals": rivals if k == 2 else []} for k in range(1, 6)]
    wanted = "Explained. Coulomb friction: j1, j2 `*`, j3, j4, j5. With `*`: the data leave rivals."
    assert said({**EXPLAINED, "findings": many}) == wanted


def test_a_cell_of_many_findings_gives_the_size_of_a_delay_of_the_whole_robot():
    from real_words import said

    delay = {"delay": {"value": 0.0325, "std": 0.002, "unit": "s"}}
    many = [{**FINDING, "effect": "input_delay", "joint": None, "parameters": delay}]
    many += [{**FINDING, "joint": f"j{k}"} for k in range(1, 6)]
    assert "an input delay: whole robot (delay 0.0325 s)." in said({**EXPLAINED, "findings": many})


def test_a_rest_is_not_reported_where_the_gap_is_explained():
    from real_words import said

    rest = {"fraction_of_explainable": 0.01, "structured": True, "where": {"joint": "j1", "regime": "everywhere"}}
    assert said({"verdict": "explained", "findings": [], "unexplained": rest}) == "Explained."


def test_the_table_replaces_what_is_between_its_markers():
    from real_recordings import BEGIN, END, with_table

    assert with_table(f"a\n{BEGIN}\nold\n{END}\nb", f"{BEGIN}\nnew\n{END}") == f"a\n{BEGIN}\nnew\n{END}\nb"


def test_a_text_without_the_markers_is_refused():
    from real_recordings import with_table

    with pytest.raises(LogError, match="has to hold <!-- real:begin -->"):
        with_table("no markers", "table")


def test_an_unknown_recording_is_refused_with_the_known_names():
    from real_recordings import main

    with pytest.raises(LogError, match="there is no recording pump: give some of emps, ur10"):
        main(["pump"])


def test_the_table_says_why_the_command_refused_a_recording(tmp_path):
    # Known truth: a log of one sample.
    from published_truth import Truth
    from real_recordings import RealRecording, row

    log = tmp_path / "log.csv"
    log.write_text("t,q.axis,tau.axis\n0,0,0\n")
    cell = row(
        RealRecording("x", "title", "model", "published", Truth(()), lambda: "emps", lambda folder: (log,)), tmp_path
    )
    assert cell.startswith("| title | model | published | refused: log.csv")


@pytest.mark.parametrize(
    ("published", "word"),
    [
        ([("coulomb_friction", "j1", 0.5)], "right: 1 of 1 causes, 1 of 1 sizes"),
        ([("coulomb_friction", "j1", 0.65)], "right: 1 of 1 causes, 1 of 1 sizes"),
        ([("coulomb_friction", "j1", 0.7)], "partly: 1 of 1 causes, 0 of 1 sizes"),
        ([("viscous_friction", "j1", None)], "right: 1 of 1 causes"),
        ([("coulomb_friction", "j2", 0.5)], "wrong: 0 of 1 causes, 0 of 1 sizes"),
        ([("coulomb_friction", "j1", None), ("payload", None, None)], "partly: 1 of 2 causes"),
        ([("coulomb_friction", None, None), ("payload", None, None), ("backlash", "j1", None)], "wrong: 1 of 3 causes"),
        ([], "right: nothing to find"),
    ],
)
def test_a_diagnosis_agrees_with_what_is_published_by_a_stated_rule(published, word):
    # Oracle: the rule in the module's first lines, by hand; 0.5123 N m is found, viscous friction is its rival.
    from published_truth import Cause, Truth, judged

    rivals = [{"effects": [{"effect": "viscous_friction", "joint": "j1"}], "probability": 0.25}]
    found = {**EXPLAINED, "findings": [{**FINDING, "probability": 0.75, "rivals": rivals}]}
    causes = tuple(Cause((effect,), joint, size, "coulomb") for effect, joint, size in published)
    assert judged(Truth(causes), found) == word


@pytest.mark.parametrize(
    ("size", "parameter", "untested", "word"),
    [
        (0.2, "torque", (), "right: 1 of 2 causes, 1 of 1 sizes, 1 below what can be seen"),
        (0.4, "torque", (), "partly: 1 of 2 causes, 1 of 2 sizes"),
        (0.2, "ratio", (), "partly: 1 of 2 causes, 1 of 2 sizes"),
        (0.4, "torque", ("j2",), "right: 1 of 2 causes, 1 of 1 sizes, 1 below what can be seen"),
        (0.4, "torque", ("j3",), "partly: 1 of 2 causes, 1 of 2 sizes"),
    ],
)
def test_a_cause_below_a_stated_bound_need_not_be_found(size, parameter, untested, word):
    # Oracle: the rule by hand; the bound on j2 is 0.3 N m, and 0.5 N m are found on j1.
    from published_truth import Cause, Truth, judged

    found = {
        **EXPLAINED,
        "findings": [{**FINDING, "probability": 1.0, "rivals": []}],
        "bounds": [{"effect": "coulomb_friction", "joint": "j2", "parameter": parameter, "below": 0.3}],
        "not_testable": [{"effect": "coulomb_friction", "joint": joint, "why": "it rests"} for joint in untested],
    }
    causes = tuple(Cause(("coulomb_friction",), joint, s, "coulomb") for joint, s in (("j1", 0.5), ("j2", size)))
    assert judged(Truth(causes), found) == word


def test_a_cause_that_cannot_be_makes_a_diagnosis_wrong_only_if_it_is_stated_as_certain():
    from published_truth import Cause, Truth, judged

    truth = Truth((Cause(("coulomb_friction",)),), ("coulomb_friction",))
    assert judged(truth, {"findings": [{**FINDING, "probability": 0.91}]}).startswith("wrong")
    assert judged(truth, {"findings": [{**FINDING, "probability": 0.9}]}).startswith("right")
