"""Writes a LeRobot dataset of a simulated SO-101: ``python examples/so101_dataset.py [FOLDER]``.

Two episodes of twenty seconds at 50 frames a second. The gripper holds 0.15 kg, of which the model says nothing, and
the goals reach the servos 30 ms late. The dataset is in LeRobot's layout v3.0, without pictures and tables of tasks
and statistics. Beside it lie the files that a diagnosis takes: ``columns.yaml`` and ``robot.yaml``.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from arguments import chosen_folder

import phantom_dyn as dyn
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate

ARM = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
FRAMES_A_SECOND, SECONDS, EPISODES = 50, 20, 2
KP, KD = 12.0, 0.184  # of each servo [N m/rad, N m s/rad]
ROTOR = 0.02  # of each motor, behind its gear [kg m^2]
LOAD = (0.15, 0.0, 0.0, -0.08)
"""What the gripper holds: mass [kg] and centre [m] in the frame of the gripper's link, between its jaws."""
LATE = 0.03  # [s]
_COUNT = 360.0 / 4096  # of a servo's encoder [deg]
_STEP = 1e-6  # in which a goal changes [s]

GAINS = f"controller: {{kind: pd, kp: {KP}, kd: {KD}}}, rotor_inertia: {ROTOR}"
SERVO = f"{{{GAINS}, encoder_side: link, encoder_counts: 4096}}"
ROBOT_YAML = "lock: [gripper]\ntolerance: {inertia: 0.10}\njoints:\n" + "".join(f"  {name}: {SERVO}\n" for name in ARM)
COLUMNS_YAML = """t: timestamp
q: {from: "observation.state.{joint}.pos", unit: deg}
q_ref: {from: "action.{joint}.pos", unit: deg}
ignore: [observation.state.gripper.pos, action.gripper.pos]
"""


def episode(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Measured positions and goals of the arm [deg], a row a frame: three sines a joint about a bent posture."""
    t = np.arange(FRAMES_A_SECOND * SECONDS) / FRAMES_A_SECOND
    middle = np.array([0.0, -0.5, 0.6, 0.5, 0.0])
    hertz = np.array([0.11, 0.29, 0.67]) * rng.uniform(0.85, 1.15, size=(5, 3))
    size = np.array([0.5, 0.25, 0.08]) * np.array([1.0, 0.7, 0.8, 0.8, 1.2])[:, None]
    phase = rng.uniform(0.0, 2 * np.pi, size=(5, 3))
    goals = middle + np.sum(size * np.sin(2 * np.pi * hertz * t[:, None, None] + phase), axis=2)
    # A servo holds a goal until the next one arrives.
    arrivals = np.column_stack([t, t + 1.0 / FRAMES_A_SECOND - _STEP]).ravel() + LATE
    held = np.repeat(goals, 2, axis=0)
    law = position_control(arrivals, held, np.zeros_like(held), kp=np.full(5, KP), kd=np.full(5, KD))
    moved = simulate(robot, (Cause(effect_named("payload"), None, np.array(LOAD)),), law, t, goals[0])
    return np.round(np.rad2deg(moved.q) / _COUNT) * _COUNT, np.rad2deg(goals)


def frames(number: int, first: int, state: np.ndarray, goals: np.ndarray) -> pa.Table:
    """Rows of an episode as LeRobot keeps them; the gripper, which is closed, stands at 0."""
    lists, count = pa.list_(pa.float32()), np.arange(len(state))
    shut = np.zeros((len(state), 1))
    return pa.table(
        {
            "observation.state": pa.array(np.hstack([state, shut]).tolist(), lists),
            "action": pa.array(np.hstack([goals, shut]).tolist(), lists),
            "timestamp": pa.array(count / FRAMES_A_SECOND, pa.float32()),
            "frame_index": count,
            "episode_index": np.full(len(state), number),
            "index": first + count,
            "task_index": np.zeros(len(state), int),
        }
    )


def info() -> dict:
    """Content of ``meta/info.json``."""
    names = [f"{name}.pos" for name in (*ARM, "gripper")]
    joints = {"dtype": "float32", "shape": [len(names)], "names": names}
    counts = ("frame_index", "episode_index", "index", "task_index")
    features = {"observation.state": joints, "action": joints}
    features |= {"timestamp": {"dtype": "float32", "shape": [1], "names": None}}
    features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in counts}
    return {
        "codebase_version": "v3.0",
        "robot_type": "so101_follower",
        "total_episodes": EPISODES,
        "total_frames": EPISODES * FRAMES_A_SECOND * SECONDS,
        "fps": FRAMES_A_SECOND,
        "splits": {"train": f"0:{EPISODES}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "features": features,
    }


def write_dataset(folder: Path, seed: int = 0) -> None:
    """The dataset, with ``robot.yaml`` and ``columns.yaml`` in its folder."""
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True, exist_ok=True)
    (folder / "meta").mkdir(exist_ok=True)
    (folder / "robot.yaml").write_text(ROBOT_YAML, encoding="utf-8")
    (folder / "columns.yaml").write_text(COLUMNS_YAML, encoding="utf-8")
    (folder / "meta" / "info.json").write_text(json.dumps(info(), indent=1), encoding="utf-8")
    robot, rng = dyn.load_robot("example:so101", config=folder / "robot.yaml"), np.random.default_rng(seed)
    rows = FRAMES_A_SECOND * SECONDS
    tables = [frames(k, k * rows, *episode(robot, rng)) for k in range(EPISODES)]
    pq.write_table(pa.concat_tables(tables), chunk / "file-000.parquet", row_group_size=rows)


if __name__ == "__main__":
    target = chosen_folder(__doc__, "so101")
    write_dataset(target)
    print(target)
