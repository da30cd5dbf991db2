"""Measure how often positions and references alone show which effect a servo's model lacks.

Run ``python -m benchmarks.motion_only``. Cases are simulated on a hanging rod with a proportional position servo, like
hobby servos; only readings and references are recorded. The cause is drawn: a delayed drive, Coulomb friction that
makes it stick, a load, backlash, less viscous friction than modelled, or nothing. Inertias and modelled friction are
wrong within their tolerance in every case.
Options: ``--cases`` of each kind, ``--seed`` (below 1000), ``--gains`` known, identified or wrong by one tenth.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose
from identification.scenarios.motion_only import commanded_robot, with_commanded_torque
from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Actuator, Controller, Robot
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate

Array = np.ndarray

_ROD = """<robot name="rod"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="{mass}"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="0.01"/></inertial></link>
<joint name="pin" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="80" velocity="50"/>
<dynamics damping="{damping}" friction="{friction}"/></joint></robot>
"""
_RATE, _SECONDS, _GAIN, _ROTOR, _NOISE = 200.0, 30.0, 60.0, 0.08, 1e-4
# Effects with the same cause: a lag is a delay to first order, a payload changes inertial parameters, and dry friction
# may be found as presliding or Stribeck friction.
SAME = {
    "input_delay": {"input_delay", "actuator_lag"},
    "coulomb_friction": {"coulomb_friction", "stribeck_friction", "presliding_friction"},
    "payload": {"payload", "inertial_parameters"},
    "backlash": {"backlash"},
    "nothing": set(),
    "less_friction": {"viscous_friction", "direction_dependent_friction"},
}
SIZES: dict[str, Callable[[np.random.Generator], list[float]]] = {
    "input_delay": lambda rng: [rng.uniform(0.01, 0.03)],
    "coulomb_friction": lambda rng: [rng.uniform(0.4, 1.5)],
    "payload": lambda rng: [rng.uniform(0.6, 1.5), 0.0, 0.0, -rng.uniform(0.6, 1.0)],
    "backlash": lambda rng: [rng.uniform(0.015, 0.05)],
    "nothing": lambda rng: [],
    "less_friction": lambda rng: [-rng.uniform(0.8, 1.8)],
}


@dataclass(frozen=True)
class Case:
    """One true cause and its recording.

    Attributes:
        robot: The model, with its controller.
        truth: Effect that the model lacks, or ``nothing``.
        recording: Readings and references.
    """

    robot: Robot
    truth: str
    recording: Recording


def rod(rng: np.random.Generator | None = None) -> Robot:
    """The rod with its servo; with a generator, its numbers are wrong within their tolerance."""
    off = np.ones(4) if rng is None else 1.0 + np.array([0.03, 0.03, 0.03, 0.03]) * rng.standard_normal(4).clip(-2, 2)
    numbers = dict(zip(("mass", "inertia", "damping", "friction"), off * [2.0, 0.1, 3.0, 0.3], strict=True))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rod.urdf"
        path.write_text(_ROD.format(**numbers), encoding="utf-8")
        robot = load_robot(path)
    model = robot.model.copy()
    model.armature = np.array([_ROTOR])
    return replace(robot, model=model, actuators=(Actuator(controller=Controller(kp=_GAIN)),))


def case(truth: str, rng: np.random.Generator) -> Case:
    """Slow and fast sines, and a triangle, with the cause ``truth``."""
    real, size = rod(rng), SIZES[truth](rng)
    t = np.arange(_SECONDS * _RATE) / _RATE
    w = 2 * np.pi * rng.uniform([0.1, 0.4, 0.9], [0.2, 0.7, 1.6])
    share, phase = np.array([0.6, 0.4, 0.2]), rng.uniform(0, 2 * np.pi, 3)
    q_ref = (share * np.sin(t[:, None] * w + phase)).sum(axis=1) + 0.3 * (2 * np.abs((t * 0.15) % 1.0 - 0.5) - 0.5)
    law = position_control(t, q_ref[:, None], np.zeros((len(t), 1)), kp=np.array([_GAIN]), kd=np.zeros(1))
    joint = None if truth == "payload" else "pin"
    effect = "viscous_friction" if truth == "less_friction" else truth
    causes = () if truth == "nothing" else (Cause(effect_named(effect), joint, np.array(size)),)
    q = simulate(real, causes, law, t, q_ref[:1]).q + _NOISE * rng.standard_normal((len(t), 1))
    return Case(rod(), truth, Recording("rod.csv", real.joint_names, t, q, None, q_ref=q_ref[:, None]))


def diagnosed(one: Case, gains: str) -> Diagnosis:
    """Diagnose positions and references alone, with the true gains, gains a tenth too high, or identified gains."""
    controller = Controller(kp=1.1 * _GAIN if gains == "off" else _GAIN)
    if gains == "identified":
        silent = replace(one.robot, actuators=(Actuator(),))
        return diagnose(silent, (one.recording,), motion_only=True)
    robot = commanded_robot(replace(one.robot, actuators=(Actuator(controller=controller),)))
    return diagnose(robot, (with_commanded_torque(one.recording, robot),))


def in_set(found: Diagnosis, truth: str) -> bool:
    """True if the truth is a finding or a rival of a finding; for no cause, if no gap is found."""
    if truth == "nothing":
        return found.verdict == "no_gap"
    named = {finding.effect for finding in found.findings}
    rivals = {at.effect for finding in found.findings for rival in finding.rivals for at in rival.effects}
    return bool((named | rivals) & SAME[truth])


def clean(found: Diagnosis, truth: str) -> bool:
    """True if every finding is the truth or has the truth as a rival."""
    return all(
        finding.effect in SAME[truth]
        or any(at.effect in SAME[truth] for rival in finding.rivals for at in rival.effects)
        for finding in found.findings
    )


def main() -> None:
    """Draw cases, diagnose them and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--gains", choices=("known", "identified", "off"), default="known")
    parser.add_argument("--only", choices=tuple(SAME))
    parser.add_argument("--say", action="store_true", help="print every case")
    arguments = parser.parse_args()
    if not 0 <= arguments.seed < 1000 - arguments.cases:
        parser.error(f"--seed {arguments.seed} was given: seeds from 1000 on are sealed")
    print(f"Gains {arguments.gains}. Truth in the set, and nothing else found, of {arguments.cases} cases each:")
    for truth in SAME if arguments.only is None else (arguments.only,):
        included, alone = 0, 0
        for k in range(arguments.cases):
            found = diagnosed(
                case(truth, np.random.default_rng([arguments.seed + k, list(SAME).index(truth)])), arguments.gains
            )
            included, alone = included + in_set(found, truth), alone + clean(found, truth)
            if arguments.say:
                print(
                    k,
                    truth,
                    found.verdict,
                    [
                        (
                            f.effect,
                            f.joint,
                            {n: v.value for n, v in f.parameters.items()},
                            [[a.effect for a in r.effects] for r in f.rivals],
                        )
                        for f in found.findings
                    ],
                    found.rollout,
                )
        print(f"  {truth:20s} {included:3d} {alone:3d}")


if __name__ == "__main__":
    main()
