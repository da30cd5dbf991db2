"""Pipes, devices and folders in the place of a file: refused at once, where reading would wait or never end."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from identification.data.readers.column_map import read_column_map
from identification.data.readers.read_table import read_raw
from identification.export.corrected.corrected_yaml import read_corrected
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from phantom_dyn.effects.user.user_effects import effects_in
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot_config import read_robot_config

READERS = {
    "log": read_raw,
    "column map": read_column_map,
    "corrected.yaml": read_corrected,
    "diagnosis.json": read_diagnosis,
    "robot.yaml": lambda path: read_robot_config(Path(path)),
    "effects": effects_in,
}


@pytest.mark.parametrize("reader", READERS)
def test_a_device_without_an_end_is_refused(reader):
    with pytest.raises(PhantomDynError, match=r"/dev/zero is a device, wanted .*save what it gives"):
        READERS[reader]("/dev/zero")


@pytest.mark.parametrize("reader", READERS)
def test_a_pipe_that_nobody_writes_to_is_refused(reader, tmp_path):
    pipe = tmp_path / "log.csv"
    os.mkfifo(pipe)
    with pytest.raises(PhantomDynError, match="is a pipe, wanted "):
        READERS[reader](pipe)


@pytest.mark.parametrize("reader", ["column map", "corrected.yaml", "robot.yaml", "effects"])
def test_a_folder_is_refused(reader, tmp_path):
    with pytest.raises(PhantomDynError, match="is a folder, wanted "):
        READERS[reader](tmp_path)


def test_a_device_is_no_robot():
    with pytest.raises(PhantomDynError, match="There is no robot file '/dev/zero'"):
        load_robot("/dev/zero")
