"""Corrected descriptions in YAML."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from identification.diagnosis.result import Adjusted, Finding, Value
from identification.export.all_files import export_texts, incomplete_file_notes, not_written
from identification.export.corrected.corrected_files import mjcf_left_out, urdf_left_out
from identification.export.corrected.corrected_model import corrected_model
from identification.export.corrected.corrected_yaml import (
    Corrected,
    CorrectedEffect,
    ModelError,
    corrected_text,
    known_effect,
    known_effects,
    read_corrected,
    write_corrected,
)
from identification.export.corrected.possible_bodies import nearest_possible, with_nearest_bodies
from identification.export.known_model import known_model
from identification.words.note_words import sentence, sentences
from known_effects import EFFECTS_OF_THE_PENDULUM
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import ParameterError, RobotError, UsageError
from phantom_dyn.model.inertia import body_parameters, breaks_triangle, central_parameters, impossible_because
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot_files import find_robot
from places import ROBOTS

GOOD = """\
schema: phantom-dyn-model/1
robot: {source: arm.urdf, sha256: abc}
effects:
- {effect: coulomb_friction, joint: j1, parameters: {torque: {value: 5e-2, std: null, unit: N m}}, gap_closed: 0.8}
adjusted:
- {quantity: link2 mass, change: 0.02, tolerance: 0.05}
"""

texts = st.one_of(
    st.text(st.characters(exclude_categories=["Cs"]), max_size=12),
    st.sampled_from(
        [
            "1e5",
            "null",
            "~",
            "yes",
            "1.5",
            "0x1f",
            "2024-01-01",
            "- a",
            "a: b",
            "#",
            "12:30:45",
            ".inf",
            "a\x85b",
            "a\u2028 b",
        ]
    ),
)

numbers = st.floats(allow_nan=False, allow_infinity=False)

lists = st.integers(1, 4).flatmap(
    lambda n: st.tuples(st.lists(numbers, min_size=n, max_size=n), st.lists(numbers, min_size=n, max_size=n))
)

values = st.one_of(st.tuples(numbers, numbers, texts), st.tuples(lists, texts).map(lambda v: (*v[0], v[1])))

effects = st.tuples(texts, st.none() | texts, st.dictionaries(texts, values, max_size=4), st.floats(-1, 2))

adjustments = st.tuples(texts, numbers, numbers)


# The objects are made here: the type checker of the tests draws random numbers, which no strategy may do.
@settings(max_examples=50, deadline=None)
@given(robot=texts, sha256=texts, found=st.lists(effects, max_size=2), moved=st.lists(adjustments, max_size=1))
def test_a_round_trip_changes_nothing(tmp_path_factory, robot, sha256, found, moved):
    effects = tuple(CorrectedEffect(e, j, {k: Value(*v) for k, v in ps.items()}, g) for e, j, ps, g in found)
    model = Corrected(robot, sha256, effects, tuple(Adjusted(*entry) for entry in moved))
    path = tmp_path_factory.getbasetemp() / "corrected.yaml"
    path.write_bytes(corrected_text(model).encode())
    assert read_corrected(path) == model
    assert corrected_text(read_corrected(path)) == path.read_bytes().decode()


def test_all_findings_and_adjustments_are_written(made_up, tmp_path):
    path = tmp_path / "corrected.yaml"
    diagnosis = made_up(findings=3)
    path.write_text(write_corrected(diagnosis, "arm.urdf", "ab" * 32), encoding="utf-8")
    assert read_corrected(path) == Corrected(
        "arm.urdf",
        "ab" * 32,
        tuple(CorrectedEffect(f.effect, f.joint, f.parameters, f.gap_closed) for f in diagnosis.findings),
        diagnosis.adjusted,
    )


def test_an_unknown_deviation_is_null_and_comes_back_as_not_a_number(tmp_path):
    path = tmp_path / "corrected.yaml"
    path.write_text(corrected_text(Corrected("a", "b", (CorrectedEffect("payload", None, {
        "mass": Value(1.0, math.inf, "kg")}, math.nan),), ())))  # fmt: skip
    assert "std: null" in path.read_text()
    effect = read_corrected(path).effects[0]
    assert math.isnan(effect.parameters["mass"].std)
    assert math.isnan(effect.gap_closed)


def test_a_file_written_by_hand_may_have_an_exponent_without_a_point(tmp_path):
    (tmp_path / "a.yaml").write_text(GOOD)
    assert read_corrected(tmp_path / "a.yaml").effects[0].parameters["torque"].value == 0.05


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("model/1", "model/2", r"a\.yaml: schema is the text 'phantom-dyn-model/2', wanted phantom-dyn-model/1: give"),
        ("schema: phantom-dyn-model/1\n", "", "there is no key schema, wanted phantom-dyn-model/1"),
        ("sha256", "sha265", r"there is no key sha265 in robot, the keys are source, sha256; did you mean sha256\?"),
        ("{source: arm.urdf, sha256: abc}", "arm.urdf", "robot is the text 'arm.urdf', wanted a mapping with the keys"),
        (", sha256: abc", "", r"a\.yaml: the key sha256 is missing in robot, wanted source, sha256\."),
        ("5e-2", "much", r"effects\[0\]\.parameters\.torque\.value is the text 'much', wanted a finite number\."),
        ("5e-2", ".inf", r"effects\[0\]\.parameters\.torque\.value is inf, wanted a finite number\."),
        ("5e-2", "true", r"effects\[0\]\.parameters\.torque\.value is true, wanted a finite number\."),
        ("5e-2", "[1.0, 2.0]", r"torque\.std is None, wanted a list of 2 numbers, one for each value"),
        ("std: null", "std: []", r"torque\.std is the list \[\], wanted a finite number or null"),
        ("joint: j1", "joint: 3", r"effects\[0\]\.joint is 3, wanted a text: put it in quotes"),
        ("{torque:", "{7:", r"the key 7 in effects\[0\]\.parameters is no text: put it in quotes"),
        ("- {quantity: link2 mass, change: 0.02, tolerance: 0.05}", "  none", "adjusted is the text 'none', wanted a"),
        ("change: 0.02", "change: ", r"adjusted\[0\]\.change is None, wanted a finite number"),
    ],
)  # fmt: skip
def test_a_wrong_entry_is_named_with_file_key_value_and_what_is_wanted(tmp_path, old, new, message):
    assert old in GOOD
    (tmp_path / "a.yaml").write_text(GOOD.replace(old, new))
    with pytest.raises(ParameterError, match=message):
        read_corrected(tmp_path / "a.yaml")


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(RobotError, match=r"no\.yaml cannot be read .*: give a YAML file"):
        read_corrected(tmp_path / "no.yaml")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("schema: phantom-dyn-model/1\nrobot: {source: [}", r"a\.yaml is not valid YAML at line 2"),
        ("- a\n", "holds the list"),
    ],
)
def test_broken_syntax_and_a_list_are_refused(tmp_path, content, said):
    (tmp_path / "a.yaml").write_text(content)
    with pytest.raises(RobotError, match=said):
        read_corrected(tmp_path / "a.yaml")


def test_a_value_that_is_not_finite_is_not_written():
    bad = CorrectedEffect("cogging", "j1", {"order": Value([1.0, math.nan], [0.0, 0.0], "1")}, 0.5)
    with pytest.raises(ParameterError, match=r"order of cogging is \[1.0, nan\], wanted a finite number"):
        corrected_text(Corrected("a", "b", (bad,), ()))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("value: [3.0, 5.0], std: [0.0, 0.0]", "value: [3.0], std: [0.0]", "cogging has order 1 numbers, amplitude 2"),
        ("value: [3.0, 5.0], std: [0.0, 0.0]", "value: 3.0, std: 0.0", "cogging has order one number, amplitude 2"),
        ("value: 0.3, std: 0.01", "value: [0.3], std: [0.01]", "torque of coulomb_friction is a list, wanted a number"),
        (
            "center_z: {value: -0.5",
            "center_z: {value: 1.0e+307",
            "center_z of payload is 1e.307 m, wanted at most 1e.12",
        ),
        ("value: 0.3", "value: -0.8", "torque of coulomb_friction is -0.8 N m, wanted a value from -0.7 to inf"),
        ("joint: pin\n  parameters: {torque", "joint: null\n  parameters: {torque", "has no joint, wanted one of pin"),
        ("joint: pin\n  parameters: {torque", "joint: pun\n  parameters: {torque", "did you mean pin"),
    ],
)
def test_a_known_effect_that_cannot_be_is_refused(tmp_path, robots, old, new, message):
    robot = load_robot(robots / "pendulum.urdf")
    path = tmp_path / "corrected.yaml"
    path.write_text(EFFECTS_OF_THE_PENDULUM)
    assert len(known_effects((path,), robot)) == 4
    assert old in EFFECTS_OF_THE_PENDULUM
    path.write_text(EFFECTS_OF_THE_PENDULUM.replace(old, new, 1))
    with pytest.raises(ParameterError, match=message):
        known_effects((path,), robot)


def test_a_file_that_is_given_twice_is_refused(robots, tmp_path):
    robot = load_robot(robots / "pendulum.urdf")
    path = tmp_path / "corrected.yaml"
    path.write_text(EFFECTS_OF_THE_PENDULUM)
    with pytest.raises(UsageError, match=r"corrected\.yaml is given twice, and its effects would be added twice"):
        known_effects((path, tmp_path / "." / ".." / tmp_path.name / "corrected.yaml"), robot)


def test_a_name_without_end_is_refused_in_a_short_sentence(robots):
    robot = load_robot(robots / "pendulum.urdf")
    endless = CorrectedEffect("viscous_friction", robot.joint_names[0], {"x" * 3000: Value(1.0, 0.1, "1")}, 0.5)
    with pytest.raises(ParameterError, match="wanted coefficient") as said:
        known_effect(endless, robot, Path("known.yaml"))
    assert len(str(said.value)) < 500


ERROR = "model_error:\n- {joint: JOINT, slow: 0.02, moving: 0.01, unit: N m}\n"


def test_the_error_of_a_model_comes_back_as_it_was_written(tmp_path):
    (tmp_path / "c.yaml").write_text(GOOD + ERROR.replace("JOINT", "j1"))
    read = read_corrected(tmp_path / "c.yaml")
    assert read.model_error == (ModelError("j1", 0.02, 0.01, "N m"),)
    (tmp_path / "again.yaml").write_text(corrected_text(read))
    assert read_corrected(tmp_path / "again.yaml") == read


def test_a_robot_takes_the_largest_error_of_its_joints(tmp_path):
    robot = load_robot("phantom_1_5")
    first = robot.joint_names[0]
    files = []
    for k, slow in enumerate(("0.02", "0.05")):
        files.append(tmp_path / f"{k}.yaml")
        files[-1].write_text(GOOD.replace("j1", first) + ERROR.replace("JOINT", first).replace("0.02", slow))
    error = known_model(tuple(files), robot)[1].model_error
    assert error is not None
    assert error.tolist() == [[0.05, 0.01], *[[0.0, 0.0]] * (robot.nv - 1)]
    assert known_model((), robot)[1].model_error is None


@pytest.mark.parametrize(("old", "new", "message"), [
    ("JOINT", "j9", "model_error is of joint 'j9', which this robot does not have"),
    ("0.02", "-0.02", "wanted a root mean square of 0 or more"),
])  # fmt: skip
def test_a_wrong_error_of_a_model_is_refused(tmp_path, old, new, message):
    robot = load_robot("phantom_1_5")
    text = ERROR.replace(old, new).replace("JOINT", robot.joint_names[0])
    (tmp_path / "c.yaml").write_text(GOOD.replace("j1", robot.joint_names[0]) + text)
    with pytest.raises(ParameterError, match=message):
        known_model((tmp_path / "c.yaml",), robot)


@pytest.mark.parametrize(("sha256", "warned"), [("ab" * 32, True), ("abc", False), (None, False)])
def test_a_file_that_was_made_for_another_robot_is_warned_of(tmp_path, robots, sha256, warned):
    robot = load_robot(robots / "pendulum.urdf")
    file = tmp_path / "c.yaml"
    file.write_text(GOOD.replace("j1", "pin").replace("abc", sha256 or robot.sha256))
    said = known_model((file,), robot)[1].warnings[len(robot.warnings) :]
    assert [one.partition(" (")[0] for one in said] == [
        f"{file} was made for arm.urdf, and {robot.source} is another file"
    ] * warned


OFFSET = "{effect: torque_offset, joint: pin, parameters: {torque: {value: 1.0, std: null, unit: N m}}, gap_closed: 1}"


@pytest.mark.parametrize(("run", "entry", "refused"), [("r1", None, True), ("r2", None, False), ("r1", OFFSET, False)])
def test_a_corrected_robot_is_refused_with_the_effects_that_it_has(tmp_path, robots, run, entry, refused):
    # A URDF has no place for a constant torque, which is then to be given beside it.
    made = tmp_path / "corrected.urdf"
    made.write_text(f"{(robots / 'pendulum.urdf').read_text()}<!-- run: {run} -->\n")
    good = GOOD.replace("j1", "pin").replace("abc", "ab" * 32)
    file = tmp_path / "c.yaml"
    file.write_text(f"{good if entry is None else re.sub('{effect.*', entry, good)}# run: r1\n")
    robot = load_robot(made)
    if not refused:
        assert known_model((file,), robot)[1].warnings[-1].startswith(f"{file} was made for arm.urdf")
        return
    words = r"corrected.urdf was .* has its effects already \(coulomb_friction on pin\), .* twice: give arm.urdf, "
    with pytest.raises(UsageError, match=words):
        known_model((file,), robot)


ARM = """<mujoco><worldbody><body name="a"><joint name="j" axis="0 1 0" armature="0.02"/>
<inertial pos="0 0 -0.1" mass="1" diaginertia="0.1 0.1 0.1"/></body></worldbody></mujoco>"""


def test_the_urdf_of_an_mjcf_tells_all_rotors(tmp_path):
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    assert any(
        "rotor inertias" in s and s.endswith("j 0.02.")
        for s in sentences(urdf_left_out(corrected_model(load_robot(file), ()), file))
    )


def test_joints_that_are_held_by_the_configuration_alone_are_reported(tmp_path):
    (tmp_path / "arm.urdf").write_text((ROBOTS / "planar2.urdf").read_text())
    (tmp_path / "robot.yaml").write_text("lock: [elbow]\n")
    file = tmp_path / "arm.urdf"
    said = sentences(urdf_left_out(corrected_model(load_robot(file), ()), file))
    assert "elbow can move in it: to fix them, name them under lock in a robot.yaml beside it." in said


def test_another_gravity_is_reported():
    file = find_robot("emps")
    said = sentences(urdf_left_out(corrected_model(load_robot("emps"), ()), file))
    assert "It has no place for gravity: state gravity: [0, 0, 0] in a robot.yaml beside it." in said


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("fourbar.xml", "state them under loops in a robot.yaml"),
    ],
)
def test_loops_of_an_mjcf_are_not_said_to_be_in_a_configuration(name, wanted):
    file = ROBOTS / name
    assert any(wanted in said for said in sentences(urdf_left_out(corrected_model(load_robot(file), ()), file)))


def test_what_the_mjcf_drops_depends_on_the_given_file(tmp_path):
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    assert "actuators of the given file" in sentence(mjcf_left_out(corrected_model(load_robot(file), ()), file)[-1])
    urdf = ROBOTS / "planar2.urdf"
    assert "limits of torque and speed" in sentence(mjcf_left_out(corrected_model(load_robot(urdf), ()), urdf)[-1])


def test_files_that_could_not_be_written_are_named(tmp_path):
    paths = [
        tmp_path / name
        for name in ("corrected.urdf", "corrected.xml", "randomisation.yaml", "isaac_lab.py", "simulators.yaml")
    ]
    assert not_written(tmp_path, paths) == ("corrected.yaml", "feedforward.py", "feedforward.csv")


def moved(planar, **entries: float):
    """The arm with other parameters of its lower link."""
    names = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    change = np.zeros(20)
    for name, value in entries.items():
        change[10 + names.index(name)] = value
    return with_parameters(planar, change)


def test_a_possible_body_is_nearest_to_itself():
    body = body_parameters(2.0, np.array([0.1, 0.0, 0.2]), np.diag([0.02, 0.03, 0.04]))
    found, distance = nearest_possible(body, 0.1)
    np.testing.assert_allclose(found, body, atol=1e-12)
    assert distance < 1e-12


def test_a_negative_moment_is_taken_away_and_nothing_else():
    # Second moments about the centre, which is at the origin: 0.03, 0.02 and -0.01 kg m^2.
    second = np.diag([0.03, 0.02, -0.01])
    inertia = np.trace(second) * np.eye(3) - second
    found, distance = nearest_possible(body_parameters(1.0, np.zeros(3), inertia), 1.0)
    wanted = np.diag([0.02, 0.03, 0.05])
    np.testing.assert_allclose(central_parameters(found)[2], wanted, atol=3e-6)
    assert distance == pytest.approx(0.01 / np.sqrt(1 + 0.03**2 + 0.02**2 + 0.01**2), rel=1e-3)


def test_bodies_that_did_not_move_stay_as_they_were_given(planar):
    assert with_nearest_bodies(planar, planar) == (planar, ())


def test_what_no_body_can_have_becomes_possible_and_is_reported(planar):
    robot, said = with_nearest_bodies(moved(planar, Iyy=3.0), planar)
    mass, _, inertia = central_parameters(robot.model.inertias[2].toDynamicParameters())
    assert impossible_because(mass, inertia) is None
    assert not breaks_triangle(inertia)
    assert len(said) == 1
    assert sentence(said[0]).startswith("No body can have the inertia that was found for lower")


def test_a_link_without_weight_is_refused(planar):
    robot = replace(planar, model=planar.model.copy())
    inertia = robot.model.inertias[2]
    inertia.mass = -0.1
    robot.model.inertias[2] = inertia
    with pytest.raises(ParameterError, match=r"lower would weigh -0\.1 kg"):
        with_nearest_bodies(robot, planar)


def test_a_finding_that_no_body_can_have_is_written_as_a_possible_one(planar, made_up, tmp_path):
    size = {"elbow.Iyy": Value(3.0, 0.1, "kg m^2"), "elbow.m": Value(0.2, 0.01, "kg")}
    diagnosis = made_up(("shoulder", "elbow"), findings=1, samples=400)
    finding = replace(diagnosis.findings[0], effect="inertial_parameters", joint="elbow", parameters=size, loadings=())
    assert isinstance(finding, Finding)
    texts, noted = export_texts(replace(diagnosis, findings=(finding,), adjusted=()), planar, folder=tmp_path)
    assert "corrected.xml" in texts
    assert "corrected.urdf" in texts
    assert any("No body can have" in text for text in sentences(incomplete_file_notes(noted.notes)))
