"""robot.yaml: its keys, its defaults and its refusals.

Strict YAML: what is read, what is refused, and that settings are read back as written.
"""

import contextlib
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.files.settings_file import load_mapping, number_at
from phantom_dyn.model.files.strict_yaml import load_yaml, settings_text
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Actuator, Controller, Tolerance
from phantom_dyn.model.robot_config import read_robot_config
from places import ROBOTS

EVERY_KEY = """
gravity: [0, 0, -9.81]
torque_hold: zoh
torque_source: sensor
tolerance: {inertia: 0.1, friction: 0, rotor_inertia: 1e-1}
joints:
  turn: {rotor_inertia: 2.0e-3, gear_ratio: 100, torque_constant: 0.06, torque_limit: 5.0,
         encoder_counts: 65536, encoder_side: link, actuated: false, resistance: 4.0, voltage_limit: 7.4,
         controller: {kind: pd, kp: 40, kd: 1.0, delay: 0.0}}
payload_frame: tool
"""


SERVO = """
joints:
  turn: {torque_constant: 0.01, gear_ratio: 100, resistance: 2, voltage_limit: 12, controller: {kind: duty, gain: 2}}
"""


@pytest.fixture
def load(tmp_path):
    """The three-joint arm with a robot.yaml of the given text."""

    def write(text: str, robot: str = "arm3.urdf"):
        path = tmp_path / "config.yaml"
        path.write_text(text)
        return load_robot(ROBOTS / robot, config=path)

    return write


def test_every_key_of_a_drive_is_kept(load):
    assert load(EVERY_KEY).actuators[0] == Actuator(
        0.002, 100, 0.06, 5, 65536, "link", False, 4, 7.4, Controller("pd", 40, 1, 0)
    )


def test_a_share_of_the_supply_is_a_torque_at_standstill(load):
    # Closed form: constant 1 N m/A at the joint, 2 ohm, 12 V: 6 N m for the whole supply, 0.5 N m s/rad of back-EMF.
    stated = "gain: 2, limit: 0.5, drops_beyond: 0.2, drops_to: 0.1, reference_delay: 0.03"
    controller = load(SERVO.replace("gain: 2", stated)).actuators[0].controller
    assert controller == Controller(
        "duty", 12.0, 0.5, 0.0, 0.03, limit=3.0, drops_beyond=0.2, drops_to=0.6000000000000001
    )
    np.testing.assert_allclose(controller.stiff_part(np.array([0.1, 0.19, 0.21, -0.3])), [1.2, 2.28, 0.6, -0.6])
    np.testing.assert_allclose(controller.stiff_part(np.array([0.1])), 12.0 * 0.1)


def test_every_key_of_the_robot_is_kept(load):
    robot = load(EVERY_KEY)
    kept = (robot.torque_hold, robot.torque_source, robot.tolerance, robot.payload_frame)
    assert kept == ("zoh", "sensor", Tolerance(0.1, 0.0, 0.1), "tool")


def test_an_empty_file_gives_the_defaults(load):
    robot = load("# nothing\n")
    kept = (robot.torque_hold, robot.torque_source, robot.tolerance, robot.actuators)
    assert kept == ("instant", "command", Tolerance(), (Actuator(), Actuator(), Actuator()))


def test_gravity_replaces_that_of_the_model(load):
    assert load("gravity: [1, 2, 3]").model.gravity.linear.tolist() == [1, 2, 3]


def test_rotor_inertia_becomes_the_armature(load):
    assert load("joints: {tilt: {rotor_inertia: 1e-3}}").model.armature.tolist() == [0, 1e-3, 0]


@pytest.mark.parametrize(("text", "hold"), [("reference_hold: zoh", "zoh"), ("gravity: [0, 0, -9.81]", None)])
def test_references_are_held_where_it_is_said(load, text, hold):
    assert load(text).reference_hold == hold


def test_the_file_beside_the_robot_is_read(tmp_path):
    (tmp_path / "robot.urdf").write_bytes((ROBOTS / "pendulum.urdf").read_bytes())
    (tmp_path / "robot.yaml").write_text("torque_hold: zoh")
    assert load_robot(tmp_path / "robot.urdf").torque_hold == "zoh"


def test_a_configuration_that_is_given_replaces_the_one_beside_the_robot(tmp_path):
    (tmp_path / "robot.urdf").write_bytes((ROBOTS / "pendulum.urdf").read_bytes())
    (tmp_path / "robot.yaml").write_text("torque_hold: zoh")
    (tmp_path / "other.yaml").write_text("torque_source: current")
    robot = load_robot(tmp_path / "robot.urdf", config=tmp_path / "other.yaml")
    assert (robot.torque_hold, robot.torque_source) == ("instant", "current")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gravty: [0, 0, 1]", r"config\.yaml: there is no key gravty, the keys are gravity, .*did you mean gravity\?"),
        ("joints: {turn: {gear: 3}}", r"there is no key joints\.turn\.gear, .*did you mean gear_ratio\?"),
        ("joints: {turn: {controller: {ki: 1}}}", r"no key joints\.turn\.controller\.ki, the keys are kind, kp, kd"),
        ("tolerance: {inertai: 1}", r"no key tolerance\.inertai, the keys are .*did you mean inertia\?"),
        ("gravity: [0, 9.81]", r"gravity is the list \[0, 9\.81\], wanted three numbers"),
        ("gravity: 9.81", r"gravity is 9\.81, wanted three numbers"),
        ("gravity: [0, 0, low]", r"gravity is the list .*, wanted three numbers"),
        ("gravity: [0, 0, .nan]", r"gravity\[2\] is nan, wanted a finite number"),
        ("joints: {turn: {torque_limit: .inf}}", r"joints\.turn\.torque_limit is inf, wanted a finite number"),
        ("torque_hold: yes", r"torque_hold is true, wanted one of zoh, instant"),
        ("torque_source: motor", r"torque_source is the text 'motor', wanted one of command, current, sensor"),
        ("tolerance: {inertia: -0.1}", r"tolerance\.inertia is -0\.1, wanted a number of 0 or more"),
        ("tolerance: 0.1", r"tolerance is 0\.1, wanted a table with some of the keys inertia, friction"),
        ("joints: {turn: {rotor_inertia: -1}}", r"joints\.turn\.rotor_inertia is -1, wanted a number of 0 or more"),
        ("joints: {turn: {rotor_inertia: big}}", r"turn\.rotor_inertia is the text 'big', wanted a number of 0 or"),
        ("joints: {turn: {gear_ratio: 0}}", r"joints\.turn\.gear_ratio is 0, wanted a number other than 0"),
        ("joints: {turn: {torque_limit: 0}}", r"joints\.turn\.torque_limit is 0, wanted a number above 0"),
        ("joints: {turn: {encoder_counts: 0}}", r"joints\.turn\.encoder_counts is 0, wanted a number above 0"),
        ("joints: {turn: {encoder_side: both}}", r"encoder_side is the text 'both', wanted one of motor, link"),
        ("joints: {turn: {actuated: 1}}", r"joints\.turn\.actuated is 1, wanted true or false"),
        ("joints: {turn: {controller: {kind: pid}}}", r"turn\.controller\.kind is the text 'pid', wanted one of pd"),
        ("joints: {turn: {controller: {kp: -4}}}", r"joints\.turn\.controller\.kp is -4, wanted a number of 0 or more"),
        ("joints: {turn: {controller: {kind: duty}}}", r"turn\.controller\.gain is missing, wanted the share"),
        (
            "joints: {turn: {controller: {kind: duty, gain: 2}}}",
            r"turn\.torque_constant is missing: a controller of kind",
        ),
        ("joints: {turn: {controller: {gain: 2}}}", r"controller\.gain is no key of kind pd, which has kp and kd"),
        (SERVO.replace("gain: 2", "gain: 2, kp: 3"), r"controller\.kp is no key of kind duty, which has gain, limit"),
        (SERVO.replace("gain: 2", "gain: 2, drops_to: 0.1"), r"has one of drops_beyond and drops_to; give both"),
        (SERVO.replace("gain: 2", "gain: 2, limit: 1.5"), r"controller\.limit is 1\.5, wanted a share from 0 to 1"),
        ("joints: {turn: 3}", r"joints is .*, wanted joint names, each with its keys"),
        ("joints: [turn]", r"joints is the list \['turn'\], wanted joint names, each with its keys"),
        ("joints: {turn: {rotor_inertia: }}", r"joints\.turn\.rotor_inertia is empty: give a value or remove the key"),
        ("lock: tilt", r"lock is the text 'tilt', wanted a list of joint names"),
        (
            "joints: {trun: {}}",
            r"unknown joint 'trun', the joints are turn, tilt, slide; did you mean turn\?",
        ),
        ("lock: [slid]", r"lock names the unknown joint 'slid', the joints are .*did you mean slide\?"),
        ("payload_frame: tol", r"unknown frame 'tol', the frames are universe, base, .*did you mean tool\?"),
        ("payload_frame: base", r"payload_frame 'base' does not move: give a frame on a moving link"),
        ("torque_hold: zoh\ntorque_hold: zoh", r"not valid YAML at line 2 \(the key torque_hold is given twice\)"),
        ("joints:\n  turn: {gear_ratio: 3", r"is not valid YAML at line \d .*: correct it there"),
        ("? [gravity]\n: 1", r"is not valid YAML at line 1 \(found unhashable key\)"),
        ("joints: {1: {}}", r"joints is \{1: \{\}\}, wanted joint names"),
        ("1: 2", r"the file is \{1: 2\}, wanted a table with some of the keys gravity"),
        ("- gravity", r"holds the list \['gravity'\], wanted keys with values"),
        ("loops: [{kind: chain}]", r"loops\[0\]\.kind is the text 'chain', wanted one of linear, point"),
        ("loops: [{kind: point, frame_a: tool}]", r"loops\[0\]\.frame_b is missing, wanted the name of a frame"),
        ("loops: [{kind: point, frame_a: tool, frame_b: bean}]", r"frame_b names the unknown frame 'bean', .*beam\?"),
        ("loops: [{kind: linear, active: [j], passive: {}}]", r"loops\[0\]\.active names the unknown joint 'j'"),
    ],
)
def test_a_wrong_configuration_is_refused_in_a_sentence(load, text, message):
    with pytest.raises(RobotError, match=message):
        load(text)


def test_a_binary_configuration_is_refused(tmp_path):
    (tmp_path / "c.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RobotError, match="is not a text file"):
        read_robot_config(tmp_path / "c.yaml")


def test_an_error_of_configuration_names_its_file(tmp_path):
    (tmp_path / "c.yaml").write_text("lock: 3")
    with pytest.raises(RobotError, match=str(tmp_path / "c.yaml")):
        read_robot_config(tmp_path / "c.yaml")


def test_the_drive_of_a_locked_joint_is_a_warning(load):
    robot = load("lock: [slide]\njoints: {slide: {gear_ratio: 2}}")
    assert robot.warnings == ("The drives stated for slide are not used, as these joints are held fixed.",)


LAUGHS = "".join(f"l{k}: &l{k} [{', '.join([f'*l{k - 1}'] * 9) if k else ', '.join(['lol'] * 9)}]\n" for k in range(9))


MERGES = "a: &a {k: 1}\n" + "".join(
    f"m{k}: &m{k} {{<<: [{', '.join([f'*m{k - 1}' if k else '*a'] * 9)}]}}\n" for k in range(9)
)


CHAIN = "a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}]\n" for k in range(1, 3000))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: " + "9" * 400, r"line 1 \(the number 9{40}… is too large\)"),
        ("a: " + "9" * 5000, r"9{40}… cannot be read as !!int"),
        ("a: !!int x", "x cannot be read as !!int"),
        ("a: !!bool 7", "7 cannot be read as !!bool"),
        ("b: 1\na: !!binary aGk=", r"line 2 \(the tag !!binary is not allowed"),
        ("a: !!timestamp 2001-01-01", "the tag !!timestamp is not allowed"),
        ("a: !!set {x, y}", "the tag !!set is not allowed"),
        ("a: !!python/object/apply:os.system [ls]", "the tag !!python/object/apply:os.system is not allowed"),
        ("a: !!map [1]", "a mapping was wanted"),
        ("a: &x [*x]", "an alias stands for a list or mapping that contains it"),
        ("a: &x {b: *x}", "an alias stands for a list or mapping that contains it"),
        ("a: *nobody", "found undefined alias 'nobody'"),
        ("a: " + "[" * 3000 + "]" * 3000, "lists and mappings nested more than 100 deep"),
        ("a: " + "{a: " * 300 + "1" + "}" * 300, "lists and mappings nested more than 100 deep"),
        (CHAIN, "lists and mappings nested more than 100 deep"),
        (LAUGHS, "with its aliases expanded it has more than 1000000 values"),
        (MERGES, "with its aliases expanded it has more than 1000000 values"),
        ('a: "\\ud800"', "half of a surrogate pair"),
        ("a: \x07", r"at character 4 \(U\+0007, which no text holds\)"),
        ("{? [1, 2] : 3}", "found unhashable key"),
        ("a: 1\na: 2", "the key a is given twice"),
    ],
    ids=lambda text: text[:20],
)
def test_what_is_no_plain_yaml_is_refused_with_its_place(tmp_path, text, message):
    path = tmp_path / "columns.yaml"
    path.write_text(text, encoding="utf-8")
    started = time.process_time()
    with pytest.raises(ParameterError, match=message) as refusal:
        load_mapping(path, ParameterError)
    assert str(refusal.value).startswith(f"{path} is not valid YAML")
    assert time.process_time() - started < 5.0  # followed, the aliases would take hours


@pytest.mark.parametrize("word", ["2023-02-30", "2001-01-01", "2024-13-45T99:99:99", "1:30", "190:20:30.5", "0o17"])
def test_dates_and_times_are_texts(word):
    assert load_yaml(f"a: {word}") == {"a": word}


def test_aliases_of_a_reasonable_size_are_followed():
    # Oracle: the same file written out.
    assert load_yaml("a: &x {k: [1, 2]}\nb: *x\nc: {<<: *x, m: 3}") == {
        "a": {"k": [1, 2]},
        "b": {"k": [1, 2]},
        "c": {"k": [1, 2], "m": 3},
    }


@given(
    st.dictionaries(
        st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=8),
        st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=12)
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.dates().map(str)
        | st.booleans(),
        max_size=4,
    )
)
def test_what_is_written_is_read_back_unchanged(content):
    assert load_yaml(settings_text(content)) == content


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused_as_yaml(text):
    # Oracle: the kinds of value that JSON has, and none but them.
    with contextlib.suppress(yaml.YAMLError):
        assert isinstance(load_yaml(text), dict | list | str | int | float | None)


def test_a_file_of_many_megabytes_is_no_settings_file(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("# " + "x" * 6_000_000)
    with pytest.raises(ParameterError, match="has 6 MB, wanted a YAML file of at most 5 MB"):
        load_mapping(path, ParameterError)


@pytest.mark.parametrize(("value", "most"), [(1e13, 1e12), (-2.0, 1.0)])
def test_a_number_beyond_its_limit_is_refused(value, most):
    with pytest.raises(ParameterError, match="wanted a number within"):
        number_at(value, "a.yaml", "key", most=most)


def test_a_long_value_is_cut_in_the_message():
    with pytest.raises(ParameterError) as refusal:
        number_at("x" * 5000, "a.yaml", "key")
    assert len(str(refusal.value)) < 200


def test_the_file_itself_is_named(tmp_path):
    path = Path(tmp_path / "recordings.yaml")
    path.write_text("[1, 2]")
    with pytest.raises(ParameterError, match=r"recordings\.yaml holds the list \[1, 2\], wanted keys with values"):
        load_mapping(path, ParameterError)
