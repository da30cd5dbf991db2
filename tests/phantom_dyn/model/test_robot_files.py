from __future__ import annotations

import shutil
from importlib import metadata

import pytest

from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot_files import builtin_robots, examples_folder, find_example, find_robot, urdf_folder
from places import CHECKOUT, ROBOTS


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


def test_a_misspelt_built_in_name_suggests_the_right_one():
    with pytest.raises(RobotError, match=r"no robot file 'emsp'.*built-in: .*emps.*did you mean emps\?"):
        find_robot("emsp")


def test_a_misspelt_file_suggests_the_file_beside_it():
    with pytest.raises(RobotError, match=r"did you mean .*pendulum\.urdf\?"):
        find_robot(ROBOTS / "pendulm.urdf")


def test_an_example_named_without_its_prefix_is_suggested_with_it():
    with pytest.raises(RobotError, match=r"did you mean example:panda\?"):
        find_robot("panda")


def test_a_folder_is_refused_with_the_robot_files_in_it():
    with pytest.raises(RobotError, match=r"is a folder, wanted a robot file: .*arm3\.urdf.*pendulum\.urdf"):
        find_robot(ROBOTS)


@pytest.mark.parametrize(
    ("name", "stem"),
    [("panda", "panda"), ("ur10", "ur10_robot"), ("ur10_robot", "ur10_robot"), ("panda_robot", "panda")],
)
def test_an_example_is_found_with_or_without_robot_in_its_name(name, stem):
    assert find_robot(f"example:{name}").stem == stem


def test_a_stem_that_two_folders_share_lists_both():
    wanted = "is ambiguous: give one of example:anymal_b_simple_description/anymal, example:anymal_c_simple"
    with pytest.raises(RobotError, match=wanted):
        find_robot("example:anymal")


def test_a_folder_before_the_stem_makes_an_example_unique():
    assert "anymal_c_simple" in str(find_robot("example:anymal_c_simple_description/anymal"))


def test_the_beginning_of_several_stems_lists_them():
    with pytest.raises(RobotError, match=r"is ambiguous: give one of .*/talos_full_v2, "):
        find_robot("example:talos")


def test_an_unknown_example_lists_the_examples_and_the_nearest():
    with pytest.raises(RobotError, match=r"no example robot 'pamda': the examples are a1, .*did you mean panda\?$"):
        find_robot("example:pamda")


def test_an_example_without_its_prefix_is_hinted_at():
    with pytest.raises(RobotError, match=r"no robot file 'ur10'.*did you mean example:ur10\?"):
        find_robot("ur10")


def test_without_the_example_package_its_extra_is_named():
    with pytest.raises(RobotError, match=r"pip install 'phantom-dyn\[examples\]'"):
        find_example("panda", None)


def test_a_package_that_is_not_installed_has_no_folder(monkeypatch):
    def nowhere(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", nowhere)
    assert examples_folder() is None
