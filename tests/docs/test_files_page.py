"""docs/files.md beside the code that reads the files. Oracle: the readers' own lists of keys."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from identification.data.readers import column_map
from phantom_dyn.model import robot_config
from phantom_dyn.model.robot_config import read_robot_config

PAGE = (Path(__file__).parents[2] / "docs" / "files.md").read_text(encoding="utf-8")


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
    keys = (*column_map._KEYS, "rate", "ignore")
    assert [key for key in keys if not re.search(rf"\b{key}:", PAGE)] == []
