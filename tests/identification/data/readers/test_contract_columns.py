"""Names and values of a log's columns, and the formats of their tables."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from identification.data.readers import array_files
from identification.data.readers.contract_columns import Column, column_of, contract_table
from identification.data.readers.read_table import read_table
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


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda columns: table(columns, **{"temp.a": put(np.full(len(columns["t"]), 40.0), 3, 3000.0)}),
            r"column temp\.a is 3000, which no sensor gives \(limit 2000\)",
            id="a temperature that no drive has",
        ),
        pytest.param(
            lambda columns: table(columns, t=None),
            r"has no column t \(time in seconds\), its columns are q\.a, v\.a",
            id="a log without time lists its columns",
        ),
        pytest.param(
            lambda columns: table(columns, **{"q.a": None, "q.b": None}),
            r"has no column q\.<joint> \(measured position\), its columns are t, v\.a",
            id="a log without position lists its columns",
        ),
        pytest.param(
            lambda columns: contract_table(RawTable("log.csv", {"price": columns["t"], "size": columns["t"]})),
            r"has none of a log's columns .* its columns are price, size",
            id="a table of other things is no log",
        ),
        pytest.param(
            lambda columns: table(columns, t=1.7e18 + 1e7 * columns["t"]),
            r"column t is .* which no sensor gives .* give the time in seconds, or write t: {from: t, unit: ns} into",
            id="a time in nanoseconds is refused",
        ),
        pytest.param(
            lambda columns: table(columns, t=put(columns["t"], 10, 0.05)),
            r"row 11: the time goes back from 0\.09 s to 0\.05 s",
            id="a time that goes back is refused with both times",
        ),
        pytest.param(
            lambda columns: table(columns, t=put(columns["t"], 10, columns["t"][9])),
            r"row 11: the time 0\.09 s is that of the row before, but q\.a differs",
            id="the same time with other values is refused",
        ),
        pytest.param(
            lambda columns: contract_table(
                RawTable("log.csv", {name: values[:49] for name, values in columns.items()})
            ),
            "has 49 rows, too few to tell anything: record at least 50",
            id="too few rows are refused",
        ),
        pytest.param(
            lambda columns: contract_table(RawTable("log.csv", {name: values[:1] for name, values in columns.items()})),
            "has 1 row, too few to tell anything: record at least 50, better several seconds of motion",
            id="one row is refused",
        ),
        pytest.param(
            lambda columns: contract_table(RawTable("log.csv", {name: values[:0] for name, values in columns.items()})),
            "has no rows",
            id="no rows are refused",
        ),
    ],
)
def test_what_cannot_be_is_refused(columns, call, message):
    with pytest.raises(LogError, match=message):
        call(columns)


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
def test_a_name_of_the_wrong_shape_is_reported(columns, name, sentence):
    with pytest.raises(LogError, match=sentence):
        table(columns, **{name: columns["t"]})


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_is_reported_with_row_and_column(columns, value):
    with pytest.raises(LogError, match=rf"log\.csv, row 8, column tau\.b is {value}: every value must be a number"):
        table(columns, **{"tau.b": put(columns["tau.b"], 7, value)})


def test_more_rows_without_a_number_are_counted(columns):
    said = r"row 8, column tau\.b is nan, and 2 more rows are no numbers: .* delete these rows"
    with pytest.raises(LogError, match=said):
        table(columns, **{"tau.b": put(columns["tau.b"], [7, 9, 10], np.nan)})


def test_a_column_without_any_number_is_one_to_leave_out(columns):
    said = r"log\.csv: column tau\.b is nan in every row: record it, or leave the column out"
    with pytest.raises(LogError, match=said):
        table(columns, **{"tau.b": np.full(len(columns["tau.b"]), np.nan)})


@pytest.mark.parametrize(("name", "value"), [("q.a", 2e6), ("tau.a", -2e9), ("v.b", 1e30)])
def test_a_value_that_no_sensor_gives_is_reported(columns, name, value):
    with pytest.raises(
        LogError, match=rf"row 4, column {name} is {value:g}, which no sensor gives".replace("+", r"\+")
    ):
        table(columns, **{name: put(columns[name], 3, value)})


def test_identical_repeated_rows_are_dropped_and_counted(columns):
    repeated = {name: np.repeat(values, [1] * 20 + [3] + [1] * 39) for name, values in columns.items()}
    out = table(repeated)
    assert out.warnings == ("log.csv: 2 rows that repeat the one before were dropped.",)
    np.testing.assert_array_equal(out.columns["q.a"], columns["q.a"])


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


def test_csv_npz_and_parquet_give_the_same_numbers(tmp_path, write, lines, columns):
    np.savez(tmp_path / "log.npz", **columns)
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    tables = [read_table(write(lines)), read_table(tmp_path / "log.npz"), read_table(tmp_path / "log.parquet")]
    for table in tables:
        assert set(table.columns) == set(columns)
        for name, values in columns.items():
            np.testing.assert_array_equal(table.columns[name], values)


def test_columns_cannot_be_written_to(write, lines):
    with pytest.raises(ValueError, match="read-only"):
        read_table(write(lines)).columns["t"][0] = 1.0


def test_the_content_tells_the_format_not_the_ending(tmp_path, columns):
    np.savez_compressed(tmp_path / "a.npz", **columns)
    (tmp_path / "a.npz").rename(tmp_path / "a.csv")
    assert set(read_table(tmp_path / "a.csv").columns) == set(columns)


def test_arrays_of_floats_and_integers_become_float64(tmp_path, columns):
    # Numbers that every one of these types holds, one of them in the other order of bytes and with steps backwards.
    odd = {"q.a": np.arange(60.0)[::-1].astype(">f4")[::-1], "tau.a": np.arange(60, dtype=np.int16)}
    np.savez(tmp_path / "log.npz", **columns | odd)
    found = read_table(tmp_path / "log.npz").columns
    assert {v.dtype for v in found.values()} == {np.dtype(np.float64)}
    for name in odd:
        np.testing.assert_array_equal(found[name], np.arange(60.0))


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.array([1.0, None] * 30, dtype=object), r"array q\.a holds Python objects, which are not loaded"),
        (np.zeros((60, 2)), r"array q\.a has the shape \(60, 2\): write one 1-D array per column"),
        (np.array(["1"] * 60), r"array q\.a holds <U1 where numbers should be"),
    ],
    ids=["pickled", "two dimensions", "text"],
)
def test_an_array_of_a_joint_that_is_no_row_of_numbers_is_refused(tmp_path, columns, array, said):
    np.savez(tmp_path / "log.npz", **columns | {"q.a": array})
    with pytest.raises(LogError, match=said):
        read_table(tmp_path / "log.npz")


def test_arrays_of_different_length_are_refused(tmp_path, columns):
    columns["tau.b"] = columns["tau.b"][:-1]
    np.savez(tmp_path / "log.npz", **columns)
    with pytest.raises(LogError, match=r"column tau\.b has 59 rows and t has 60"):
        read_table(tmp_path / "log.npz")


def test_an_npz_without_arrays_is_refused(tmp_path):
    np.savez(tmp_path / "log.npz")
    with pytest.raises(LogError, match=r"log\.npz is empty"):
        read_table(tmp_path / "log.npz")


def test_text_in_parquet_is_refused(tmp_path, columns):
    pq.write_table(pa.table({**columns, "q.a": ["x"] * 60}), tmp_path / "log.parquet")
    with pytest.raises(LogError, match=r"column q\.a holds string where numbers should be"):
        read_table(tmp_path / "log.parquet")


def test_times_of_a_calendar_are_refused_with_the_unit_that_is_wanted(tmp_path, columns):
    stamps = np.datetime64("2026-01-01", "ns") + np.arange(60)
    pq.write_table(pa.table({**columns, "t": stamps}), tmp_path / "log.parquet")
    np.savez(tmp_path / "log.npz", **columns | {"t": stamps})
    for name in ("log.parquet", "log.npz"):
        with pytest.raises(LogError, match=r"\bt holds .*\[ns\] where numbers should be: write seconds as floats\."):
            read_table(tmp_path / name)


def test_a_missing_value_in_parquet_is_refused_with_its_row(tmp_path, columns):
    values = [*columns["q.a"][:9].tolist(), None, *columns["q.a"][10:].tolist()]
    pq.write_table(pa.table({**columns, "q.a": values}), tmp_path / "log.parquet")
    with pytest.raises(LogError, match=r"log\.parquet, row 10, column q\.a is nan"):
        read_table(tmp_path / "log.parquet")


def test_a_name_twice_in_parquet_is_refused(tmp_path, columns):
    arrays = [pa.array(v) for v in columns.values()]
    pq.write_table(pa.Table.from_arrays([*arrays, arrays[0]], names=[*columns, "t"]), tmp_path / "log.parquet")
    with pytest.raises(LogError, match="the column name t is there twice"):
        read_table(tmp_path / "log.parquet")


def test_a_missing_file_names_the_nearest(write, lines):
    path = write(lines, "arm_run1.csv")
    with pytest.raises(LogError, match=r"arm_rum1\.csv does not exist; did you mean arm_run1\.csv"):
        read_table(path.with_name("arm_rum1.csv"))


def test_a_missing_folder_is_reported(tmp_path):
    with pytest.raises(LogError, match="does not exist, nor does its folder"):
        read_table(tmp_path / "no" / "log.csv")


def test_a_folder_that_is_no_bag_is_reported(tmp_path):
    with pytest.raises(LogError, match=r"is a folder without metadata\.yaml, so no ROS 2 bag"):
        read_table(tmp_path)


def test_a_file_without_permission_is_reported(write, lines, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    path = write(lines)
    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(LogError, match=r"cannot be read \(Permission denied\): give"):
        read_table(path)


def test_without_its_library_parquet_is_refused_with_the_command_that_installs_it(tmp_path, monkeypatch):
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"t": [0.0, 1.0]}), path)
    monkeypatch.setattr(array_files, "is_installed", lambda _: False)
    wanted = r"log\.parquet is Parquet\. Reading or writing Parquet needs pyarrow.*pip install 'phantom-dyn\[parquet\]'"
    with pytest.raises(LogError, match=wanted):
        read_table(path)


def test_a_line_with_too_few_values_of_the_same_number_everywhere_is_no_table(tmp_path):
    # Three names over two columns: NumPy alone would take them.
    (tmp_path / "log.csv").write_text("t,q.j,tau.j\n0,1\n1,2\n")
    with pytest.raises(LogError, match="line 2 has 2 values where 3 columns are named"):
        read_table(tmp_path / "log.csv")
