"""The board of submissions and its baselines."""

import json

import numpy as np
import pytest

from benchmarks.gapbench.__main__ import main
from benchmarks.gapbench.baselines.all_free import all_free
from benchmarks.gapbench.baselines.bic_search import bic_search
from benchmarks.gapbench.baselines.figaroh import figaroh
from benchmarks.gapbench.baselines.free_lag import free_lag
from benchmarks.gapbench.baselines.one_at_a_time import one_at_a_time
from benchmarks.gapbench.baselines.regression import acting_torque, driven_joints, read_motion, read_task
from benchmarks.gapbench.scoring.board import figures, json_of, judge_all, side_by_side, text_of

PARAMETERS = {"torque": 0.2}


def truth(name, kind, effect=None, joint="j1", outside=None):
    effects = [{"effect": effect, "joint": joint, "parameters": PARAMETERS, "gap_in_floors": 5.0}] if effect else []
    return {
        "id": name,
        "kind": kind,
        "robot": "planar2",
        "joints": ["j1", "j2"],
        "effects": effects,
        "outside": {"name": outside} if outside else None,
        "paired_gap": 0.0 if kind == "null" else 5.0,
        "gap_in_floors": [] if kind == "null" else [5.0],
        "noise_floor": [0.1, 0.1],
    }


TRUTHS = [
    truth("n1", "null"),
    truth("n2", "null"),
    truth("s1", "single", "coulomb_friction"),
    truth("s2", "single", "coulomb_friction", "j2"),
    truth("o1", "outside", outside="shaker"),
    truth("o2", "outside", outside="shaker"),
]


def finding(effect, joint, probability=0.95, value=0.2, std=0.01, rivals=()):
    return {
        "effect": effect,
        "joint": joint,
        "probability": probability,
        "parameters": {"torque": {"value": value, "std": std}},
        "rivals": [{"effects": [{"effect": e, "joint": j}], "probability": p} for e, j, p in rivals],
    }


ANSWERS = {
    "n1": {"verdict": "no_gap", "findings": []},
    "n2": {"verdict": "explained", "findings": [finding("payload", None)]},
    "s1": {"verdict": "explained", "findings": [finding("coulomb_friction", "j1", value=0.3)]},
    "s2": {
        "verdict": "explained",
        "findings": [finding("viscous_friction", "j2", 0.6, rivals=[("coulomb_friction", "j2", 0.4)])],
        "joints": [
            {"joint": "j1", "rms_before": 0.5, "rms_after": 0.1},
            {"joint": "j2", "rms_before": 0.5, "rms_after": 0.1},
        ],
    },
    "o1": {"verdict": "unknown", "findings": []},
    "o2": {"verdict": "explained", "findings": [finding("cogging", "j1", 0.3)]},
}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "drawn" / "answers").mkdir(parents=True)
    (tmp_path / "tool").mkdir()
    for one in TRUTHS:
        (tmp_path / "drawn" / "answers" / f"{one['id']}.json").write_text(json.dumps(one))
    for name, one in ANSWERS.items():
        (tmp_path / "tool" / f"{name}.json").write_text(json.dumps(one))
    return tmp_path


@pytest.mark.parametrize(
    ("name", "hits", "total"),
    [
        ("nulls accused", 1, 2),
        ("cause leading", 1, 2),
        ("cause listed", 2, 2),
        ("joint right", 2, 2),
        ("cause too many", 0, 2),
        ("no cause named", 0, 2),
        ("unknown outside", 1, 2),
        ("fits but wrong", 1, 3),  # of the two outside and of the single that states what is left
        ("confident and wrong", 1, 4),  # the payload of the null; two cases state no probability
        ("size within its 95 % interval", 0, 1),
    ],
)
def test_a_figure_counts_what_its_name_says(folder, name, hits, total):
    cases, said = judge_all(TRUTHS, folder / "tool")
    score = figures(cases)[name]
    assert said == []
    assert (score.hits, score.total) == (hits, total)


def test_a_size_that_is_within_its_interval_counts(folder):
    answer = {"verdict": "explained", "findings": [finding("coulomb_friction", "j1", value=0.215)]}
    (folder / "tool" / "s1.json").write_text(json.dumps(answer))
    cases, _ = judge_all(TRUTHS, folder / "tool")
    assert figures(cases)["size within its 95 % interval"].hits == 1


def test_a_case_without_an_answer_is_wrong_and_reported(folder):
    (folder / "tool" / "s1.json").unlink()
    cases, (sentence,) = judge_all(TRUTHS, folder / "tool")
    assert sentence == "s1.json is not there: the case counts as wrong; write an answer for every case."
    assert (figures(cases)["cause leading"].hits, figures(cases)["cause leading"].total) == (0, 2)


def test_a_name_that_no_cause_has_is_reported_with_the_nearest(folder):
    answer = {"verdict": "explained", "findings": [finding("coulomb_frictoin", "j1")]}
    (folder / "tool" / "s1.json").write_text(json.dumps(answer))
    _, (sentence,) = judge_all(TRUTHS, folder / "tool")
    assert sentence == "The answers name coulomb_frictoin, which no case has: did you mean coulomb_friction?"


def test_bins_of_the_calibration_hold_what_was_stated(folder):
    cases, _ = judge_all(TRUTHS, folder / "tool")
    bins = {(b["low"], b["hits"], b["total"]) for b in json_of(cases)["calibration"]}
    assert bins == {(0.3, 1, 2), (0.5, 0, 1), (0.9, 1, 2)}


def test_the_table_and_the_json_say_the_same(folder):
    cases, _ = judge_all(TRUTHS, folder / "tool")
    of = json_of(cases)["figures"]["nulls accused"]["gap >= 0"]
    assert (of["hits"], of["total"]) == (1, 2)
    assert "| nulls accused " in text_of(cases)
    assert "Cases: 6. Without a valid answer: 0." in text_of(cases)


def test_two_tools_stand_beside_each_other(folder):
    cases, _ = judge_all(TRUTHS, folder / "tool")
    header, _, *rows = side_by_side({"one": cases, "two": cases}).splitlines()
    assert [cell.strip() for cell in header.split("|")[1:-1]] == ["figure", "one", "two"]
    assert len(rows) == len(figures(cases))


def test_the_command_scores_and_writes_json(folder, capsys):
    assert main(["score", str(folder / "drawn"), str(folder / "tool"), "--json", str(folder / "score.json")]) == 0
    assert json.loads((folder / "score.json").read_text())["schema"] == "gapbench-score/1"
    assert "nulls accused" in capsys.readouterr().out


def test_the_command_tells_faults_without_the_truth(folder, capsys):
    (folder / "tool" / "n1.json").write_text(json.dumps({"verdict": "fine", "findings": []}))
    assert main(["check", str(folder / "tool")]) == 1
    out = capsys.readouterr().out
    assert 'n1.json: verdict is "fine": give one of' in out
    assert "6 answers in" in out
    assert ", 1 with faults." in out


def test_a_key_belongs_to_the_hidden_split_alone(folder, capsys):
    assert main(["draw", "hidden", str(folder / "hidden")]) == 2
    assert main(["draw", "public", str(folder / "public"), "--key-file", str(folder / "key")]) == 2
    wanted = "Hidden cases are made from a key and public ones are not: give --key-file with 'hidden' alone.\n"
    assert capsys.readouterr().err == 2 * wanted


MASS, LENGTH, ROTOR, LEVEL, GRAVITY = 1.0, 0.4, 0.01, 0.3, 9.81

URDF = f"""<robot name="p"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 {-LENGTH}"/>
<mass value="{MASS}"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-4" upper="4" effort="100" velocity="30"/><dynamics damping="0.1" friction="{LEVEL}"/></joint></robot>"""

YAML = f"torque_hold: instant\njoints:\n  j1: {{rotor_inertia: {ROTOR}}}\n"


def motion(t):
    waves = [(0.7, 2.1, 0.0), (0.4, 5.3, 1.0), (0.15, 9.7, 2.0)]
    q = sum(a * np.sin(w * t + p) for a, w, p in waves)
    v = sum(a * w * np.cos(w * t + p) for a, w, p in waves)
    return q, v, -sum(a * w**2 * np.sin(w * t + p) for a, w, p in waves)


def torque_of(t):
    q, v, a = motion(t)
    inertia = MASS * LENGTH**2 + 1e-3 + ROTOR
    return inertia * a + MASS * GRAVITY * LENGTH * np.sin(q) + 0.1 * v + LEVEL * np.sign(v)


def write_case(folder, change=0.0, late=0.0):
    """A pendulum whose drive gives ``change(v)`` beside what the model says, or acts so much later than asked."""
    rng, t = np.random.default_rng(7), np.arange(0, 8, 0.002)
    q, v, _ = motion(t)
    tau = torque_of(t + late) + (change(v) if callable(change) else change) + 0.01 * rng.standard_normal(len(t))
    folder.mkdir(parents=True)
    (folder / "robot.urdf").write_text(URDF)
    (folder / "robot.yaml").write_text(YAML)
    np.savetxt(folder / "log.csv", np.column_stack([t, q, tau]), delimiter=",", header="t,q.j1,tau.j1", comments="")
    return folder / "robot.urdf", folder / "log.csv"


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory):
    return write_case(tmp_path_factory.mktemp("rubbing") / "c1", lambda v: 0.2 * np.sign(v))


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return write_case(tmp_path_factory.mktemp("sound") / "c1")


@pytest.mark.parametrize("baseline", [one_at_a_time, all_free, free_lag])
def test_friction_is_found_at_its_size(baseline, rubbing):
    leading = baseline(*rubbing)["findings"][0]
    assert (leading["effect"], leading["joint"]) == ("coulomb_friction", "j1")
    assert leading["parameters"]["torque"]["value"] == pytest.approx(0.2, rel=0.05)


def test_the_search_lists_friction_beside_the_cause_that_contains_it(rubbing):
    # Stribeck friction with nothing that fades is Coulomb friction: one leads and the other is its rival.
    (found,) = bic_search(*rubbing)["findings"]
    listed = {found["effect"], *(rival["effects"][0]["effect"] for rival in found["rivals"])}
    assert listed == {"coulomb_friction", "stribeck_friction"}


def test_the_search_states_a_probability_for_every_cause_that_it_lists(rubbing):
    leading = bic_search(*rubbing)["findings"][0]
    listed = [leading["probability"], *(rival["probability"] for rival in leading["rivals"])]
    assert 0.9 < sum(listed) <= 1.0 + 1e-12


def test_a_late_drive_is_found_at_its_delay(tmp_path):
    (found,) = free_lag(*write_case(tmp_path / "c1", late=0.02))["findings"]
    assert found["effect"] == "input_delay"
    assert found["parameters"]["delay"]["value"] == pytest.approx(0.02, abs=0.001)


def test_a_sound_robot_leaves_no_more_than_its_noise(sound):
    # White noise of 0.01 N m at 500 Hz, of which a low pass at 20 Hz keeps a share of 20 in 250.
    task = read_task(*sound)
    scale = np.sqrt(np.mean(acting_torque(read_motion(*sound)) ** 2))
    assert np.sqrt(np.mean((task.residual * scale) ** 2)) < 2.0 * 0.01 * np.sqrt(20.0 / 250.0)


def test_the_search_accuses_no_sound_robot(sound):
    assert bic_search(*sound) == {"verdict": "no_gap", "findings": []}


def test_joints_are_those_of_the_log(sound):
    assert driven_joints(sound[1]) == ("j1",)


def test_a_file_that_no_baseline_reads_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"robot\.xml and log\.npz were given: these baselines read URDF and CSV"):
        read_motion(tmp_path / "robot.xml", tmp_path / "log.npz")


def test_a_tool_that_is_not_installed_is_named_and_writes_nothing(sound, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda *_: None)
    assert "pip install 'gapbench[figaroh]'" in figaroh(*sound)["left_out"]
    drawn = tmp_path / "drawn"
    write_case(drawn / "cases" / "c1")
    assert main(["baseline", "figaroh", str(drawn), str(tmp_path / "answers")]) == 2
    assert capsys.readouterr().err.startswith("The baseline figaroh is left out: FIGAROH is not installed")
    assert not list((tmp_path / "answers").iterdir())


def test_the_command_writes_an_answer_and_tells_what_it_cannot_read(tmp_path, capsys):
    drawn = tmp_path / "drawn"
    write_case(drawn / "cases" / "c1", lambda v: 0.2 * np.sign(v))
    (drawn / "cases" / "c2").mkdir()
    for name in ("robot.xml", "log.npz"):
        (drawn / "cases" / "c2" / name).write_text("")
    assert main(["baseline", "all_free", str(drawn), str(tmp_path / "answers")]) == 0
    said = capsys.readouterr()
    assert "1 answers of all_free" in said.out
    assert "1 cases it could not read" in said.out
    assert "all_free, c2: ValueError: robot.xml and log.npz were given" in said.err
    assert json.loads((tmp_path / "answers" / "c1.json").read_text())["seconds"] > 0.0
