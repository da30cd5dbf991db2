"""Finding the file of a robot: built-in names, examples, paths."""

import dataclasses
import shutil
from importlib import metadata

import numpy as np
import pytest

from phantom_dyn.errors import RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot_files import builtin_robots, examples_folder, find_example, find_robot, urdf_folder
from places import CHECKOUT, ROBOTS

PENDULUM = ROBOTS / "pendulum.urdf"


def test_the_model_is_a_private_copy():
    first = load_robot(PENDULUM)
    second = dataclasses.replace(first)
    first.model.armature[0] = 3.0
    assert second.model.armature[0] == 0.0


@pytest.mark.parametrize("name", ["viscous_friction", "coulomb_friction", "prismatic"])
def test_arrays_cannot_be_written_to(name):
    with pytest.raises(ValueError, match="read-only"):
        getattr(load_robot(PENDULUM), name)[0] = 1


def test_the_configuration_of_a_continuous_joint_is_cosine_and_sine():
    robot = load_robot("example:double_pendulum_continuous")
    q = robot.configuration(np.array([[0.3, -0.4]]))
    np.testing.assert_allclose(q, [[np.cos(0.3), np.sin(0.3), np.cos(-0.4), np.sin(-0.4)]])


def test_in_a_checkout_the_built_in_robots_lie_beside_the_packages():
    assert urdf_folder() == CHECKOUT / "urdf"


def test_in_an_installed_wheel_the_built_in_robots_lie_inside_the_package(tmp_path):
    package = tmp_path / "phantom_dyn"
    for folder in (package / "urdf" / "emps", tmp_path / "urdf" / "stranger"):
        folder.mkdir(parents=True)
        shutil.copy(ROBOTS / "pendulum.urdf", folder / "robot.urdf")
    assert urdf_folder(package) == package / "urdf"


def test_without_any_built_in_robot_there_is_no_folder(tmp_path):
    assert urdf_folder(tmp_path / "phantom_dyn") is None


def test_a_built_in_name_is_the_name_of_its_folder():
    assert builtin_robots()["emps"].name == "robot.urdf"


def test_a_built_in_name_is_found_although_a_folder_of_that_name_is_here(tmp_path, monkeypatch):
    (tmp_path / "emps").mkdir()
    monkeypatch.chdir(tmp_path)
    assert find_robot("emps") == builtin_robots()["emps"]


def test_a_path_is_itself():
    assert find_robot(ROBOTS / "pendulum.urdf") == ROBOTS / "pendulum.urdf"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda: find_robot("emsp"),
            r"no robot file 'emsp'.*built-in: .*emps.*did you mean emps\?",
            id="a misspelt built in name suggests the right one",
        ),
        pytest.param(
            lambda: find_robot(ROBOTS / "pendulm.urdf"),
            r"did you mean .*pendulum\.urdf\?",
            id="a misspelt file suggests the file beside it",
        ),
        pytest.param(
            lambda: find_robot("panda"),
            r"did you mean example:panda\?",
            id="an example named without its prefix is suggested with it",
        ),
        pytest.param(
            lambda: find_robot(ROBOTS),
            r"is a folder, wanted a robot file: .*arm3\.urdf.*pendulum\.urdf",
            id="a folder is refused with the robot files in it",
        ),
        pytest.param(
            lambda: find_robot("example:talos"),
            r"is ambiguous: give one of .*/talos_full_v2, ",
            id="the beginning of several stems lists them",
        ),
        pytest.param(
            lambda: find_robot("example:anymal"),
            "is ambiguous: give one of example:anymal_b_simple_description/anymal, example:anymal_c_simple",
            id="a stem that two folders share lists both",
        ),
        pytest.param(
            lambda: find_robot("example:pamda"),
            r"no example robot 'pamda': the examples are a1, .*did you mean panda\?$",
            id="an unknown example lists the examples and the nearest",
        ),
        pytest.param(
            lambda: find_robot("ur10"),
            r"no robot file 'ur10'.*did you mean example:ur10\?",
            id="an example without its prefix is hinted at",
        ),
        pytest.param(
            lambda: find_example("panda", None),
            r"pip install 'phantom-dyn\[examples\]'",
            id="without the example package its extra is named",
        ),
        pytest.param(
            lambda: load_robot(ROBOTS / "pendulum.urdf", config=ROBOTS / "nowhere.yaml"),
            r"nowhere\.yaml cannot be read \(No such file or directory\)",
            id="a missing configuration",
        ),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(RobotError, match=message):
        call()


@pytest.mark.parametrize(
    ("name", "stem"),
    [("panda", "panda"), ("ur10", "ur10_robot"), ("ur10_robot", "ur10_robot"), ("panda_robot", "panda")],
)
def test_an_example_is_found_with_or_without_robot_in_its_name(name, stem):
    assert find_robot(f"example:{name}").stem == stem


def test_a_folder_before_the_stem_makes_an_example_unique():
    assert "anymal_c_simple" in str(find_robot("example:anymal_c_simple_description/anymal"))


def test_a_package_that_is_not_installed_has_no_folder(monkeypatch):
    def nowhere(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", nowhere)
    assert examples_folder() is None
