"""docs/files.md beside the code that reads the files. Oracle: the readers' own lists of keys."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from identification.data.change_kinds import KINDS
from identification.data.changes import KnownPayload
from identification.data.readers.column_map import ENTRY_KEYS, WHOLE_KEYS, read_column_map
from identification.data.readers.contract_columns import Quantity
from identification.export.corrected.corrected_yaml import corrected_text, read_corrected
from identification.scenarios.recordings_file import CONTROLLER_KEYS, PAYLOAD_KEYS, RECORDING_KEYS, read_changes
from phantom_dyn.model import robot_config
from phantom_dyn.model.robot_config import read_robot_config

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "files.md").read_text(encoding="utf-8")


def block(first: str) -> str:
    """The YAML of the page that begins with a key."""
    (found,) = [text for text in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL) if text.startswith(f"{first}:")]
    return found


STRUCTS = [
    one
    for one in vars(robot_config).values()
    if isinstance(one, type) and issubclass(one, msgspec.Struct) and not one.__name__.startswith("_")
    if one is not msgspec.Struct
]


@pytest.mark.parametrize("struct", STRUCTS, ids=lambda struct: struct.__name__)
def test_every_key_of_a_robot_file_is_in_the_example(struct):
    text = block("gravity")
    assert [key for key in struct.__struct_encode_fields__ if not re.search(rf"\b{key}:", text)] == []


def test_the_example_of_a_robot_file_is_read(tmp_path):
    (tmp_path / "robot.yaml").write_text(block("gravity"))
    config = read_robot_config(tmp_path / "robot.yaml")
    assert set(config.joints) == {"j1", "j2", "j3"}
    assert len(config.loops) == 2


def test_every_key_of_a_column_map_is_on_the_page():
    text = PAGE[PAGE.index("## Column map") : PAGE.index("## recordings.yaml")]
    assert [key for key in (*ENTRY_KEYS, *WHOLE_KEYS) if not re.search(rf"\b{key}:", text)] == []


def test_the_example_of_a_column_map_is_read(tmp_path):
    (tmp_path / "columns.yaml").write_text(block("t"))
    columns = read_column_map(tmp_path / "columns.yaml")
    assert columns.compensated == {"": ("gravity",), "j3": ("gravity", "friction")}
    assert columns.low_pass == {"j4": 20.0}


def test_every_column_of_a_log_is_in_its_table():
    named = set(re.findall(r"`(\w+)[.`]", "".join(re.findall(r"^\| (`.*?) \|", PAGE, re.MULTILINE))))
    assert set(get_args(Quantity)) - named == set()


def test_every_key_of_a_recordings_file_is_in_the_example():
    text = block("recordings")
    keys = (*RECORDING_KEYS, *PAYLOAD_KEYS, *CONTROLLER_KEYS)
    assert [key for key in keys if not re.search(rf"\b{key}:", text)] == []
    assert [kind for kind in KINDS if kind not in text] == []


def test_the_example_of_a_recordings_file_is_read(tmp_path):
    (tmp_path / "recordings.yaml").write_text(block("recordings"))
    (tmp_path / "tau.csv").touch()
    logs = ["loaded.csv", "soft.csv", "warm.csv", "pos.csv"]
    loaded, soft, warm, beside = read_changes(tmp_path / "recordings.yaml", logs, ("j1",))
    assert loaded.payload == KnownPayload(1.0, (0.0, 0.0, -0.6))
    assert soft.controllers["j1"].delay == 0.002
    assert (warm.changed, warm.exclude) == (("friction", "temperature"), ((0.0, 1.5), (8.0, 9.0)))
    assert beside.beside == (str(tmp_path / "tau.csv"),)


def test_the_example_of_a_corrected_file_is_read_and_has_every_key(tmp_path):
    # Oracle: the writer, which writes every key that there is.
    (tmp_path / "corrected.yaml").write_text(block("schema"))
    model = read_corrected(tmp_path / "corrected.yaml")
    assert (model.effects[0].joint, model.adjusted[0].change, model.model_error[0].slow) == ("elbow", 0.03, 0.002)
    keys = set(re.findall(r"(\w+):", corrected_text(model)))
    assert keys == set(re.findall(r"(\w+):", block("schema")))


def test_the_generated_tables_have_every_key_of_a_robot_file(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("generated_pages").keys_page()
    assert [key for struct in STRUCTS for key in struct.__struct_encode_fields__ if f"``{key}``" not in page] == []
    # By hand, from the contract of robot.yaml.
    assert "   * - ``encoder_side``\n     - one of motor, link\n     - motor\n" in page
    assert "   * - ``w.<frame>.x``, ``w.<frame>.y``, ``w.<frame>.z``\n     - ``rad/s``, ``deg/s``\n" in page
