"""Motion of every joint of a robot at the samples of a diagnosis: of those in the log, and of passive ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.diagnosis.result import Diagnosis
from phantom_dyn.closed_chain import tree_motion
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


@dataclass(frozen=True)
class JointMotion:
    """``N`` samples of one joint: position [rad or m], velocity, acceleration, each of shape ``(N,)``."""

    q: Float[Array, " N"]
    v: Float[Array, " N"]
    a: Float[Array, " N"]


def joint_motions(robot: Robot | None, diagnosis: Diagnosis) -> dict[str, JointMotion]:
    """Motion of each joint by name; of passive joints only where the robot is given and a finding names one."""
    evidence = diagnosis.evidence
    out = {
        gap.joint: JointMotion(evidence.q[:, k], evidence.v[:, k], evidence.a[:, k])
        for k, gap in enumerate(diagnosis.joints)
    }
    named = {name for finding in diagnosis.findings if finding.joint for name in finding.joint.split("+")}
    if robot is None or robot.chain is None or not named - set(out) or not len(evidence.t):
        return out
    tree = tree_motion(robot, Motion(evidence.t, evidence.q, evidence.v, evidence.a))
    for name, row in zip(robot.passive_names, robot.chain.passive, strict=True):
        out[name] = JointMotion(tree.q[:, row], tree.v[:, row], tree.a[:, row])
    return out
