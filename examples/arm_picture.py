# pyright: reportAttributeAccessIssue=false
"""Draws docs/arm.svg: the small arm as measured, as its given model moves and as its corrected model does.

``python examples/arm_picture.py [FILE]``. Both models start where the arm was and are driven by the recorded torques; a
model is drawn up to the limits of its joints.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
from arm_log import ARM

import phantom_dyn as dyn
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.simulation.control import torque_over_time
from phantom_dyn.simulation.simulate import Cause, simulate

START, SECONDS, FRAMES = 6.0, 1.5, 45
SLOWER = 2.5  # times as long as it took
SCALE, WIDTH, HEIGHT = 400.0, 640, 380  # px/m, px, px
BASE = (290.0, 330.0)  # px: of the column's foot
STYLES = (("measured", "#9aa0a6", 11), ("given model", "#d1495b", 5), ("corrected model", "#00798c", 5))
TEXT = "font-family='sans-serif' font-size='15'"


def arm_motions() -> list[np.ndarray]:
    """Positions [rad] as measured, of the given and of the corrected model, shape ``(n, 3)`` each."""
    robot = dyn.load_robot(ARM / "arm.urdf")
    log = np.genfromtxt(ARM / "log.csv", delimiter=",", names=True, deletechars="")
    use = (log["t"] >= START) & (log["t"] <= START + SECONDS)
    q = np.column_stack([log[f"q.{name}"] for name in robot.joint_names])
    v = np.gradient(q, log["t"], axis=0)[use]
    torque = np.column_stack([log[f"tau.{name}"] for name in robot.joint_names])[use]
    t, q = log["t"][use], q[use]
    found = dyn.diagnose(ARM / "arm.urdf", ARM / "log.csv").findings
    causes = tuple(
        Cause(effect_named(one.effect), one.joint, np.array([value.value for value in one.parameters.values()]))
        for one in found
    )
    law = torque_over_time(t, torque)
    return [q, *(simulate(robot, own, law, t, q[0], v[0]).q for own in ((), causes))]


def side_view(q: np.ndarray) -> np.ndarray:
    """Points of the arm [px] in the plane that turns with its column, shape ``(4, 2)``."""
    robot = dyn.load_robot(ARM / "arm.urdf")
    data, limits = robot.model.createData(), (robot.model.lowerPositionLimit, robot.model.upperPositionLimit)
    q = np.clip(q, *limits)
    pin.forwardKinematics(robot.model, data, np.array([0.0, *q[1:]]))
    elbow = data.oMi[3]
    points = [np.zeros(3), data.oMi[2].translation, elbow.translation, elbow.act(np.array([0.25, 0.0, 0.0]))]
    return np.array([(BASE[0] + SCALE * p[0], BASE[1] - SCALE * p[2]) for p in points])


def picture(motions: list[np.ndarray]) -> str:
    """The animated drawing as SVG."""
    rows = np.linspace(0, len(motions[0]) - 1, FRAMES).astype(int)
    lines = []
    for (name, colour, width), motion in zip(STYLES, motions, strict=True):
        frames = [" ".join(f"{x:.1f},{y:.1f}" for x, y in side_view(motion[row])) for row in rows]
        moved = ";".join([*frames, frames[-1], frames[-1], frames[-1], frames[-1]])
        lines.append(
            f"<polyline points='{frames[0]}' fill='none' stroke='{colour}' stroke-width='{width}' "
            f"stroke-linecap='round' stroke-linejoin='round'><title>{name}</title>"
            f"<animate attributeName='points' dur='{SECONDS * SLOWER:.1f}s' repeatCount='indefinite' values='{moved}'/>"
            "</polyline>"
        )
    keys = [
        f"<line x1='20' y1='{24 + 24 * k}' x2='52' y2='{24 + 24 * k}' stroke='{colour}' stroke-width='{width}' "
        f"stroke-linecap='round'/><text x='62' y='{29 + 24 * k}' {TEXT} fill='#444'>{name}</text>"
        for k, (name, colour, width) in enumerate(STYLES)
    ]
    table = f"<line x1='60' y1='{BASE[1]}' x2='560' y2='{BASE[1]}' stroke='#444' stroke-width='2'/>"
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {HEIGHT}' width='{WIDTH}' height='{HEIGHT}'>\n"
        f"<rect width='{WIDTH}' height='{HEIGHT}' fill='white'/>\n" + "\n".join([table, *lines, *keys]) + "\n</svg>\n"
    )


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "arm.svg"
    target.write_text(picture(arm_motions()), encoding="utf-8")
    print(target)
