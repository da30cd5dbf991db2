"""Measure how much better a controller with the corrected model tracks on the true robot.

Run ``python -m benchmarks.tracking_gain``. A planar arm of two joints gets one to three effects that its model lacks
(friction of two kinds, a load, a torque constant, a constant torque), moves for ten seconds under position control, and
is diagnosed. Then it follows a motion that no recording contains, with two controllers: feedforward from a model,
and gains for the same poles with that model's mass matrix. One uses the given and the other the corrected model. The
script prints the ratio of their errors for each case, and its geometric mean with a bootstrap interval.
Options: ``--cases``, ``--seed``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis
from identification.export.corrected.corrected_model import CorrectedModel, corrected_model
from identification.export.corrected.found_effects import effect_of, findings_in_all_recordings, robot_within_tolerances
from identification.pipeline import diagnose
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics, mass_matrix
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.control import Tracking, position_control
from phantom_dyn.simulation.simulate import Cause, simulate

Array = np.ndarray

ARM = Path(__file__).parents[1] / "tests" / "robots" / "planar2.urdf"
_RATE = 200.0
_POLE = 12.0
"""Poles of both controllers [rad/s]."""


def drawn_causes(rng: np.random.Generator) -> tuple[Cause, ...]:
    """One to three effects with sizes that are easy to find."""
    joint = str(rng.choice(["shoulder", "elbow"]))
    other = "elbow" if joint == "shoulder" else "shoulder"
    kinds = [
        Cause(effect_named("coulomb_friction"), joint, np.array([rng.uniform(0.5, 2.0)])),
        Cause(effect_named("viscous_friction"), other, np.array([rng.uniform(0.3, 1.5)])),
        Cause(effect_named("payload"), None, np.array([rng.uniform(0.3, 0.8), 0.0, 0.0, -rng.uniform(0.2, 0.4)])),
        Cause(effect_named("torque_constant"), other, np.array([rng.uniform(0.75, 0.9)])),
        Cause(effect_named("torque_offset"), joint, np.array([rng.uniform(0.5, 1.5)])),
    ]
    chosen = rng.choice(len(kinds), int(rng.integers(1, 4)), replace=False)
    return tuple(kinds[k] for k in sorted(chosen))


def sines(rng: np.random.Generator, seconds: float, nv: int) -> Motion:
    """A motion of three sines for each joint."""
    t = np.arange(seconds * _RATE) / _RATE
    q, v, a = (np.zeros((len(t), nv)) for _ in range(3))
    for j in range(nv):
        for w in 2 * np.pi * rng.uniform([0.15, 0.4, 0.8], [0.3, 0.7, 1.2]):
            size, phase = rng.uniform(0.15, 0.5) / (1 + w / 6), rng.uniform(0, 2 * np.pi)
            q[:, j] += size * np.sin(w * t + phase)
            v[:, j] += size * w * np.cos(w * t + phase)
            a[:, j] -= size * w**2 * np.sin(w * t + phase)
    return Motion(t, q, v, a)


def recorded(robot: Robot, causes: tuple[Cause, ...], rng: np.random.Generator) -> Recording:
    """Ten seconds of the true robot, with noise."""
    motion = sines(rng, 10.0, robot.nv)
    law = position_control(motion.t, motion.q, motion.v, kp=np.array([300.0, 150.0]), kd=np.array([30.0, 12.0]))
    moved = simulate(robot, causes, law, motion.t, motion.q[0], motion.v[0])
    q = moved.q + 1e-5 * rng.standard_normal(moved.q.shape)
    return Recording(
        "drawn.csv", robot.joint_names, moved.t, q, moved.tau + 0.02 * rng.standard_normal(moved.tau.shape)
    )


def corrected_by(robot: Robot, diagnosis: Diagnosis) -> CorrectedModel:
    """The given model with the findings."""
    found = tuple(effect_of(robot, finding) for finding in findings_in_all_recordings(diagnosis))
    try:
        return corrected_model(robot_within_tolerances(robot, diagnosis.adjusted), found)
    except PhantomDynError:
        return corrected_model(robot, found)


def controller(model: CorrectedModel, reference: Motion) -> Tracking:
    """Feedforward and gains of one model."""
    robot = model.robot
    gains = np.array([model.gains.get(name, 1.0) for name in robot.joint_names])
    offsets = np.array([model.offsets.get(name, 0.0) for name in robot.joint_names])
    ahead = (inverse_dynamics(robot, reference) - offsets) / gains
    inertia = np.diagonal(mass_matrix(robot, reference.q), axis1=1, axis2=2) / gains
    none = np.zeros_like(reference.q)
    limits = np.full(robot.nv, np.inf)
    kp, kd = _POLE**2 * inertia, 2 * _POLE * inertia
    return Tracking(reference.t, ahead, reference.q, reference.v, kp, kd, none, limits)


def tracking_error(robot: Robot, causes: tuple[Cause, ...], law: Tracking, reference: Motion) -> float:
    """Root mean square of the error on the true robot [rad], all joints together."""
    moved = simulate(robot, causes, law, reference.t, reference.q[0], reference.v[0])
    return float(np.sqrt(np.mean((moved.q - reference.q) ** 2)))


def error_ratio(robot: Robot, rng: np.random.Generator) -> tuple[str, float, float]:
    """The effects of the robot, and the errors of the controllers with the given and the corrected model."""
    causes = drawn_causes(rng)
    diagnosis = diagnose(robot, (recorded(robot, causes, rng),))
    reference = sines(rng, 6.0, robot.nv)
    given, corrected = corrected_model(robot, ()), corrected_by(robot, diagnosis)
    errors = [tracking_error(robot, causes, controller(model, reference), reference) for model in (given, corrected)]
    return ", ".join(cause.effect.name for cause in causes), errors[0], errors[1]


def mean_ratio(ratios: Array, rng: np.random.Generator) -> tuple[float, float, float]:
    """Geometric mean and its 95 % bootstrap interval over the cases."""
    logs = np.log(ratios)
    again = logs[rng.integers(0, len(logs), (4000, len(logs)))].mean(axis=1)
    low, high = np.exp(np.quantile(again, [0.025, 0.975]))
    return float(np.exp(logs.mean())), float(low), float(high)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    robot, ratios = load_robot(ARM), []
    for case in range(arguments.cases):
        words, before, after = error_ratio(robot, np.random.default_rng((arguments.seed, case)))
        ratios.append(after / before)
        print(f"{case:3d}  {1e3 * before:8.3f} mrad given  {1e3 * after:8.3f} mrad corrected  {words}", flush=True)
    mean, low, high = mean_ratio(np.array(ratios), np.random.default_rng(0))
    better = int(np.sum(np.array(ratios) < 1))
    print(f"Error ratio corrected / given: {mean:.3f} ({low:.3f} to {high:.3f}); better in {better} of {len(ratios)}.")


if __name__ == "__main__":
    main()
