# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Baseline: FIGAROH's base parameters with friction and offset of every joint, by its own least squares.

Its answer is the friction or the offset more than three of its own standard deviations off nominal with the largest
torque. All inertias are free in it; it names none, for what it estimates are sums of them.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from .regression import DEVIATIONS, EDGE, RATE, acting_torque, answer_of, low_passed, read_motion, root_mean_square
from .windows import Windows

EFFECTS = {"fv": "viscous_friction", "fs": "coulomb_friction", "off": "torque_offset"}
SIZES = {"fv": "coefficient", "fs": "torque"}
NOMINAL = {"fv": "damping", "fs": "friction"}


def _configuration(joints: tuple[str, ...], rate: float) -> str:
    """FIGAROH's configuration file, without what a default says; JSON is YAML."""
    components = {"friction": True, "joint_offset": True, "actuator_inertia": False}
    problem = {"include_external_forces": False, "use_joint_torques": True, "model_components": components}
    signals = {"sampling_frequency": rate, "cutoff_frequency": 0.4 * rate, "filter_type": "butterworth"}
    task = {"enabled": True, "problem": problem, "signal_processing": signals}
    properties = {"joints": {"active_joints": list(joints)}, "mechanics": {"reduction_ratios": [1.0] * len(joints)}}
    return json.dumps({"robot": {"name": "case", "properties": properties}, "tasks": {"identification": task}})


def _signals(windows: Windows) -> dict[str, np.ndarray]:
    """The recording under FIGAROH's names, low-passed and thinned out."""
    step, edge = (max(round(x / windows.dt), 1) for x in (1.0 / RATE, EDGE))
    given = {
        "positions": windows.q,
        "velocities": windows.v,
        "accelerations": windows.a,
        "torques": acting_torque(windows),
    }
    out = {name: low_passed(windows, x)[edge:-edge:step] for name, x in given.items()}
    return {"timestamps": windows.dt * step * np.arange(len(out["positions"])), **out}


def _estimates(robot_file: Path, joints: tuple[str, ...], signals: dict[str, np.ndarray]) -> dict[str, tuple]:
    """Estimate and standard deviation of each of FIGAROH's base parameters by its name."""
    from figaroh.identification.base_identification import BaseIdentification
    from figaroh.tools.robot import load_robot

    class Identification(BaseIdentification):
        """Takes the samples as they are: they are filtered already."""

        def load_trajectory_data(self, data_source=None):
            return signals

        def filter_kinematics_data(self, filter_config=None):
            self.processed_data = {key: value for key, value in self.raw_data.items() if key != "torques"}

    with tempfile.TemporaryDirectory() as place, contextlib.redirect_stdout(io.StringIO()):
        config = Path(place) / "config.yaml"
        config.write_text(_configuration(joints, RATE))
        robot = load_robot(str(robot_file), package_dirs=str(robot_file.parent), load_by_urdf=True)
        if robot.nv != len(joints):
            raise ValueError(
                f"{robot_file.name} has {robot.nv} joints and the log {len(joints)}: FIGAROH knows no loops"
            )
        one = Identification(robot, str(config))
        one.identif_config.update(act_idxq=list(range(robot.nq)), act_idxv=list(range(robot.nv)))
        one.initialize()
        one.solve(decimate=False, plotting=False)
    # FIGAROH states deviations in per cent of the estimate.
    return {
        name: (float(value), abs(float(value)) * float(share) / 100.0)
        for name, value, share in zip(one.params_base, one.phi_base, one.std_relative, strict=True)
    }


def _nominal(robot_file: Path) -> dict[str, float]:
    """Friction of the model by FIGAROH's names."""
    out = {}
    for joint in ElementTree.parse(robot_file).getroot().iter("joint"):
        said = joint.find("dynamics")
        for kind, field in NOMINAL.items():
            out[f"{kind}_{joint.get('name')}"] = float(said.get(field, 0.0)) if said is not None else 0.0
    return out


def figaroh(robot_file: Path, log_file: Path) -> dict:
    """The answer to a case; with ``left_out`` where FIGAROH is not installed."""
    if importlib.util.find_spec("figaroh") is None:
        return {
            "left_out": "FIGAROH is not installed: pip install 'gapbench[figaroh]'",
            "verdict": "no_gap",
            "findings": [],
        }
    windows = read_motion(robot_file, log_file)
    signals, nominal = _signals(windows), _nominal(robot_file)
    found = []
    for name, (value, std) in _estimates(robot_file, windows.joints, signals).items():
        kind, _, joint = name.partition("_")
        if kind not in EFFECTS or joint not in windows.joints:
            continue
        change, v = value - nominal.get(name, 0.0), signals["velocities"][:, windows.joints.index(joint)]
        if abs(change) > DEVIATIONS * std:
            shape = {"fv": v, "fs": np.sign(v), "off": np.ones(len(v))}[kind]
            torque = signals["torques"][:, windows.joints.index(joint)]
            share = root_mean_square(change * shape) / (root_mean_square(torque) + 1e-12)
            size = {SIZES[kind]: {"value": change, "std": std}} if kind in SIZES else {}
            found.append((share, {"effect": EFFECTS[kind], "joint": joint, "parameters": size}))
    return answer_of([max(found, key=lambda one: one[0])[1]] if found else [])
