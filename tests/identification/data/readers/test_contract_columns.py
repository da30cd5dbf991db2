"""What a log must have and what cannot be right in it: each bad input gives its sentence."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.readers.contract_columns import Column, column_of, contract_table
from identification.data.recording import RawTable
from phantom_dyn.errors import LogError


def table(columns, **changes):
    """The table of columns with some of them changed, and those set to None left out."""
    merged = {name: values for name, values in {**columns, **changes}.items() if values is not None}
    return contract_table(RawTable("log.csv", merged))


def put(values, row, value):
    out = values.copy()
    out[row] = value
    return out


def test_a_good_log_gives_no_warning(columns):
    assert table(columns).warnings == ()


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("t", Column("t")),
        ("q.j1", Column("q", "j1")),
        ("q_ref.arm.j1", Column("q_ref", "arm.j1")),
        ("temp.j1", Column("temp", "j1")),
        ("f.tool0.x", Column("f", "tool0", "x")),
        ("f.a.b.z", Column("f", "a.b", "z")),
        ("time", None),
        ("temp", None),
        ("q.", None),
        ("f.tool0", None),
        ("f.tool0.w", None),
        ("f..x", None),
    ],
)
def test_the_meaning_of_a_name(name, column):
    assert column_of(name) == column


def test_a_temperature_that_is_of_no_joint_stops_no_log(columns):
    # Other quantities without a joint are refused as misnamed.
    assert table(columns, temp=columns["t"]).warnings == ("log.csv: column temp not used: no name of a log's columns.",)


def test_a_temperature_that_no_drive_has_is_refused(columns):
    with pytest.raises(LogError, match=r"column temp\.a is 3000, which no sensor gives \(limit 2000\)"):
        table(columns, **{"temp.a": put(np.full(len(columns["t"]), 40.0), 3, 3000.0)})


def test_a_log_without_time_lists_its_columns(columns):
    with pytest.raises(LogError, match=r"has no column t \(time in seconds\), its columns are q\.a, v\.a"):
        table(columns, t=None)


def test_a_log_without_position_lists_its_columns(columns):
    with pytest.raises(LogError, match=r"has no column q\.<joint> \(measured position\), its columns are t, v\.a"):
        table(columns, **{"q.a": None, "q.b": None})


def test_a_table_of_other_things_is_no_log(columns):
    with pytest.raises(LogError, match=r"has none of a log's columns .* its columns are price, size"):
        contract_table(RawTable("log.csv", {"price": columns["t"], "size": columns["t"]}))


def test_unknown_columns_are_ignored_with_a_warning(columns):
    out = table(columns, temperature=columns["t"], mode=columns["t"])
    assert out.warnings == ("log.csv: columns temperature, mode not used: no name of a log's columns.",)
    assert "mode" not in out.columns


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("f.tool", r"a force is written f\.<frame>\.x, f\.<frame>\.y or f\.<frame>\.z, not f\.tool"),
        ("tau", r"a column of a joint is written tau\.<joint>, not tau"),
        ("q.", r"a column of a joint is written q\.<joint>, not q\."),
        ("Q.a", r"a column of a joint is written q\.<joint>, not Q\.a"),
        ("t.a", r"the time is written t, not t\.a"),
    ],
)
def test_a_name_of_the_wrong_shape_is_told(columns, name, sentence):
    with pytest.raises(LogError, match=sentence):
        table(columns, **{name: columns["t"]})


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_is_told_with_row_and_column(columns, value):
    with pytest.raises(LogError, match=rf"log\.csv, row 8, column tau\.b is {value}: every value must be a number"):
        table(columns, **{"tau.b": put(columns["tau.b"], 7, value)})


@pytest.mark.parametrize(("name", "value"), [("q.a", 2e6), ("tau.a", -2e9), ("v.b", 1e30)])
def test_a_value_that_no_sensor_gives_is_told(columns, name, value):
    with pytest.raises(
        LogError, match=rf"row 4, column {name} is {value:g}, which no sensor gives".replace("+", r"\+")
    ):
        table(columns, **{name: put(columns[name], 3, value)})


def test_a_time_in_nanoseconds_is_told(columns):
    with pytest.raises(LogError, match=r"column t is .* which no sensor gives .* give the time in seconds"):
        table(columns, t=1.7e18 + 1e7 * columns["t"])


def test_a_time_that_goes_back_is_told_with_both_times(columns):
    with pytest.raises(LogError, match=r"row 11: the time goes back from 0\.09 s to 0\.05 s"):
        table(columns, t=put(columns["t"], 10, 0.05))


def test_the_same_time_with_other_values_is_told(columns):
    with pytest.raises(LogError, match=r"row 11: the time 0\.09 s is that of the row before, but q\.a differs"):
        table(columns, t=put(columns["t"], 10, columns["t"][9]))


def test_identical_repeated_rows_are_dropped_and_counted(columns):
    repeated = {name: np.repeat(values, [1] * 20 + [3] + [1] * 39) for name, values in columns.items()}
    out = table(repeated)
    assert out.warnings == ("log.csv: 2 rows that repeat the one before were dropped.",)
    np.testing.assert_array_equal(out.columns["q.a"], columns["q.a"])


def test_too_few_rows_are_told(columns):
    with pytest.raises(LogError, match="has 49 rows, too few to tell anything: record at least 50"):
        contract_table(RawTable("log.csv", {name: values[:49] for name, values in columns.items()}))


def test_no_rows_are_told(columns):
    with pytest.raises(LogError, match="has no rows"):
        contract_table(RawTable("log.csv", {name: values[:0] for name, values in columns.items()}))


@pytest.mark.parametrize("step", [1e-6, 2e-9, 1e-300])
def test_times_in_another_unit_are_refused(step):
    n = np.arange(60.0)
    raw = RawTable("log.csv", {"t": step * n, "q.a": n, "tau.a": n})
    with pytest.raises(
        LogError, match=r"log\.csv: the time steps by .* s \(median\), wanted 1e-05 s or more: give the"
    ):
        contract_table(raw)


@pytest.mark.parametrize("step", [1e-5, 1e-3, 100.0])
def test_times_of_every_recorder_are_taken(step):
    n = np.arange(60.0)
    assert len(contract_table(RawTable("log.csv", {"t": step * n, "q.a": n, "tau.a": n})).columns["t"]) == 60
