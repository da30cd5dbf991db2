"""Writes the log of the small arm: ``python examples/arm_log.py [FILE]``; without FILE the one of the first diagnosis.

Fifteen seconds of a simulated arm that carries 0.4 kg, of which its model says nothing. It follows three sines a joint
under proportional and derivative control; positions are read to 0.02 mrad, torques with noise of 0.02 N m.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import phantom_dyn as dyn
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate

ARM = Path(__file__).parent / "data" / "arm"
RATE_HZ, SECONDS = 100.0, 15.0
FLAW = ("payload", None, (0.4, 0.24, 0.0, 0.02))
"""What the model lacks: mass [kg] and centre [m] in the forearm's frame, which lies in the elbow."""
_STEP, _NOISE = 2e-5, 0.02  # [rad], [N m]


def arm_log(seed: int = 1) -> dict[str, np.ndarray]:
    """Columns of the log: time [s], positions [rad] and torques [N m] of the joints."""
    robot = dyn.load_robot(ARM / "arm.urdf")
    rng = np.random.default_rng(seed)
    fine = np.arange(round(SECONDS * 1000)) / 1000.0
    middle = np.array([0.0, -0.6, 0.8])
    hertz = np.array([[0.13, 0.34, 0.61], [0.17, 0.29, 0.71], [0.11, 0.43, 0.83]])
    size = np.array([[0.8, 0.3, 0.12], [0.4, 0.25, 0.1], [0.6, 0.35, 0.15]])
    phase = rng.uniform(0.0, 2 * np.pi, size=hertz.shape)
    angle = 2 * np.pi * hertz[None] * fine[:, None, None] + phase[None]
    q_ref = middle + np.sum(size * np.sin(angle), axis=2)
    v_ref = np.sum(size * 2 * np.pi * hertz * np.cos(angle), axis=2)
    law = position_control(fine, q_ref, v_ref, kp=np.array([60.0, 90.0, 40.0]), kd=np.array([4.0, 6.0, 2.5]))
    effect, joint, theta = FLAW
    t = fine[:: round(1000 / RATE_HZ)]
    moved = simulate(robot, (Cause(effect_named(effect), joint, np.array(theta)),), law, t, q_ref[0], v_ref[0])
    columns = {"t": t}
    for k, name in enumerate(robot.joint_names):
        columns[f"q.{name}"] = np.round(moved.q[:, k] / _STEP) * _STEP
        columns[f"tau.{name}"] = moved.tau[:, k] + _NOISE * rng.standard_normal(len(t))
    return columns


def write_arm_log(path: Path) -> None:
    """The log as CSV."""
    columns = arm_log()
    rows = zip(*columns.values(), strict=True)
    digits = [{"t": ".2f", "q": ".5f"}.get(name.partition(".")[0], ".3f") for name in columns]
    lines = [",".join(format(value, form) for value, form in zip(row, digits, strict=True)) for row in rows]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([",".join(columns), *lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ARM / "log.csv"
    write_arm_log(target)
    print(target)
