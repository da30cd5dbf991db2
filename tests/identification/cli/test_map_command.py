"""The command map. Oracle: the contract, and the device's closed forms for what is in the files."""

import re

import numpy as np
import pytest
import xarray

from identification.cli.main import main
from identification.export import log_and_map_files
from phantom_dyn.devices import phantom
from places import ROBOTS

GRID = "x=-0.1:0.1:5,y=-0.1:0.1:3,z=-0.05:0.05:3"


@pytest.fixture
def mapped(tmp_path, capsys):
    """Runs the command on the PHANToM with ``--out``; returns what it prints and the folder."""

    def run(*words, quantity="manipulability", grid=GRID, robot="phantom_1_5"):
        out = tmp_path / "maps"
        assert main(["map", robot, "--quantity", quantity, "--grid", grid, "--out", str(out), *words]) == 0
        return capsys.readouterr().out, out

    return run


@pytest.fixture
def refusal(tmp_path, capsys):
    """Runs the command; asserts what holds for every refusal, and returns its sentence."""

    def run(robot, *words):
        out = tmp_path / "maps"
        code = main(["map", robot, *words, "--out", str(out)])
        said = capsys.readouterr()
        assert (code, said.out) == (2, "")
        assert not out.exists()
        assert said.err.startswith("phantom-dyn: ")
        assert said.err.count("\n") == 1
        return said.err.removeprefix("phantom-dyn: ").rstrip("\n")

    return run


def test_the_files_are_those_of_the_contract(mapped):
    _, out = mapped(quantity="manipulability,apparent_mass")
    assert {path.name for path in out.iterdir()} == {"map.npz", "map.nc", "manipulability.png", "apparent_mass.png"}


def test_the_npz_holds_coordinates_and_quantities(mapped):
    # Oracle: the device's closed form.
    _, out = mapped(quantity="manipulability,gravity_force")
    with np.load(out / "map.npz") as found:
        assert set(found) == {"x", "y", "z", "manipulability", "gravity_force"}
        np.testing.assert_array_equal(found["x"], np.linspace(-0.1, 0.1, 5))
        assert found["gravity_force"].shape == (5, 3, 3, 3)
        q = phantom.inverse_kinematics(np.array([[0.05, 0.1, -0.05]]))
        assert found["manipulability"][3, 2, 0] == pytest.approx(phantom.manipulability(q)[0], rel=1e-11)


def test_the_netcdf_holds_the_same(mapped):
    _, out = mapped(quantity="apparent_mass_matrix")
    with np.load(out / "map.npz") as arrays, xarray.open_dataset(out / "map.nc") as data:
        for name in arrays:
            np.testing.assert_array_equal(data[name].values, arrays[name])
        assert data["apparent_mass_matrix"].dims == ("x", "y", "z", "row", "column")


def test_the_counts_are_printed(mapped):
    # Closed form: 9 points with x = 0 on the axis of theta1, and those where the arm is too short.
    said, out = mapped(grid="x=0:0:1,y=-0.1:0.1:3,z=-0.215:0.285:3")
    with np.load(out / "map.npz") as found:
        blank = np.isnan(found["manipulability"]).sum()
    unreachable, singular = map(int, re.findall(r"9 points, (\d+) out of reach, (\d+) singular", said)[0])
    assert singular == 3
    assert unreachable + singular == blank


@pytest.mark.parametrize(
    ("words", "q"),
    [
        (["0.1,0.2,-0.1"], [0.1, 0.2, 0.3]),
        (["0.1", "0.2", "-0.1"], [0.1, 0.2, 0.3]),
        (["theta1=0.1,theta2=0.2,theta3=-0.1"], [0.1, 0.2, 0.3]),
        (["-0.1,-0.2,0"], [-0.1, -0.2, -0.3]),
    ],
)
def test_a_posture_is_given_by_numbers_or_by_name_and_may_begin_with_a_minus(mapped, words, q):
    # Oracle: the device's closed form at that posture.
    _, out = mapped("--q0", *words, grid=f"q.theta3={q[2]}:{q[2]}:1")
    with np.load(out / "map.npz") as found:
        assert found["manipulability"][0] == pytest.approx(phantom.manipulability(np.array([q]))[0], rel=1e-12)


def test_a_stiffness_is_given_per_joint(mapped):
    # Closed form: K / l^2 at the origin.
    _, out = mapped("--stiffness", "1,2,3", quantity="stiffness", grid="x=0:0:1,y=0:0:1,z=0:0:1")
    with np.load(out / "map.npz") as found:
        expected = np.diag([1 / 0.215**2, 2 / 0.215**2, 3 / 0.17**2])
        np.testing.assert_allclose(found["stiffness"][0, 0, 0], expected, rtol=1e-12, atol=1e-9)


def test_the_unit_reading_of_the_cea_branch_is_printed(mapped):
    said, _ = mapped(robot="cea_branch", quantity="stiffness", grid="x=0.5:0.5:1")
    assert "read in N m/mrad" in said


def test_files_that_are_not_ours_stay(mapped, tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "notes.txt").write_text("mine")
    _, out = mapped()
    assert (out / "notes.txt").read_text() == "mine"


def test_a_map_of_an_earlier_run_is_written_over(mapped):
    assert mapped() == mapped()


def test_a_map_without_a_value_says_why_and_what_to_do(mapped):
    # Closed form: the place of the last joint of a planar arm does not move with that joint.
    said, _ = mapped("--frame", "elbow", robot=str(ROBOTS / "planar2.urdf"), grid="q.shoulder=-1:1:3")
    assert "3 points, 0 out of reach, 3 singular" in said
    assert "the frame elbow cannot move in 2 independent directions there" in said
    assert "name one farther out with --frame" in said
    said, _ = mapped(grid="x=5:6:3,y=0:0:1,z=0:0:1")
    assert "note: no point of the grid is within reach and within the limits of the joints" in said


def test_another_frame_is_mapped(mapped):
    # Closed form: the elbow is at l1 (s1 c2, s2, c1 c2) from the shoulder, singular in theta3 for any posture.
    said, _ = mapped("--frame", "forearm", grid="q.theta2=-0.2:0.2:3")
    assert "frame forearm: 3 points, 0 out of reach, 3 singular" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--quantity", "mass", "--grid", GRID], r"Unknown quantity 'mass'"),
        (["--quantity", ",", "--grid", GRID], "No quantity was given: name some of manipulability"),
        (["--quantity", "stiffness", "--grid", GRID], "Nothing states how stiff the joints of phantom_1_5 are"),
        (["--quantity", "apparent_mass", "--grid", "x=1"], "wanted START:STOP:COUNT"),
        (["--quantity", "apparent_mass", "--grid", GRID, "--frame", "tipp"], r"did you mean tip\?"),
        (["--quantity", "apparent_mass", "--grid", GRID, "--jobs", "0"], "--jobs 0 was given"),
        (["--quantity", "apparent_mass", "--grid", GRID, "--q0", "1,2"], "--q0 has 2 numbers, wanted one for each of"),
        (["--quantity", "apparent_mass", "--grid", GRID, "--q0", "a,b,c"], "--q0 a,b,c was given, wanted numbers"),
        (["--quantity", "apparent_mass", "--grid", GRID, "--q0", "elbow=1"], "--q0 names the unknown joint 'elbow'"),
        (["--quantity", "apparent_mass", "--grid", GRID, "--q0", "nan,0,0"], "give one number for each of theta1"),
        (["--grid", GRID], "--quantity"),
    ],
)
def test_a_refusal_is_one_sentence(refusal, words, message):
    assert re.search(message, refusal("phantom_1_5", *words))


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        ("example:ur10", "has 6 active joints, and a tip position does not determine them: give a grid over joints"),
        ("phantom_15", "did you mean phantom_1_5?"),
    ],
)
def test_a_robot_that_is_not_there_or_has_no_grid_over_its_tip_is_refused(refusal, robot, message):
    assert message in refusal(robot, "--quantity", "apparent_mass", "--grid", GRID)


def test_a_file_where_the_folder_should_be_is_refused(tmp_path, capsys):
    out = tmp_path / "file"
    out.write_text("mine")
    words = ["map", "phantom_1_5", "--quantity", "apparent_mass", "--grid", GRID, "--out", str(out)]
    assert main(words) == 2
    assert "is a file, wanted a folder" in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_without_the_library_for_netcdf_the_map_is_written_and_the_command_to_install_is_reported(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(log_and_map_files, "is_installed", lambda _: False)
    words = ["--quantity", "manipulability", "--grid", "x=0:0:1,y=0:0.1:2", "--out", str(tmp_path)]
    assert main(["map", "phantom_1_5", *words]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["manipulability.png", "map.npz"]
    said = capsys.readouterr().out
    assert "note: map.nc was not written. Writing a map as NetCDF needs netcdf4" in said
    assert "pip install 'phantom-dyn[maps]'" in said
