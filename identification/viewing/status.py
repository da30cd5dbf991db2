"""Makes the texts on the page of a replay: summary, meaning of the colours, and values at the current time."""

from __future__ import annotations

import numpy as np

from identification.viewing.charts import Chart
from identification.viewing.replay import Replay
from identification.words.numbers_and_names import number, percent


def legend(replay: Replay) -> str:
    """Explanation of the colours of joints."""
    return (
        f"Joints are grey without a torque residual and orange where it is {percent(replay.full)} of the joint's usual "
        "torque or more (root mean square over 0.2 s). Click a joint for its curves."
    )


def curve_names(chart: Chart) -> str:
    """The names of the curves in their colours, as HTML."""
    named = zip(chart.names, chart.colours, strict=True)
    words = "".join(f'<span style="color:{colour};margin-right:1.5em">&#9632; {name}</span>' for name, colour in named)
    return f'<div style="text-align:center;font-size:0.85em">{words}</div>'


def summary(replay: Replay) -> str:
    """Lines on the recording, the models and the simulation."""
    lines = [f"{replay.robot.name}, {replay.file}, {number(float(replay.t[-1] - replay.t[0]))} s."]
    if replay.horizon_s is not None:
        lines.append(f"Simulated motion starts again from the recorded one every {replay.horizon_s:g} s.")
    if replay.corrections:
        lines.append(f"The corrected model has {', '.join(replay.corrections)}.")
    elif len(replay.copies) < 3:
        lines.append("No diagnosis was given, so there is no corrected model: --diagnosis FILE adds it.")
    else:
        lines.append("The diagnosis found nothing, so the corrected model is the given one.")
    return "\n\n".join([*lines, *replay.notes])


def now_table(replay: Replay, moment: float, frame: int) -> str:
    """Position, torque and residuals of each joint at a moment, as a table in Markdown.

    Args:
        replay: The replay with its curves.
        moment: Time in the recording [s].
        frame: Index of the frame at this time.
    """
    curves, robot = replay.curves, replay.robot
    row = int(np.argmin(np.abs(curves.t - moment)))
    models = [curves.residual(k)[row] for k in range(len(curves.modelled))]
    heads = ["joint", "position", "torque", *("given", "corrected")[: len(models)]]
    units = ", ".join(dict.fromkeys((*robot.position_units, *robot.torque_units)))
    lines = [f"At {moment:.2f} s, with the residual of each model [{units}]:", ""]
    lines += [_row(heads), _row(["---", *["---:"] * (len(heads) - 1)])]
    for j, joint in enumerate(robot.joint_names):
        sizes = (replay.copies[0].q[frame, j], curves.measured[row, j], *(model[j] for model in models))
        lines.append(_row([joint, *(number(float(x)) for x in sizes)]))
    return "\n".join(lines)


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"
