"""Columns that hold lists. Oracle: the arrays that were written."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from identification.data.readers.read_table import read_table
from identification.data.reading import read_recording
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from places import CHECKOUT

N = 60
T = np.arange(N) * 0.01
Q = np.sin(np.outer(T, [3.0, 5.0])) + 1
TAU = np.cos(np.outer(T, [3.0, 5.0])) + 2


def test_arrays_of_an_npz_take_the_names_that_stand_beside_them(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=TAU, joint_names=np.array(["elbow", "wrist"]))
    columns = read_table(tmp_path / "log.npz").columns
    np.testing.assert_array_equal(columns["q.wrist"], Q[:, 1])
    np.testing.assert_array_equal(columns["tau.elbow"], TAU[:, 0])


def test_names_of_joints_make_a_preset_need_no_order(tmp_path):
    np.savez(tmp_path / "log.npz", time=T, joint_pos=Q, applied_torque=TAU, joint_names=np.array(["wrist", "elbow"]))
    table = read_table(tmp_path / "log.npz", columns="isaac_lab", joints=("elbow", "wrist"))
    np.testing.assert_array_equal(table.columns["q.wrist"], Q[:, 0])
    assert table.warnings == ()


def test_without_names_they_are_asked_for_with_a_map_that_reads_the_file(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=TAU)
    robot = load_robot(CHECKOUT / "tests" / "robots" / "planar2.urdf")
    with pytest.raises(LogError, match="A map to begin with") as refusal:
        read_recording(tmp_path / "log.npz", robot)
    (tmp_path / "columns.yaml").write_text(str(refusal.value).partition("columns.yaml:\n")[2])
    found = read_table(tmp_path / "log.npz", columns=tmp_path / "columns.yaml").columns
    np.testing.assert_array_equal(found[f"q.{robot.joint_names[1]}"], Q[:, 1])


def test_one_entry_of_a_map_takes_all_places_of_a_list(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, angles=np.rad2deg(Q))
    (tmp_path / "columns.yaml").write_text('q: {from: "angles[{number}]", unit: deg}\n')
    found = read_table(tmp_path / "log.npz", columns=tmp_path / "columns.yaml", joints=("a", "b")).columns
    np.testing.assert_allclose(found["q.b"], Q[:, 1], rtol=1e-14)


@pytest.mark.parametrize("kind", [pa.list_(pa.float32()), pa.list_(pa.float64(), 2), pa.large_list(pa.float64())])
def test_lists_in_parquet_become_columns(tmp_path, kind):
    pq.write_table(pa.table({"t": T, "angles": pa.array(Q.tolist(), kind)}), tmp_path / "log.parquet")
    (tmp_path / "columns.yaml").write_text('q: "angles[{number}]"\n')
    found = read_table(tmp_path / "log.parquet", columns=tmp_path / "columns.yaml", joints=("a", "b")).columns
    np.testing.assert_allclose(found["q.b"], Q[:, 1], rtol=1e-6)


@pytest.mark.parametrize("form", ["[{}, {}]", "[{} {}]", "[ {},{} ]"])
def test_lists_in_cells_become_columns(tmp_path, form):
    rows = [f'{t},"{form.format(*map(float, q))}"' for t, q in zip(T, Q, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["t,angles", *rows]))
    (tmp_path / "columns.yaml").write_text('q: "angles[{number}]"\n')
    found = read_table(tmp_path / "log.csv", columns=tmp_path / "columns.yaml", joints=("a", "b")).columns
    np.testing.assert_allclose(found["q.b"], Q[:, 1], rtol=1e-14)


@pytest.mark.parametrize("cell", ["[1, 2, 3]", "[1, x]", "3", "[]"])
def test_a_cell_with_another_list_is_told_with_its_line(tmp_path, cell):
    rows = [f'{t},"{cell if k == 7 else [0.5, 1.5]}"' for k, t in enumerate(T)]
    (tmp_path / "log.csv").write_text("\n".join(["t,angles", *rows]))
    (tmp_path / "columns.yaml").write_text("q.a: angles\n")
    with pytest.raises(LogError, match=r"log\.csv, line 9, column angles holds .*, wanted a list of 2 numbers"):
        read_table(tmp_path / "log.csv", columns=tmp_path / "columns.yaml")


def test_an_image_is_no_list_of_joints(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, image=np.zeros((N, 640)))
    (tmp_path / "columns.yaml").write_text("q.a: image\n")
    with pytest.raises(LogError, match=r"array image has the shape \(60, 640\)"):
        read_table(tmp_path / "log.npz", columns=tmp_path / "columns.yaml")


def test_lists_that_differ_in_length_are_told(tmp_path):
    lists = [[1.0, 2.0]] * (N - 1) + [[1.0]]
    pq.write_table(pa.table({"t": T, "angles": lists}), tmp_path / "log.parquet")
    (tmp_path / "columns.yaml").write_text("q.a: angles\n")
    with pytest.raises(LogError, match="holds lists of 2 numbers in row 1 and 1 in row 60"):
        read_table(tmp_path / "log.parquet", columns=tmp_path / "columns.yaml")
