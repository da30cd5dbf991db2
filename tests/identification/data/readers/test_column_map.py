"""Maps of columns: given, suggested, preset."""

import math
import pickle

import numpy as np
import pytest

from identification.data.readers.column_map import mapped, read_column_map
from identification.data.readers.contract_columns import UnknownNamesError
from identification.data.readers.read_table import read_table
from identification.data.readers.suggested_map import suggested_map
from identification.data.reading import read_recording
from identification.data.recording import RawTable
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot

ONE = np.linspace(1.0, 2.0, 60)


@pytest.fixture
def map_file(tmp_path):
    def write(text):
        path = tmp_path / "map.yaml"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def apply(map_file):
    """Maps a file with the columns time, pos_a, pos_b and load."""

    def run(text, **columns):
        raw = RawTable("log.csv", {"time": ONE, "pos_a": ONE, "pos_b": 2 * ONE, "load": 3 * ONE, **columns})
        return mapped(raw, read_column_map(map_file(text))).columns

    return run


def test_a_plain_name_renames(apply):
    out = apply("t: time\nq.a: pos_a\n")
    assert set(out) == {"t", "q.a", "pos_b", "load"}


@pytest.mark.parametrize(
    ("key", "entry", "factor"),
    [
        ("t", "unit: ms", 1e-3), ("t", "unit: us", 1e-6), ("t", "unit: ns", 1e-9), ("q.a", "unit: mm", 1e-3),
        ("q.a", "unit: deg", math.pi / 180), ("q_ref.a", "unit: rev", 2 * math.pi), ("v.a", "unit: rpm", math.pi / 30),
        ("v.a", "unit: deg/s", math.pi / 180), ("tau.a", "unit: Nmm", 1e-3), ("tau.a", "unit: N m", 1.0),
        ("tau.a", "unit: N", 1.0), ("i.a", "unit: mA", 1e-3), ("u.a", "unit: mV", 1e-3), ("f.tool.x", "unit: kN", 1e3),
        ("q.a", "counts: 4096", 2 * math.pi / 4096), ("tau.a", "sign: -1", -1.0),
        ("tau.a", "unit: Nmm, sign: -1", -1e-3),
        # Closed form: a gear of n multiplies torque by n and divides position and speed by it.
        ("tau.a", "gear: 100", 100.0), ("q.a", "gear: 100", 0.01), ("v.a", "gear: 100", 0.01),
    ],
)  # fmt: skip
def test_units_counts_signs_and_gears_become_si_on_the_joints_side(apply, key, entry, factor):
    np.testing.assert_allclose(apply(f"{key}: {{from: load, {entry}}}")[key], 3 * ONE * factor, rtol=1e-15)


def test_a_joint_in_the_name_stands_for_every_joint(apply):
    out = apply('q: {from: "pos_{joint}", unit: deg}')
    np.testing.assert_allclose(out["q.b"], np.deg2rad(2 * ONE))
    assert {"q.a", "q.b"} <= set(out)


def test_an_entry_written_out_wins_over_every_joint(apply):
    out = apply('q: {from: "pos_{joint}", unit: deg}\nq.a: pos_a\n')
    np.testing.assert_array_equal(out["q.a"], ONE)


def test_two_columns_can_be_exchanged(apply):
    out = apply("tau.a: tau.b\ntau.b: tau.a\n", **{"tau.a": ONE, "tau.b": 5 * ONE})
    np.testing.assert_array_equal(out["tau.a"], 5 * ONE)


def test_two_fingers_may_have_one_position(apply):
    out = apply("q.a: pos_a\nq.b: {from: pos_a, sign: -1}\n")
    np.testing.assert_array_equal(out["q.b"], -out["q.a"])


def test_ignored_columns_are_left_out(apply):
    assert "q.finger" not in apply("t: time\nignore: [q.finger]\n", **{"q.finger": ONE})


def test_a_map_makes_a_foreign_log_readable(write_csv, map_file):
    table = read_table(write_csv, columns=map_file("t: {from: ms, unit: ms}\nq.a: {from: enc, unit: deg}\n"))
    np.testing.assert_allclose(table.columns["t"], 0.01 * np.arange(60))
    np.testing.assert_allclose(table.columns["q.a"], np.deg2rad(np.arange(60)))


@pytest.fixture
def write_csv(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("ms;enc\n" + "".join(f"{10 * k};{k}\n" for k in range(60)))
    return path


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("q.a: pos_aa", r"map\.yaml: log\.csv has no column pos_aa: the columns are .*; did you mean pos_a\?"),
        ("q.a: {from: pos_a, units: deg}", r"q\.a has the unknown key units: .* did you mean unit\?"),
        ("q.a: {unit: deg}", r"q\.a does not say which column it is: add from: NAME"),
        ("q.a: {from: pos_a, unit: degree}", r"q\.a\.unit is 'degree': the units of q are .* did you mean deg\?"),
        ("q.a: {from: pos_a, unit: Nm}", r"q\.a\.unit is 'Nm': the units of q are rad, deg"),
        ("q.a: {from: pos_a, sign: 2}", r"q\.a\.sign is 2, wanted 1 or -1"),
        ("q.a: {from: pos_a, sign: x}", r"q\.a: Expected int, got str"),
        ("q.a: {from: pos_a, counts: 0}", r"q\.a\.counts is 0, wanted the counts per revolution, above 0"),
        ("q.a: {from: pos_a, counts: 9, unit: deg}", r"q\.a has both unit and counts: give one of them"),
        ("tau.a: {from: load, counts: 9}", r"tau\.a\.counts is for positions and speeds"),
        ("q.a: 5", r"q\.a is 5, wanted a column name or"),
        (
            "position.a: pos_a",
            r"position\.a is no column of a log: write t, f\.<frame>\.x/\.y/\.z, p\.<frame>.*, or one of q, tau",
        ),
        ("q: pos_a", r"q is meant for every joint, but from is 'pos_a': put {joint} into it once"),
        ('q: "enc_{joint}"', r"q takes enc_{joint}, but no column of log\.csv looks so"),
        ("ignore: q.a", r"ignore is the text 'q\.a', wanted a list of column names"),
        ("ignore: [q.z]", r"log\.csv has no column q\.z"),
        ("", r"map\.yaml is empty: a column map needs entries"),
        ("q.a: pos_a\nq.a: pos_b", "the key q.a is given twice"),
        ("q.a: [", "is not valid YAML at line"),
        ("tau.a: load\ntau.b: load", r"tau\.a and tau\.b are both from 'load': give each the column"),
        ("q.a: pos_a\ntau.a: pos_a", r"q\.a and tau\.a are both from 'pos_a'"),
    ],
)
def test_a_map_that_cannot_be_used_is_reported(apply, text, sentence):
    with pytest.raises(LogError, match=sentence):
        apply(text)


def test_a_missing_map_is_reported(tmp_path):
    with pytest.raises(LogError, match=r"no\.yaml cannot be read"):
        read_column_map(tmp_path / "no.yaml")


def test_a_map_onto_text_names_the_value(map_file):
    raw = RawTable(
        "log.csv", {"t": ONE}, problems={"enc": "log.csv, line 5, column enc holds 'x' where a number should be."}
    )
    with pytest.raises(LogError, match="line 5, column enc holds 'x'"):
        mapped(raw, read_column_map(map_file("q.a: enc")))


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("q.a: {from: load, offset: -0.5}", 3 * ONE - 0.5),
        ("q.a: {from: load, unit: deg, sign: -1, offset: 90}", np.radians(90 - 3 * ONE)),
        ("q_ref.a: {from: load, counts: 100, gear: 5, offset: 25}", 3 * ONE * 2 * np.pi / 500 + np.pi / 2),
        ("x.a: {from: load, unit: mm, offset: 1}", (3 * ONE + 1) / 1000),
    ],
)
def test_an_offset_is_added_in_the_unit_of_its_entry_after_sign_and_gear(apply, entry, expected):
    np.testing.assert_allclose(apply(entry)[entry.partition(":")[0]], expected, rtol=1e-14)


def test_an_offset_counts_for_every_joint_of_its_entry(apply):
    out = apply('q: {from: "pos_{joint}", offset: 1.5}\ntau.a: load\n')
    np.testing.assert_allclose([out["q.a"], out["q.b"]], [ONE + 1.5, 2 * ONE + 1.5], rtol=1e-15)
    numbered = apply('q: {from: "enc{number}", offset: 1.5}\n', enc1=ONE, enc2=2 * ONE)
    np.testing.assert_allclose([numbered["q.1"], numbered["q.2"]], [ONE + 1.5, 2 * ONE + 1.5], rtol=1e-15)


def test_a_map_says_what_a_controller_had_taken_out(map_file):
    found = read_column_map(
        map_file("tau: {compensated: gravity}\ntau.j: {from: a, unit: Nmm, compensated: [gravity, friction]}\n")
    )
    assert found.compensated == {"": ("gravity",), "j": ("gravity", "friction")}
    assert found.sources.keys() == {"tau.j"}


def test_a_map_says_which_low_pass_a_torque_went_through(map_file):
    found = read_column_map(map_file("tau: {low_pass: 20}\ntau.j: {from: a, low_pass: 7.5, compensated: gravity}\n"))
    assert (found.low_pass, found.compensated) == ({"": 20.0, "j": 7.5}, {"j": ("gravity",)})
    assert found.sources.keys() == {"tau.j"}


def test_a_map_says_how_late_a_torque_was_recorded(map_file):
    found = read_column_map(map_file("tau: {late: 0.01}\ntau.j: {from: a, low_pass: 7.5, late: 0.002}\n"))
    assert (found.late, found.low_pass) == ({"": 0.01, "j": 0.002}, {"j": 7.5})


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("t: {from: a, gear: 2}", "leave it out"),
        ("q.j: {from: a, gear: 0}", "above 0"),
        *(
            (
                f"{key}: {{from: load, offset: 1}}",
                rf"map\.yaml: {key}\.offset is for positions \(q, q_ref, x\): leave it out\.",
            )
            for key in ("tau.a", "v.a", "t")
        ),
        ("q.a: {from: load, offset: 1e9}", r"q\.a\.offset is 1e\+09, wanted the position at which the log has zero\."),
        ("q.a: {from: load, offset: much}", r"Expected float, got str - at \$\.offset"),
        ("q.j: {late: 0.01}", r"is for torques: write tau: \{late: 0\.01\}"),
        ("tau: {late: -0.01}", r"late is -0\.01, wanted the time by which it is late \[s\], above 0"),
        ("q.j: {low_pass: 20}", r"is for torques: write tau: \{low_pass: 20\}"),
        ("tau: {low_pass: 0}", "low_pass is 0, wanted the cut-off in Hz, above 0"),
        ("tau: {low_pass: yes}", "low_pass is true, wanted the cut-off in Hz"),
        ("tau: {low_pass: fast}", "low_pass is the text 'fast', wanted the cut-off in Hz"),
        ("tau: {compensated: weight}", r"compensated is the text 'weight', wanted gravity or friction, or \[gravity"),
        ("tau: {compensated: [friction, 3]}", r"compensated is the list \['friction', 3\], wanted gravity or friction"),
        (f"? {'x' * 3000}\n: {{compensated: gravity}}", r"yaml: x{79}…\.compensated is for torques"),
        (f"? {'x' * 3000}\n: {{from: null}}", r"yaml: x{79}…\.from is empty"),
        ("tau: {compensated: []}", r"compensated is the list \[\], wanted gravity or friction"),
        ("q.j: {compensated: gravity}", r"is for torques: write tau: \{compensated: gravity\}"),
    ],
)
def test_a_gear_offset_low_pass_or_compensation_that_means_nothing_is_refused(map_file, entry, said):
    with pytest.raises(LogError, match=said):
        read_column_map(map_file(entry + "\n"))


ARM = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint")

RTDE = ("target_q", "actual_q", "actual_current", "target_moment")


@pytest.mark.parametrize(
    ("names", "joints", "lines"),
    [
        (  # UR over RTDE; what the controller asks for is no measured torque
            ["timestamp", *(f"{name}_{k}" for name in RTDE for k in range(3))],
            ARM,
            ["t: timestamp", *(f"q.{j}: actual_q_{k}" for k, j in enumerate(ARM)),
             *(f"i.{j}: actual_current_{k}" for k, j in enumerate(ARM)),
             *(f"q_ref.{j}: target_q_{k}" for k, j in enumerate(ARM))],
        ),
        (  # a gripper beyond the joints of the arm
            ["t", *(f"{name}{k}" for name in ("q", "tau") for k in range(4))],
            ARM,
            [*(f"q.{j}: q{k}" for k, j in enumerate(ARM)), *(f"tau.{j}: tau{k}" for k, j in enumerate(ARM)),
             "# q3: of no joint of the robot (a gripper?)"],
        ),
        (  # names of joints, units in the names
            ["time_ms", "elbow_pos_deg", "elbow_torque_Nmm", "elbow_vel"],
            ("elbow",),
            ["t: {from: time_ms, unit: ms}", "q.elbow: {from: elbow_pos_deg, unit: deg}",
             "tau.elbow: {from: elbow_torque_Nmm, unit: Nmm}"],
        ),
        (  # units in which small and large letters meet, which parts words elsewhere
            ["Time [ms]", "J1 angle [deg]", "J2 angle [deg]", "J1 torque [mNm]", "J2 torque [mNm]"],
            ("j1", "j2"),
            ['t: {from: "Time [ms]", unit: ms}', 'q.j1: {from: "J1 angle [deg]", unit: deg}',
             'q.j2: {from: "J2 angle [deg]", unit: deg}', 'tau.j1: {from: "J1 torque [mNm]", unit: mNm}',
             'tau.j2: {from: "J2 torque [mNm]", unit: mNm}'],
        ),
        (
            ["t", "q", "motorCurrent_mA"],
            ("pin",),
            ["q.pin: q", "i.pin: {from: motorCurrent_mA, unit: mA}"],
        ),
        (  # a LeRobot episode, one column a joint
            ["timestamp", *(f"{n}_{j}_flex" for n in ("state", "action") for j in ("elbow", "wrist")), "frame_index"],
            ("elbow_flex", "wrist_flex"),
            ["t: timestamp", "q.elbow_flex: state_elbow_flex", "q.wrist_flex: state_wrist_flex",
             "q_ref.elbow_flex: action_elbow_flex", "q_ref.wrist_flex: action_wrist_flex"],
        ),
        (  # one joint needs no name; signs that YAML reads as its own are quoted
            ["t", "position[0]", "effort[0]"],
            ("pin",),
            ['q.pin: "position[0]"', 'tau.pin: "effort[0]"'],
        ),
        (  # numbers from one on, and names of joints that end in numbers
            ["Time", "jointPos2", "jointPos1", "jointTorque1", "jointTorque2"],
            ("j1", "j2"),
            ["t: Time", "q.j1: jointPos1", "q.j2: jointPos2", "tau.j1: jointTorque1", "tau.j2: jointTorque2"],
        ),
        (  # MuJoCo's names beside those of joints
            ["time", *(f"{n}_{j}" for n in ("qpos", "qvel", "qfrc_actuator", "ctrl") for j in ("pan", "lift"))],
            ("pan", "lift"),
            ["t: time", "q.pan: qpos_pan", "q.lift: qpos_lift", "tau.pan: qfrc_actuator_pan",
             "tau.lift: qfrc_actuator_lift", "q_ref.pan: ctrl_pan", "q_ref.lift: ctrl_lift"],
        ),
        (["stamp", "q.elbow", "tau.elbow"], ("elbow",), ["t: stamp"]),  # what has the right name needs no entry
        (
            ["time", "pos_elbow"],
            ("elbow", "wrist"),
            ["t: time", "q.elbow: pos_elbow", "# q.wrist: which column?",
             "# tau.<joint>: which columns hold torques (or i.<joint> motor currents, u.<joint> voltages)?"],
        ),
        *(  # short words for torques
            (
                ["time", "pos_1", f"{word}_1", "pos_2", f"{word}_2"],
                ("a", "b"),
                ["t: time", "q.a: pos_1", "q.b: pos_2", f"tau.a: {word}_1", f"tau.b: {word}_2"],
            )
            for word in ("eff", "tq", "load")
        ),
    ],
    ids=["rtde", "gripper", "units", "mNm", "mA", "lerobot", "one", "camel", "mujoco", "right", "lacking", "eff", "tq",
         "load"],
)  # fmt: skip
def test_the_names_of_known_recorders_are_understood(names, joints, lines):
    assert suggested_map(names, joints).splitlines() == lines


@pytest.mark.parametrize("names", [["price", "size"], ["pos_elbow"], ["time", "price"], ["time", "q_1", "q_2"]])
def test_of_names_that_tell_too_little_nothing_is_suggested(names):
    assert suggested_map(names, ("elbow",)) == ""


def test_a_refusal_of_unknown_names_ends_with_a_map_that_can_be_used(tmp_path, robots):
    # Known truth: the columns as they were written.
    robot = load_robot(robots / "pendulum.urdf")
    (joint,) = robot.joint_names
    t = np.arange(200) * 5.0
    table = np.column_stack([t, np.rad2deg(np.sin(t / 500)), np.cos(t / 500)])
    names = f"time_ms,{joint}_deg,{joint}_torque"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=names, comments="")
    with pytest.raises(LogError, match=r"has none of a log's columns.*A map to begin with") as refusal:
        read_recording(tmp_path / "log.csv", robot)
    (tmp_path / "columns.yaml").write_text(str(refusal.value).partition("columns.yaml:\n")[2])
    read = read_recording(tmp_path / "log.csv", robot, columns=tmp_path / "columns.yaml")
    np.testing.assert_allclose(read.t, t / 1000)
    np.testing.assert_allclose(read.q[:, 0], np.sin(t / 500), atol=1e-9)


def test_the_refusal_comes_through_another_process_whole():
    # Oracle: pickle, by which processes of a batch send it.
    sent = pickle.loads(pickle.dumps(UnknownNamesError("no column t.", ("a", "b"))))
    assert (str(sent), sent.names) == ("no column t.", ("a", "b"))


def test_a_map_that_was_given_gets_no_other(tmp_path, robots):
    (tmp_path / "log.csv").write_text("time,pin_pos\n0,1\n1,2\n")
    (tmp_path / "columns.yaml").write_text("t: time\n")
    with pytest.raises(LogError, match="has no column q") as refusal:
        read_recording(tmp_path / "log.csv", load_robot(robots / "pendulum.urdf"), columns=tmp_path / "columns.yaml")
    assert "\n" not in str(refusal.value)
