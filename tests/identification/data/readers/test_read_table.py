"""NPZ and Parquet, and the choice of a reader. Oracle: the numbers that were written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from identification.data.readers import array_files
from identification.data.readers.read_table import read_table
from phantom_dyn.errors import LogError


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
    columns["q.a"] = columns["q.a"].astype(np.float32)
    columns["tau.a"] = np.arange(60, dtype=np.int16)
    np.savez(tmp_path / "log.npz", **columns)
    assert {v.dtype for v in read_table(tmp_path / "log.npz").columns.values()} == {np.dtype(np.float64)}


def test_pickled_arrays_are_refused(tmp_path, columns):
    columns["q.a"] = np.array([1.0, None] * 30, dtype=object)
    np.savez(tmp_path / "log.npz", **columns)
    with pytest.raises(LogError, match=r"array q\.a holds Python objects, which are not loaded"):
        read_table(tmp_path / "log.npz")


def test_two_dimensional_arrays_under_the_name_of_a_joint_are_refused(tmp_path, columns):
    columns["q.a"] = np.zeros((60, 2))
    np.savez(tmp_path / "log.npz", **columns)
    with pytest.raises(LogError, match=r"array q\.a has the shape \(60, 2\): write one 1-D array per column"):
        read_table(tmp_path / "log.npz")


def test_arrays_of_different_length_are_refused(tmp_path, columns):
    columns["tau.b"] = columns["tau.b"][:-1]
    np.savez(tmp_path / "log.npz", **columns)
    with pytest.raises(LogError, match=r"column tau\.b has 59 rows and t has 60"):
        read_table(tmp_path / "log.npz")


def test_arrays_of_text_are_refused(tmp_path, columns):
    columns["tau.b"] = np.array(["1"] * 60)
    np.savez(tmp_path / "log.npz", **columns)
    with pytest.raises(LogError, match=r"array tau\.b holds <U1 where numbers should be"):
        read_table(tmp_path / "log.npz")


def test_an_npz_without_arrays_is_refused(tmp_path):
    np.savez(tmp_path / "log.npz")
    with pytest.raises(LogError, match=r"log\.npz is empty"):
        read_table(tmp_path / "log.npz")


def test_text_in_parquet_is_refused(tmp_path, columns):
    pq.write_table(pa.table({**columns, "q.a": ["x"] * 60}), tmp_path / "log.parquet")
    with pytest.raises(LogError, match=r"column q\.a holds string where numbers should be"):
        read_table(tmp_path / "log.parquet")


def test_a_missing_value_in_parquet_is_refused_with_its_row(tmp_path, columns):
    values = [*columns["q.a"][:9].tolist(), None, *columns["q.a"][10:].tolist()]
    pq.write_table(pa.table({**columns, "q.a": values}), tmp_path / "log.parquet")
    with pytest.raises(LogError, match=r"log\.parquet, row 10, column q\.a is nan"):
        read_table(tmp_path / "log.parquet")


def test_a_name_twice_in_parquet_is_refused(tmp_path, columns):
    arrays = [pa.array(v) for v in columns.values()]
    pq.write_table(pa.Table.from_arrays([*arrays, arrays[0]], names=[*columns, "t"]), tmp_path / "log.parquet")
    with pytest.raises(LogError, match="the column name t stands there twice"):
        read_table(tmp_path / "log.parquet")


def test_a_missing_file_names_the_nearest(write, lines):
    path = write(lines, "arm_run1.csv")
    with pytest.raises(LogError, match=r"arm_rum1\.csv does not exist; did you mean arm_run1\.csv"):
        read_table(path.with_name("arm_rum1.csv"))


def test_a_missing_folder_is_told(tmp_path):
    with pytest.raises(LogError, match="does not exist, nor does its folder"):
        read_table(tmp_path / "no" / "log.csv")


def test_a_folder_that_is_no_bag_is_told(tmp_path):
    with pytest.raises(LogError, match=r"is a folder without metadata\.yaml, so no ROS 2 bag"):
        read_table(tmp_path)


def test_a_file_without_permission_is_told(write, lines, monkeypatch):
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
