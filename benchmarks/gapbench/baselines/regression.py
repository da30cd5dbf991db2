# pyright: reportAttributeAccessIssue=false
"""What the baselines on inverse dynamics work on: torque that the model leaves, and columns for each cause.

MuJoCo gives the inverse dynamics of the model; its friction and rotors are added with their nominal sizes. Residual and
columns are low-passed and thinned out, so that samples are nearly independent.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.signal import butter, sosfiltfilt

from .windows import Windows, config_of, read_windows, robot_spec, spread

BAND = 20.0  # [Hz]: what is above is noise of the differentiated positions
RATE = 2.0 * BAND  # [Hz] of the samples that are kept
EDGE = 0.25  # [s] at both ends, where filters swing
SLOW = 0.02  # of its highest speed: below it a joint may stick, and its friction has no known sign
NEAR = 0.05  # [s] around such samples that the low pass spreads them over
FEWEST = 50  # samples of a joint; one with fewer hardly moves, and all of its samples are kept
STRIBECK = 0.1  # [rad/s]: one speed for friction that fades
SMALL = 1e-4  # step of the differences: relative, or [rad]
DEVIATIONS = 3.0  # of a size that is taken for different from zero


@dataclass(frozen=True)
class Candidate:
    """A cause in one place.

    Attributes:
        effect, joint: As in an answer.
        columns: Torque that each of its sizes adds, in units of each joint's own torque, joints behind each other,
            ``(n, k)``.
        size: Name in an answer of a single column's size; empty where an answer has other ones.
    """

    effect: str
    joint: str | None
    columns: np.ndarray
    size: str = ""


@dataclass(frozen=True)
class Task:
    """One recording, ready for least squares.

    Attributes:
        windows: The recording.
        residual: Torque less that of the model, rows as the columns of `Candidate`, ``(n,)``.
        candidates: The catalogue.
        nuisances: What one standard deviation of the stated tolerance adds, ``(n, m)``.
        torque, model: Torque at each sample as it acted, and as the model wants it, ``(N, nv)``.
        rows: Makes rows of a torque ``(N, nv)``.
    """

    windows: Windows
    residual: np.ndarray
    candidates: tuple[Candidate, ...]
    nuisances: np.ndarray
    torque: np.ndarray
    model: np.ndarray
    rows: Callable[[np.ndarray], np.ndarray]


def read_motion(robot_file: Path, log_file: Path) -> Windows:
    """The recording.

    Raises:
        ValueError: If the files are none that these baselines read: a URDF and a CSV of positions and torques.
    """
    joints = driven_joints(log_file) if log_file.suffix == ".csv" else ()
    if robot_file.suffix != ".urdf" or not joints:
        raise ValueError(f"{robot_file.name} and {log_file.name} were given: these baselines read URDF and CSV")
    return read_windows(robot_file, log_file, joints)


def driven_joints(log_file: Path) -> tuple[str, ...]:
    """Joints of a log in CSV."""
    header = log_file.open().readline().strip().split(",")
    return tuple(name.removeprefix("q.") for name in header if name.startswith("q."))


def _inverse(model: mujoco.MjModel, windows: Windows, q: np.ndarray) -> np.ndarray:
    """Torque of the driven joints at positions ``q`` and the speeds of the recording, ``(N, nv)``."""
    every = spread(model, windows)
    data, out = mujoco.MjData(model), np.empty((len(q), model.nv))
    whole = [x @ every.T for x in (q, windows.v, windows.a)]
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = (x[k] for x in whole)
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    return out @ every


def _rigid(given: mujoco.MjModel) -> mujoco.MjModel:
    """The model without friction, rotors and the ties of passive joints."""
    out = copy.copy(given)
    out.dof_armature[:] = out.dof_damping[:] = out.dof_frictionloss[:] = 0.0
    out.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return out


def _bodies(model: mujoco.MjModel) -> list[int]:
    """Moving bodies from the base outwards."""
    return [b for b in range(1, model.nbody) if model.body_mass[b] > 0 and model.body_weldid[b] != 0]


def _changed(model: mujoco.MjModel, body: int, field: str, change: object) -> mujoco.MjModel:
    """The model with a little more in a field of a body."""
    out = copy.copy(model)
    getattr(out, field)[body] += SMALL * np.asarray(change)
    return out


def _tilted(model: mujoco.MjModel, axis: np.ndarray) -> mujoco.MjModel:
    out = copy.copy(model)
    out.opt.gravity[:] = model.opt.gravity + SMALL * np.cross(axis, model.opt.gravity)
    return out


def acting_torque(windows: Windows) -> np.ndarray:
    """Torque that acts at each sample: the mean of the holds before and behind it, ``(N, nv)``."""
    return 0.5 * (windows.tau + np.vstack([windows.tau[:1], windows.tau[:-1]]))


def low_passed(windows: Windows, x: np.ndarray) -> np.ndarray:
    """A signal of the recording without what is above `BAND`."""
    return sosfiltfilt(butter(4, min(BAND * windows.dt * 2.0, 0.9), output="sos"), x, axis=0)


def _used(windows: Windows) -> list[np.ndarray]:
    """Samples of each joint that are kept: thinned out, without both ends, and away from where it may stick."""
    step, edge, near = (max(round(x / windows.dt), 1) for x in (1.0 / RATE, EDGE, NEAR))
    slow = np.abs(windows.v) < SLOW * np.abs(windows.v).max(axis=0)
    out = []
    for j in range(len(windows.joints)):
        may_stick = np.convolve(slow[:, j], np.ones(2 * near + 1), mode="same") > 0
        may_stick[:edge] = may_stick[-edge:] = True
        kept = np.flatnonzero(~may_stick)
        out.append(kept[::step] if len(kept) > FEWEST * step else np.arange(edge, len(slow) - edge, step))
    return out


def read_task(robot_file: Path, log_file: Path) -> Task:
    """Reads a case and computes the columns of all candidates."""
    windows = read_motion(robot_file, log_file)
    joints = windows.joints
    given = robot_spec(robot_file, windows.dt).compile()
    rigid, n = _rigid(given), len(joints)
    rigid_torque = _inverse(rigid, windows, windows.q)
    dofs = [int(given.joint(joint).dofadr[0]) for joint in joints]
    sign = np.sign(windows.v)
    shapes = {"armature": windows.a, "damping": windows.v, "frictionloss": sign}
    friction = {name: x * np.ravel(getattr(given, f"dof_{name}"))[dofs] for name, x in shapes.items()}
    model = rigid_torque + sum(friction.values())
    torque = acting_torque(windows)
    scale = np.sqrt(np.mean(torque**2, axis=0)) + 1e-12
    used = _used(windows)

    def rows(x: np.ndarray) -> np.ndarray:
        filtered = low_passed(windows, x) / scale
        return np.concatenate([filtered[samples, j] for j, samples in enumerate(used)])

    def at(j: int, x: np.ndarray) -> np.ndarray:
        out = np.zeros((len(x), n))
        out[:, j] = x
        return rows(out)

    def change(of: mujoco.MjModel, q: np.ndarray = windows.q) -> np.ndarray:
        return (_inverse(of, windows, q) - rigid_torque) / SMALL

    bodies = _bodies(rigid)
    masses, inertias = (
        [rows(change(_changed(rigid, b, field, getattr(rigid, field)[b]))) for b in bodies]
        for field in ("body_mass", "body_inertia")
    )
    centres = [
        rows(change(_changed(rigid, b, "body_ipos", np.linalg.norm(rigid.body_ipos[b]) * axis)))
        for b in bodies
        for axis in np.eye(3)
    ]
    payload = masses[-1] / rigid.body_mass[bodies[-1]]
    gravity = np.array(rigid.opt.gravity)
    tilts = [rows(change(_tilted(rigid, axis))) for axis in np.eye(3) if np.any(np.cross(axis, gravity))]
    out = [
        Candidate("payload", None, payload[:, None], "mass"),
        Candidate("base_tilt", None, np.column_stack(tilts)),
        Candidate("input_delay", None, rows(np.gradient(model, windows.dt, axis=0))[:, None], "delay"),
    ]
    for j, joint in enumerate(joints):
        body = int(rigid.jnt_bodyid[given.joint(joint).id])
        level, moved = at(j, sign[:, j]), SMALL * np.eye(n)[j]
        fading = at(j, sign[:, j] * np.exp(-((windows.v[:, j] / STRIBECK) ** 2)))
        one, place = at(j, np.ones(len(windows.q))), at(j, windows.q[:, j])
        out += [
            Candidate("coulomb_friction", joint, level[:, None], "torque"),
            Candidate("viscous_friction", joint, at(j, windows.v[:, j])[:, None], "coefficient"),
            Candidate("rotor_inertia", joint, at(j, windows.a[:, j])[:, None], "inertia"),
            Candidate("torque_offset", joint, one[:, None]),
            Candidate("torque_constant", joint, at(j, model[:, j])[:, None]),
            Candidate("load_dependent_friction", joint, at(j, np.abs(model[:, j]) * sign[:, j])[:, None]),
            Candidate("stribeck_friction", joint, np.column_stack([level, fading])),
            Candidate("parasitic_spring", joint, np.column_stack([place, one])),
            Candidate("encoder_offset", joint, rows(change(rigid, windows.q + moved))[:, None]),
        ]
        if body in bodies:
            own = bodies.index(body)
            out.append(Candidate("inertial_parameters", joint, (masses[own] + inertias[own])[:, None]))
    sigma = {"inertia": 0.05, "friction": 0.05, "rotor_inertia": 0.1, **(config_of(robot_file).get("tolerance") or {})}
    kinds = {"armature": "rotor_inertia", "damping": "friction", "frictionloss": "friction"}
    beside = [sigma["inertia"] * column for column in (*masses, *inertias, *centres)]
    beside += [sigma[kinds[name]] * at(j, x[:, j]) for name, x in friction.items() for j in range(n) if np.any(x[:, j])]
    return Task(windows, rows(torque - model), tuple(out), np.column_stack(beside), torque, model, rows)


def solved(columns: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Sizes, their standard deviations and what is left, the mean square of each sample."""
    norm = np.linalg.norm(columns, axis=0)
    used = columns / np.where(norm > 0, norm, 1.0)
    sizes, _, rank, _ = np.linalg.lstsq(used, residual, rcond=1e-8)
    left = residual - used @ sizes
    square = float(left @ left) / max(len(residual) - int(rank), 1)
    spread_of = np.sqrt(square * np.clip(np.diag(np.linalg.pinv(used.T @ used, rcond=1e-12)), 0.0, None))
    return sizes / np.where(norm > 0, norm, np.inf), spread_of / np.where(norm > 0, norm, np.inf), square


def root_mean_square(x: np.ndarray) -> float:
    """Of all values."""
    return float(np.sqrt(np.mean(x**2)))


def finding(candidate: Candidate, sizes: np.ndarray, std: np.ndarray, **more: object) -> dict:
    """A finding as an answer holds it, with its size where an answer has one."""
    parameters = {candidate.size: {"value": float(sizes[0]), "std": float(std[0])}} if candidate.size else {}
    return {"effect": candidate.effect, "joint": candidate.joint, "parameters": parameters, **more}


def answer_of(findings: list[dict]) -> dict:
    """An answer with these findings; without any, that there is no gap."""
    return {"verdict": "explained" if findings else "no_gap", "findings": findings}
