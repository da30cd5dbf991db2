"""Column maps. Oracle: units by their definition, and the numbers that were put in."""

from __future__ import annotations

import math

import numpy as np
import pytest

from identification.data.readers.column_map import mapped, read_column_map
from identification.data.readers.read_table import read_table
from identification.data.recording import RawTable
from phantom_dyn.errors import LogError

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
    ("key", "unit", "factor"),
    [
        ("t", "ms", 1e-3), ("t", "us", 1e-6), ("t", "ns", 1e-9), ("q.a", "deg", math.pi / 180), ("q.a", "mm", 1e-3),
        ("q_ref.a", "rev", 2 * math.pi), ("v.a", "rpm", 2 * math.pi / 60), ("v.a", "deg/s", math.pi / 180),
        ("tau.a", "Nmm", 1e-3), ("tau.a", "N m", 1.0), ("tau.a", "N", 1.0), ("i.a", "mA", 1e-3), ("u.a", "mV", 1e-3),
        ("f.tool.x", "kN", 1e3),
    ],
)  # fmt: skip
def test_units_become_si(apply, key, unit, factor):
    np.testing.assert_allclose(apply(f"{key}: {{from: load, unit: {unit}}}")[key], 3 * ONE * factor, rtol=1e-15)


def test_counts_become_radians(apply):
    np.testing.assert_allclose(apply("q.a: {from: load, counts: 4096}")["q.a"], 3 * ONE * 2 * math.pi / 4096)


def test_a_sign_flips(apply):
    np.testing.assert_array_equal(apply("tau.a: {from: load, sign: -1}")["tau.a"], -3 * ONE)


def test_a_sign_and_a_unit_go_together(apply):
    np.testing.assert_allclose(apply("tau.a: {from: load, unit: Nmm, sign: -1}")["tau.a"], -3e-3 * ONE)


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
    ],
)
def test_a_map_that_cannot_be_used_is_told(apply, text, sentence):
    with pytest.raises(LogError, match=sentence):
        apply(text)


def test_a_missing_map_is_told(tmp_path):
    with pytest.raises(LogError, match=r"no\.yaml cannot be read"):
        read_column_map(tmp_path / "no.yaml")


def test_a_map_onto_text_names_the_value(map_file):
    raw = RawTable("log.csv", {"t": ONE}, {"enc": "log.csv, line 5, column enc holds 'x' where a number should be."})
    with pytest.raises(LogError, match="line 5, column enc holds 'x'"):
        mapped(raw, read_column_map(map_file("q.a: enc")))


@pytest.mark.parametrize(("key", "factor"), [("tau.j", 100.0), ("q.j", 0.01), ("v.j", 0.01)])
def test_a_gear_takes_a_column_from_the_motors_to_the_joints_side(tmp_path, key, factor):
    # Closed form: a gear of n multiplies torque by n and divides position and speed by it.
    (tmp_path / "map.yaml").write_text(f"{key}: {{from: a, gear: 100}}\n")
    raw = RawTable("log.csv", {"a": np.array([1.0, -2.0])})
    found = mapped(raw, read_column_map(tmp_path / "map.yaml")).columns[key]
    np.testing.assert_allclose(found, factor * np.array([1.0, -2.0]), rtol=1e-15)


@pytest.mark.parametrize(
    ("entry", "told"), [("t: {from: a, gear: 2}", "leave it out"), ("q.j: {from: a, gear: 0}", "above 0")]
)
def test_a_gear_that_means_nothing_is_refused(tmp_path, entry, told):
    (tmp_path / "map.yaml").write_text(entry + "\n")
    with pytest.raises(LogError, match=told):
        read_column_map(tmp_path / "map.yaml")


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


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ("q.j: {low_pass: 20}", r"is for torques: write tau: \{low_pass: 20\}"),
        ("tau: {low_pass: 0}", "low_pass is 0, wanted the cut-off in Hz, above 0"),
        ("tau: {low_pass: yes}", "low_pass is true, wanted the cut-off in Hz"),
        ("tau: {low_pass: fast}", "low_pass is the text 'fast', wanted the cut-off in Hz"),
    ],
)
def test_a_low_pass_that_means_nothing_is_refused(map_file, entry, told):
    with pytest.raises(LogError, match=told):
        read_column_map(map_file(entry + "\n"))


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ("tau: {compensated: weight}", r"compensated is the text 'weight', wanted gravity or friction, or \[gravity"),
        ("tau: {compensated: [friction, 3]}", r"compensated is the list \['friction', 3\], wanted gravity or friction"),
        (f"? {'x' * 3000}\n: {{compensated: gravity}}", r"yaml: x{79}…\.compensated is for torques"),
        (f"? {'x' * 3000}\n: {{from: null}}", r"yaml: x{79}…\.from is empty"),
        ("tau: {compensated: []}", r"compensated is the list \[\], wanted gravity or friction"),
        ("q.j: {compensated: gravity}", r"is for torques: write tau: \{compensated: gravity\}"),
    ],
)
def test_a_compensation_that_means_nothing_is_refused(map_file, entry, told):
    with pytest.raises(LogError, match=told):
        read_column_map(map_file(entry + "\n"))
