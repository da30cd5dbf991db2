# pyright: reportAttributeAccessIssue=false
"""A recording cut into windows that a simulator can follow without a controller, and the model that follows it."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import yaml
from scipy.signal import savgol_filter

SECONDS = 0.25  # of a window: longer ones run away from the recording whatever the parameters
STIFF = 2.0  # [time steps]: how fast a passive joint is drawn to where the active ones put it
STEPS = 2000  # simulated per recording, spread evenly over it
SMOOTH = 0.03  # [s] over which positions are differentiated


@dataclass(frozen=True)
class Windows:
    """The recording in windows; joints are those that a motor drives.

    Attributes:
        joints: Their names.
        dt: Sampling interval [s].
        q, v, a: Motion at every sample, ``(N, nv)``, smoothed but for the position.
        tau: Torque held from each sample to the next, ``(N, nv)``.
        starts: First sample of each window.
        length: Samples of a window.
        passive: Passive joints of a closed chain, each with its factors of the active ones.
    """

    joints: tuple[str, ...]
    dt: float
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    starts: np.ndarray
    length: int
    passive: Mapping[str, dict[str, float]]


def config_of(robot_file: Path) -> dict:
    """``robot.yaml`` beside the robot; empty where there is none."""
    path = robot_file.with_name("robot.yaml")
    return yaml.safe_load(path.read_text()) if path.is_file() else {}


def passive_joints(config: dict) -> dict[str, dict[str, float]]:
    """Passive joints of linear loops, each with its factors of the active ones."""
    out: dict[str, dict[str, float]] = {}
    for loop in config.get("loops") or []:
        if loop["kind"] != "linear":
            raise ValueError(f"a loop of kind {loop['kind']} was given: this baseline knows linear ones")
        for joint, text in loop["passive"].items():
            out[joint] = {
                name: float(f"{sign}{factor or 1}")
                for sign, factor, name in re.findall(r"([+-]?)\s*(?:([\d.]+)\s*\*\s*)?([A-Za-z_]\w*)", text)
            }
    return out


def spread(model: mujoco.MjModel, windows: Windows) -> np.ndarray:
    """Positions of all joints of the simulated model from those of the active ones, ``(nq, nv)``."""
    names = [model.joint(i).name for i in range(model.njnt)]
    return np.array([[windows.passive.get(n, {n: 1.0}).get(joint, 0.0) for joint in windows.joints] for n in names])


def _tie(spec: mujoco.MjSpec, joint: str, factors: dict[str, float], dt: float) -> None:
    """Holds a passive joint where the active ones put it: a tendon of joints whose length stays zero."""
    tendon = spec.add_tendon(name=f"loop.{joint}")
    tendon.wrap_joint(joint, -1.0)
    for name, factor in factors.items():
        tendon.wrap_joint(name, factor)
    tie = spec.add_equality(name1=tendon.name, type=mujoco.mjtEq.mjEQ_TENDON, objtype=mujoco.mjtObj.mjOBJ_TENDON)
    tie.solref = [STIFF * dt, 1.0]


def robot_spec(robot_file: Path, dt: float) -> mujoco.MjSpec:
    """The given model with a motor on each active joint, without meshes and contacts."""
    config = config_of(robot_file)
    passive = passive_joints(config)
    tree = ElementTree.fromstring(robot_file.read_text())
    for link in tree.iter("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(part)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(tree, encoding="unicode"))
    spec.option.timestep = dt
    spec.option.gravity = config.get("gravity", [0.0, 0.0, -9.81])
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    spec.compiler.balanceinertia = True
    for joint in list(spec.joints):
        if joint.name in config.get("lock", []):
            spec.delete(joint)
            continue
        if joint.name in passive:
            _tie(spec, joint.name, passive[joint.name], dt)
            continue
        stated = (config.get("joints") or {}).get(joint.name, {})
        joint.armature = stated.get("rotor_inertia", 0.0)
        motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0] = 1.0
        for name, kind in (("q", mujoco.mjtSensor.mjSENS_JOINTPOS), ("v", mujoco.mjtSensor.mjSENS_JOINTVEL)):
            spec.add_sensor(
                name=f"{name}.{joint.name}", type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint.name
            )
    return spec


def read_windows(robot_file: Path, log_file: Path, joints: tuple[str, ...]) -> Windows:
    """The log of these joints, cut into windows."""
    log = np.genfromtxt(log_file, delimiter=",", names=True, deletechars="", replace_space=" ")
    t = log["t"]
    dt = float(np.median(np.diff(t)))
    q = np.column_stack([log[f"q.{joint}"] for joint in joints])
    tau = np.column_stack([log[f"tau.{joint}"] for joint in joints])
    config = config_of(robot_file)
    if config.get("torque_hold", "instant") == "instant":
        tau = 0.5 * (tau + np.vstack([tau[1:], tau[-1:]]))
    span = 2 * (round(SMOOTH / dt) // 2) + 1
    v, a = (np.asarray(savgol_filter(q, max(span, 5), 3, deriv=d, delta=dt, axis=0)) for d in (1, 2))
    length = round(SECONDS / dt)
    count = max(1, min((len(t) - 1) // length, STEPS // length))
    starts = np.linspace(0, len(t) - 1 - length, count).round().astype(int)
    return Windows(joints, dt, q, v, a, tau, starts, length, passive_joints(config))
