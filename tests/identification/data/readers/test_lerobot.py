"""LeRobot datasets. Oracles: the numbers that were written, by pyarrow, in the layouts of v2.1 and v3."""

import json
import os

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from identification.data.readers.lerobot import with_episodes
from identification.data.readers.read_table import read_table
from identification.data.reading import read_recording
from phantom_dyn.errors import LogError, UsageError
from phantom_dyn.model.loading import load_robot
from places import CHECKOUT

N, EPISODES = 60, 3
NAMES = ("joint1.pos", "joint2.pos", "gripper.pos")
MAP = "t: timestamp\n" + "".join(
    f"{q}.{j}: {{from: {f}.{j}.pos, unit: deg}}\n"
    for q, f in (("q", "observation.state"), ("q_ref", "action"))
    for j in ("joint1", "joint2")
)


def state(episode):
    return (10 * np.sin(np.outer(np.arange(N), [0.05, 0.08, 0.11])) + episode).astype(np.float32)


def rows(episode, **changed):
    lists = pa.list_(pa.float32())
    columns = {
        "observation.state": pa.array(state(episode).tolist(), lists),
        "action": pa.array((state(episode) + 1).tolist(), lists),
        "timestamp": pa.array(np.arange(N) / 30, pa.float32()),
        "frame_index": pa.array(np.arange(N)),
        "episode_index": pa.array(np.full(N, episode)),
        "task_index": pa.array(np.zeros(N, int)),
        **changed,
    }
    return pa.table(columns)


def info(names=NAMES, **changed):
    feature = {"dtype": "float32", "shape": [3], "names": names if names is None else list(names)}
    features = {"observation.state": feature, "action": feature}
    return {"codebase_version": "v3.0", "fps": 30, "total_episodes": EPISODES, "features": features, **changed}


def write_info(folder, content):
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "meta" / "info.json").write_text(json.dumps(content))


@pytest.fixture(params=["v2.1", "v3"])
def dataset(tmp_path, request):
    """The same three episodes in both layouts."""
    folder = tmp_path / "dataset"
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    write_info(folder, info())
    if request.param == "v2.1":
        for k in range(EPISODES):
            pq.write_table(rows(k), chunk / f"episode_{k:06d}.parquet")
    else:
        pq.write_table(pa.concat_tables([rows(0), rows(1)]), chunk / "file-000.parquet", row_group_size=N)
        pq.write_table(rows(2), chunk / "file-001.parquet")
    return folder


@pytest.fixture
def columns(tmp_path):
    path = tmp_path / "columns.yaml"
    path.write_text(MAP)
    return path


@pytest.mark.parametrize("episode", range(EPISODES))
def test_an_episode_is_a_recording_of_its_own_rows(dataset, columns, episode):
    table = read_table(dataset / f"episode_{episode:06d}", columns=columns)
    np.testing.assert_allclose(table.columns["q.joint2"], np.deg2rad(state(episode)[:, 1]), rtol=1e-6)
    np.testing.assert_allclose(table.columns["q_ref.joint1"], np.deg2rad(state(episode)[:, 0] + 1), rtol=1e-6)
    np.testing.assert_allclose(table.columns["t"], np.arange(N) / 30, rtol=1e-6)


def test_actions_act_until_the_next_frame(dataset, columns):
    # LeRobot sends one action a frame; a map of names does not change that.
    assert read_table(dataset / "episode_000000", columns=columns).references_held


def test_the_file_of_an_episode_of_format_2_is_that_episode(tmp_path, columns):
    path = tmp_path / "old" / "data" / "chunk-000" / "episode_000001.parquet"
    path.parent.mkdir(parents=True)
    write_info(tmp_path / "old", info())
    pq.write_table(rows(1), path)
    np.testing.assert_allclose(
        read_table(path, columns=columns).columns["q.joint1"], np.deg2rad(state(1)[:, 0]), rtol=1e-6
    )


def test_the_unit_is_asked_for_with_a_map_that_reads_the_episode(dataset, tmp_path):
    with pytest.raises(LogError, match="does not say the unit of its joints: save this map as") as refusal:
        read_table(dataset / "episode_000000", joints=("joint1", "joint2"))
    path = tmp_path / "asked.yaml"
    path.write_text(str(refusal.value).partition("columns.yaml:\n")[2])
    found = read_table(dataset / "episode_000000", columns=path).columns
    assert set(found) == {"t", "q.joint1", "q.joint2", "q_ref.joint1", "q_ref.joint2"}
    np.testing.assert_allclose(found["q.joint1"], np.deg2rad(state(0)[:, 0]), rtol=1e-6)


def test_names_that_the_robot_does_not_have_are_suggested_in_its_order(dataset):
    with pytest.raises(LogError, match=r'q\.b: \{from: "observation\.state\.joint2\.pos", unit: deg\}'):
        read_table(dataset / "episode_000000", joints=("a", "b", "c"))


def test_without_names_the_places_are_numbered(dataset, columns):
    write_info(dataset, info(names=None))
    columns.write_text('t: timestamp\nq: {from: "observation.state[{number}]", unit: deg}\n')
    found = read_table(dataset / "episode_000000", columns=columns, joints=("a", "b", "c"))
    np.testing.assert_allclose(found.columns["q.c"], np.deg2rad(state(0)[:, 2]), rtol=1e-6)
    assert "taken in the robot's order: observation.state[0] is a" in found.warnings[0]


def test_names_of_older_datasets_stand_in_a_mapping(dataset, columns):
    content = info()
    for feature in content["features"].values():
        feature["names"] = {"motors": list(NAMES)}
    write_info(dataset, content)
    assert "q.joint1" in read_table(dataset / "episode_000000", columns=columns).columns


@pytest.mark.parametrize(("choice", "numbers"), [(None, [0, 1, 2]), ("1:3", [1, 2]), ("2", [2])])
def test_episodes_are_chosen_by_number_without_the_end(dataset, choice, numbers):
    assert with_episodes([str(dataset)], choice) == [str(dataset / f"episode_{k:06d}") for k in numbers]


@pytest.mark.parametrize(("choice", "said"), [("0:4", "has the episodes 0 to 2"), ("b", "wanted A:B such as 0:5"),
                                              ("2:2", "has the episodes 0 to 2"), ("-1", "wanted A:B")])  # fmt: skip
def test_a_choice_that_is_none_is_refused(dataset, choice, said):
    with pytest.raises(UsageError, match=said):
        with_episodes([str(dataset)], choice)


def test_episodes_without_a_dataset_are_refused(tmp_path):
    with pytest.raises(UsageError, match="no LOG is the folder of a LeRobot dataset"):
        with_episodes([str(tmp_path / "log.csv")], "0:1")


def test_a_dataset_of_several_episodes_asks_which(dataset):
    with pytest.raises(LogError, match="is a LeRobot dataset of 3 episodes, each a recording: choose with --episodes"):
        read_table(dataset)


def test_an_episode_that_is_not_there_is_reported(dataset, columns):
    with pytest.raises(LogError, match=r"has no episode_000007: neither data/chunk-\*/episode_000007\.parquet"):
        read_table(dataset / "episode_000007", columns=columns)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is no JSON"),
        ("[" * 100_000, "is no JSON"),
        ("[1]", "has no features"),
        (json.dumps({"features": {}, "total_episodes": -1}), "total_episodes is -1"),
        (json.dumps({"features": {}, "total_episodes": 10**12}), "total_episodes is 1000000000000"),
    ],
    ids=["cut off", "deep", "no mapping", "negative", "many"],
)
def test_a_damaged_description_is_reported(dataset, text, said):
    (dataset / "meta" / "info.json").write_text(text)
    with pytest.raises(LogError, match=said):
        read_table(dataset)


def test_a_pipe_in_the_place_of_a_data_file_is_refused(tmp_path, columns):
    folder = tmp_path / "piped"
    (folder / "data" / "chunk-000").mkdir(parents=True)
    write_info(folder, info())
    os.mkfifo(folder / "data" / "chunk-000" / "episode_000000.parquet")
    with pytest.raises(LogError, match="is a pipe, wanted a Parquet file of a LeRobot dataset"):
        read_table(folder / "episode_000000", columns=columns)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"observation.state": pa.array([[1.0] * (2 + (k == 5)) for k in range(N)])},
         "holds lists of 2 numbers in row 1 and 3 in row 6"),
        ({"observation.state": pa.array(["a"] * N)}, "has no observation.state"),
        ({"timestamp": pa.array(["a"] * N)}, "timestamp holds string, wanted seconds"),
    ],
    ids=["uneven lists", "texts", "no times"],
)  # fmt: skip
def test_data_that_are_no_joint_states_are_reported(tmp_path, columns, changed, said):
    folder = tmp_path / "odd"
    (folder / "data" / "chunk-000").mkdir(parents=True)
    write_info(folder, info())
    pq.write_table(rows(0, **changed), folder / "data" / "chunk-000" / "episode_000000.parquet")
    with pytest.raises(LogError, match=said):
        read_table(folder / "episode_000000", columns=columns)


def test_lists_that_unpack_to_more_than_a_file_can_hold_are_refused(tmp_path, columns):
    folder = tmp_path / "large"
    (folder / "data" / "chunk-000").mkdir(parents=True)
    write_info(folder, info())
    # The same list of zeros everywhere packs to a few kB.
    wide = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(N * 500_000, np.float32)), 500_000)
    path = folder / "data" / "chunk-000" / "episode_000000.parquet"
    pq.write_table(rows(0, **{"observation.state": wide}), path, compression="zstd")
    with pytest.raises(LogError, match=r"unpacks to .* MB or more, which no recording does"):
        read_table(folder / "episode_000000", columns=columns)


def test_an_episode_becomes_a_recording_of_the_robot(dataset, columns):
    robot = load_robot(CHECKOUT / "tests" / "robots" / "planar2.urdf")
    first, second = robot.joint_names
    columns.write_text(MAP.replace(".joint1:", f".{first}:").replace(".joint2:", f".{second}:"))
    found = read_recording(dataset / "episode_000002", robot, columns=columns, torque_needed=False)
    assert found.file == "episode_000002"
    np.testing.assert_allclose(found.q, np.deg2rad(state(2)[:, :2]), rtol=1e-6)
