"""Options that say how a recording is read. Oracle: the contract, and the datasets that were written."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from identification.cli.main import main
from places import ROBOTS

ARM = str(ROBOTS / "pendulum.urdf")


@pytest.fixture
def dataset(tmp_path):
    """A LeRobot dataset of three episodes of one joint, and a map of its columns."""
    folder = tmp_path / "dataset"
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    feature = {"dtype": "float32", "shape": [1], "names": ["swing.pos"]}
    info = {"total_episodes": 3, "features": {"observation.state": feature, "action": feature}}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    for k in range(3):
        t = np.arange(100 + k) / 30
        lists = (20 * np.sin(3 * t))[:, None].tolist()
        columns = {"observation.state": lists, "action": lists, "timestamp": t, "episode_index": np.full(len(t), k)}
        pq.write_table(pa.table(columns), folder / "data" / "chunk-000" / f"episode_{k:06d}.parquet")
    path = tmp_path / "columns.yaml"
    path.write_text("t: timestamp\nq.swing: {from: observation.state.swing.pos, unit: deg}\n")
    return str(folder), str(path)


def test_every_episode_of_a_dataset_is_checked_as_a_recording(dataset, capsys):
    folder, columns = dataset
    assert main(["check", folder, "--columns", columns]) == 0
    said = capsys.readouterr().out
    assert [f"episode_{k:06d}: {100 + k} samples" in said for k in range(3)] == [True, True, True]


def test_episodes_are_chosen_by_the_option(dataset, capsys):
    folder, columns = dataset
    assert main(["check", folder, "--columns", columns, "--episodes", "1:2"]) == 0
    said = capsys.readouterr().out
    assert "episode_000001: 101 samples" in said
    assert "episode_000000" not in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--episodes", "3:9"], "has the episodes 0 to 2"),
        (["--columns", "ur_rtd"], "did you mean ur_rtde?"),
        ([], "does not say the unit of its joints"),
    ],
)
def test_what_cannot_be_read_ends_with_one_sentence(dataset, capsys, options, said):
    assert main(["check", dataset[0], *options]) == 2
    assert said in capsys.readouterr().err


def test_a_command_for_one_recording_asks_for_one_episode(dataset, capsys, tmp_path):
    words = ["degrade", ARM, dataset[0], "--effect", "backlash", "--joint", "swing", "--set", "gap=0.01"]
    assert main([*words, "--out", str(tmp_path / "cheap.csv")]) == 2
    assert "has 3 episodes, wanted one: choose it, as in --episodes 0" in capsys.readouterr().err
