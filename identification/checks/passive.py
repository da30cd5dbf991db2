"""Positions of a closed chain: whether its loops close there, and where passive joints were measured."""

from __future__ import annotations

import numpy as np

from identification.recordings import Recording
from phantom_dyn.errors import ChainError, LogError
from phantom_dyn.loops.solver import tree_positions
from phantom_dyn.robot import Robot

_SHARE = 0.01
"""Disagreement that is worth a sentence, relative to the travel of the joint: any encoder is better than that."""


def check_passive(recording: Recording, robot: Robot) -> tuple[str, ...]:
    """Passive joints that were measured elsewhere than the loops put them.

    Raises:
        LogError: If the loops do not close at the recorded positions of the active joints.
    """
    if robot.chain is None or not (robot.chain.anchors or recording.passive_q):
        return ()
    try:
        tree = tree_positions(robot.model, robot.chain, recording.q)
    except ChainError as problem:
        raise LogError(f"{recording.file}: {problem}") from problem
    joints = list(robot.model.joints)[1:]
    out = []
    for joint, place in zip(robot.passive_names, robot.chain.passive, strict=True):
        if joint not in recording.passive_q:
            continue
        apart = recording.passive_q[joint] - tree[:, place]
        linear = joints[place].shortname().startswith("JointModelP")
        if not linear:
            apart = np.mod(apart + np.pi, 2 * np.pi) - np.pi
        rms = float(np.sqrt(np.mean(apart**2)))
        if rms > _SHARE * np.ptp(tree[:, place]):
            out.append(
                f"{recording.file}: the measured position of {joint} is {rms:.3g} {'m' if linear else 'rad'} (rms) "
                f"from where the loops of {robot.name} put it: look at its sign, its zero and the loops in robot.yaml."
            )
    return tuple(out)
