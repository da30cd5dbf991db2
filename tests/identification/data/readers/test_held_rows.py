import numpy as np
import pytest

from identification.data.readers.contract_columns import contract_table
from identification.data.readers.held_rows import rows_once_read
from identification.data.recording import RawTable


def log_of(readings: np.ndarray, held: float) -> dict[str, np.ndarray]:
    """A log at 200 Hz in which each reading of position and torque stays for so many rows."""
    rows = np.arange(int(len(readings) * held))
    at = np.floor(rows / held).astype(int)
    return {"t": 0.005 * rows, "q.j1": readings[at], "tau.j1": np.cos(3.0 * readings[at])}


@pytest.mark.parametrize("held", [1.5, 2.0, 4.0])
def test_each_reading_is_kept_once(held, rng):
    # Known truth: the readings that were written several times.
    readings = rng.normal(size=400)
    columns = log_of(readings, held)
    kept, each = rows_once_read(columns)
    np.testing.assert_array_equal(columns["q.j1"][kept], readings)
    assert each == pytest.approx(held, rel=0.01)


def test_a_standstill_keeps_a_row_for_each_reading(rng):
    readings = rng.normal(size=400)
    readings[200:300] = readings[200]
    kept, _ = rows_once_read(log_of(readings, 4.0))
    assert kept.sum() == 400


def test_a_log_of_new_readings_keeps_all_rows(rng):
    kept, each = rows_once_read(log_of(rng.normal(size=400), 1.0))
    assert kept.all()
    assert each == 1.0


def test_a_slow_joint_on_a_coarse_encoder_keeps_all_rows():
    # Its readings change at times that follow the speed, not at one rate.
    t = np.arange(4000) * 0.005
    q = np.round(np.sin(0.7 * t) / 0.003) * 0.003
    kept, each = rows_once_read({"t": t, "q.j1": q, "tau.j1": np.round(20.0 * q) / 20.0})
    assert kept.all()
    assert each == 1.0


def test_the_table_of_such_a_log_says_how_often_the_robot_was_read(rng):
    columns = log_of(rng.normal(size=400), 4.0)
    table = contract_table(RawTable("log.csv", columns))
    assert len(table.columns["t"]) == 400
    assert table.warnings == (
        "log.csv: each reading of the robot is written 4 times, exactly: it was read at 50 Hz and logged at 200 Hz; "
        "the repeated rows were dropped.",
    )
