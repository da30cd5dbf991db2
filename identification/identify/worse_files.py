"""Model files of an identification that would leave more on held-out data than the given model are not handed out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.data.log import Log
from identification.diagnosis.columns.blocks import split_blocks
from identification.diagnosis.replay import Replay
from identification.export.proof.judged_files import leaves_more, rms
from identification.identify.identification import Export
from identification.words.numbers_and_names import number
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot


def without_worse_files(
    files: tuple[Export, ...], robots: Mapping[str, Robot], given: Robot, logs: tuple[Log, ...], cutoff_hz: float
) -> tuple[Export, ...]:
    """The files; of one that leaves more than the given model on any joint the reason in the place of its text.

    Args:
        files: Model files.
        robots: What each of them holds, by its name.
        given: The robot as its file states it.
        logs: That the fit has not seen.
        cutoff_hz: Edge of the band of the fit.
    """
    weights = tuple(np.repeat(log.valid_in_band[:, None].astype(float), given.nv, axis=1) for log in logs)
    parts = tuple((block.log, block.core, block.stop) for block in split_blocks(logs, cutoff_hz))
    replay = Replay(given, logs, (), cutoff_hz, parts, weights)
    before = replay.squares(lambda k: inverse_dynamics(given, logs[k].motion))
    out = []
    for file in files:
        robot = robots[file.file]
        left = replay.squares(lambda k, robot=robot: inverse_dynamics(robot, logs[k].motion))
        worse = leaves_more(left, before)
        if file.text and worse.any():
            after, had = rms(left), rms(before)
            j = int(np.argmax(np.where(worse, after / np.maximum(had, 1e-300), 0.0)))
            unit = given.torque_units[j]
            reason = (
                f"Not written: on {given.joint_names[j]} it would leave {number(after[j])} {unit} on held-out data, "
                f"where the given model leaves {number(had[j])} {unit}."
            )
            file = replace(file, text="", left_out=(reason,))
        out.append(file)
    return tuple(out)
