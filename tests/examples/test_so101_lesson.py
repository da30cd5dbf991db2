"""The lesson on an SO-101: its dataset is LeRobot's, and the page shows what its commands print."""

from __future__ import annotations

import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest

from called_example import printed
from identification.cli.main import main
from places import CHECKOUT

# What the example calls has tests of its own, which check its annotations.
pytestmark = pytest.mark.whole

PAGE = (CHECKOUT / "docs" / "tutorials" / "so101_lerobot.md").read_text()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the first command of the page was given."""
    here = tmp_path_factory.mktemp("lesson")
    printed("so101_dataset.py", here / "so101")
    return here


def test_the_page_shows_the_answer_that_its_command_prints(folder, monkeypatch, capsys):
    # Oracle: the run itself.
    (command,) = re.findall(r"```\nphantom-dyn (diagnose .*?) --out report/\n```", PAGE)
    (answer,) = re.findall(r"```\n(The gap between robot and model .*?)```", PAGE, flags=re.DOTALL)
    monkeypatch.chdir(folder)
    assert main(command.split()) == 0
    assert capsys.readouterr().out.startswith(answer)


def test_without_a_column_map_the_unit_is_asked_for(folder, monkeypatch, capsys):
    (command,) = re.findall(r"```\nphantom-dyn (check .*)\n```", PAGE)
    monkeypatch.chdir(folder)
    assert main(command.split()) != 0
    said = "".join(capsys.readouterr())
    assert "does not say the unit of its joints" in said
    assert 'q.elbow_flex: {from: "observation.state.elbow_flex.pos", unit: deg}' in said


@pytest.mark.parametrize("name", ["columns.yaml", "robot.yaml"])
def test_the_page_shows_the_files_that_the_script_writes(folder, name):
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)
    assert (folder / "so101" / name).read_text() in blocks


def test_frames_are_counted_within_and_across_episodes(folder):
    # Oracle: LeRobot's layout v3.0, in which timestamp is frame_index / fps and index runs through all episodes.
    (path,) = (folder / "so101").glob("data/chunk-000/file-*.parquet")
    rows = pq.read_table(path).to_pydict()
    info = json.loads((folder / "so101" / "meta" / "info.json").read_text())
    assert set(rows) == set(info["features"])
    assert rows["index"] == list(range(info["total_frames"]))
    np.testing.assert_allclose(rows["timestamp"], np.array(rows["frame_index"]) / info["fps"], rtol=1e-6)
