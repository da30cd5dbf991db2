"""Bad robots and configurations of ``phantom-dyn diagnose``: exit code 2, one sentence, nothing written.

Oracle: the contract, paragraph "Bad input"; what holds for every refusal is asserted by the fixture ``refusal``.
"""

from __future__ import annotations

import re

import pytest

PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(200)


def test_a_missing_robot_names_the_nearest(pendulum, tmp_path, log, refusal):
    (tmp_path / "robot.urdf").write_text(pendulum.read_text())
    assert re.search(
        r"no robot file '.*robott\.urdf'.*did you mean .*robot\.urdf\?", refusal(tmp_path / "robott.urdf", log)
    )


def test_a_folder_for_a_robot(pendulum, tmp_path, log, refusal):
    folder = tmp_path / "robots"
    folder.mkdir()
    (folder / "rod.urdf").write_text(pendulum.read_text())
    assert re.search(r"robots is a folder, wanted a robot file: .*rod\.urdf", refusal(folder, log))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<mass value="2"/>', '<mass value="-2"/>', r"link rod cannot exist, its mass is -2 kg, below zero: correct"),
        ('izz="0.01"', 'izz="-0.01"', r"link rod cannot exist, its smallest principal inertia is -0\.01.*: correct"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', r"the axis of joint pin is zero: give its direction"),
        ('type="revolute"', 'type="floating"', r"pin is a floating base, .*write base: fixed"),
    ],
)
def test_an_impossible_robot(pendulum, tmp_path, log, refusal, old, new, message):
    robot = tmp_path / "robot.urdf"
    robot.write_text(pendulum.read_text().replace(old, new))
    assert re.search(r"robot\.urdf.*" + message, refusal(robot, log))


def test_a_robot_file_that_is_cut_off(pendulum, tmp_path, log, refusal):
    robot = tmp_path / "robot.urdf"
    robot.write_text(pendulum.read_text()[:500])
    assert re.search(r"robot\.urdf is not valid XML, or is cut off \(.*line \d+", refusal(robot, log))


@pytest.mark.parametrize("content", [b"", PNG, b"t,q.pin\n0,0\n"])
def test_a_file_that_is_no_robot(tmp_path, log, refusal, content):
    robot = tmp_path / "robot.urdf"
    robot.write_bytes(content)
    assert re.search(r"robot\.urdf is (empty|not valid XML)", refusal(robot, log))


def test_an_example_that_does_not_exist(log, refusal):
    assert re.search(r"There is no example robot 'nosuch'", refusal("example:nosuch", log))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joints: {pim: {gear_ratio: 3}}", r"joints names the unknown joint 'pim', .*did you mean pin\?"),
        ("lock: [pim]", r"lock names the unknown joint 'pim'"),
        ("gravty: [0, 0, -9.81]", r"there is no key gravty, .*did you mean gravity\?"),
        ("joints: {pin: {gear: 3}}", r"there is no key joints\.pin\.gear, .*did you mean gear_ratio\?"),
        ("gravity: [0, -9.81]", r"gravity is the list \[0, -9\.81\], wanted three numbers"),
        ("joints: [pin]", r"joints is the list \['pin'\], wanted joint names"),
        ("joints: {pin: {gear_ratio: 3", r"is not valid YAML at line 1 .*: correct it there"),
    ],
)
@pytest.mark.parametrize("beside", [True, False])
def test_a_wrong_configuration(pendulum, tmp_path, log, refusal, text, message, beside):
    (tmp_path / "robot.urdf").write_text(pendulum.read_text())
    config = tmp_path / ("robot.yaml" if beside else "other.yaml")
    config.write_text(text)
    words = () if beside else ("--robot-config", config)
    assert re.search(rf"{config.name}.*{message}", refusal(tmp_path / "robot.urdf", log, *words))


def test_a_missing_configuration(pendulum, tmp_path, log, refusal):
    missing = tmp_path / "no.yaml"
    assert re.search(r"no\.yaml cannot be read \(No such file", refusal(pendulum, log, "--robot-config", missing))
