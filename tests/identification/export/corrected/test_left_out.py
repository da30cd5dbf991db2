"""What corrected files do not hold is said. Known truth: what the robot has and the format does not."""

from __future__ import annotations

import pytest

from identification.export.all_files import not_written
from identification.export.corrected.corrected_files import mjcf_left_out, urdf_left_out
from identification.export.corrected.corrected_model import corrected_model
from identification.words.note_words import sentence, sentences
from phantom_dyn import load_robot
from phantom_dyn.model.robot_files import find_robot
from places import ROBOTS

ARM = """<mujoco><worldbody><body name="a"><joint name="j" axis="0 1 0" armature="0.02"/>
<inertial pos="0 0 -0.1" mass="1" diaginertia="0.1 0.1 0.1"/></body></worldbody></mujoco>"""


def test_the_urdf_of_an_mjcf_tells_all_rotors(tmp_path):
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    assert any(
        "rotor inertias" in s and s.endswith("j 0.02.")
        for s in sentences(urdf_left_out(corrected_model(load_robot(file), ()), file))
    )


def test_joints_that_are_held_by_the_configuration_alone_are_told(tmp_path):
    (tmp_path / "arm.urdf").write_text((ROBOTS / "planar2.urdf").read_text())
    (tmp_path / "robot.yaml").write_text("lock: [elbow]\n")
    file = tmp_path / "arm.urdf"
    told = sentences(urdf_left_out(corrected_model(load_robot(file), ()), file))
    assert "elbow can move in it: name what is fixed under lock in a robot.yaml beside it." in told


def test_another_gravity_is_told():
    file = find_robot("emps")
    told = sentences(urdf_left_out(corrected_model(load_robot("emps"), ()), file))
    assert "It has no place for gravity: state gravity: [0, 0, 0] in a robot.yaml beside it." in told


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("fourbar.xml", "state them under loops in a robot.yaml"),
    ],
)
def test_loops_of_an_mjcf_are_not_said_to_be_in_a_configuration(name, wanted):
    file = ROBOTS / name
    assert any(wanted in told for told in sentences(urdf_left_out(corrected_model(load_robot(file), ()), file)))


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
