"""Measure how often two recordings with a known change between them distinguish causes that one recording cannot.

Run ``python -m benchmarks.known_changes``; cases are simulated on a hanging rod. A known mass distinguishes a load and
a torque constant; two controller gains distinguish a delayed drive and viscous friction; friction that grew between two
recordings is found with its ratio if the second recording is declared to have changed friction. The truth and the
noise of every case are random. Options: ``--cases`` of each kind, ``--seed``.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identification.data.changes import Change, KnownPayload, robot_in
from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose
from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation.simulate import Cause, simulate

Array = np.ndarray

_ROD = """<robot name="rod"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/></inertial></link>
<joint name="pin" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="40" velocity="50"/>
<dynamics damping="{damping}" friction="{friction}"/></joint></robot>
"""
_RATE = 100.0
# Effects with the same cause: a payload changes inertial parameters, and a lag is a delay to first order.
_SAME = {
    "payload": {"payload", "inertial_parameters"},
    "torque_constant": {"torque_constant"},
    "input_delay": {"input_delay", "actuator_lag"},
    "viscous_friction": {"viscous_friction"},
}


@dataclass(frozen=True)
class Case:
    """One true cause and its recordings.

    Attributes:
        robot: The model.
        truth: Effect that the model lacks.
        other: Effect with which it may be confused.
        recordings: Two recordings; the first is also diagnosed alone.
        changes: Known changes between them.
    """

    robot: Robot
    truth: str
    other: str
    recordings: tuple[Recording, Recording]
    changes: tuple[Change, Change]


def rod(damping: float, friction: float) -> Robot:
    """A rod of 2 kg and 1 m on joint pin, with modelled friction."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rod.urdf"
        path.write_text(_ROD.format(damping=damping, friction=friction), encoding="utf-8")
        return load_robot(path)


def simulated(
    robot: Robot, cause: tuple[str, Array], file: str, rng: np.random.Generator, *, kp: float, kd: float, noise: float
) -> Recording:
    """Some seconds of the robot under a position controller; without damping it oscillates from its start."""
    name, theta = cause
    t = np.arange(10 * _RATE) / _RATE
    w, phase, size = 2 * np.pi * np.array([0.23, 0.61, 1.13]), rng.uniform(0, 2 * np.pi, 3), rng.uniform(0.25, 0.5, 3)
    size = 1.5 * size / (1 + w / (2 * np.pi)) if kd else np.zeros(3)
    dither = 0.0 if kd else 0.1

    def controller(t: float, q: Array, v: Array) -> Array:
        angle = w * t + phase
        return kp * (size @ np.sin(angle) - q) + kd * (size * w @ np.cos(angle) - v) + dither * np.sin(10 * np.pi * t)

    joint = None if name == "payload" else "pin"
    start = np.array([size @ np.sin(phase) if kd else rng.uniform(0.4, 0.7)])
    causes = (Cause(effect_named(name), joint, theta),)
    moved = simulate(robot, causes, controller, t, start, np.array([size * w @ np.cos(phase)]), max_step=2e-3)
    return Recording(
        file,
        robot.joint_names,
        moved.t,
        moved.q + 1e-5 * rng.standard_normal(moved.q.shape),
        moved.tau + noise * rng.standard_normal(moved.tau.shape),
    )


def load_case(rng: np.random.Generator) -> Case:
    """A wrong torque constant or a load; the second recording has an additional known mass."""
    model = rod(0.0, 0.0)
    truth, other = rng.permutation(["torque_constant", "payload"])
    load = np.array([rng.uniform(0.4, 0.8), 0.0, 0.0, -rng.uniform(0.55, 0.75)])
    theta = np.array([rng.uniform(0.7, 0.85)]) if truth == "torque_constant" else load
    change = Change("b.csv", KnownPayload(1.5, (0.0, 0.0, -0.9)))
    drive = {"kp": 60.0, "kd": 8.0, "noise": 0.05}
    first = simulated(model, (truth, theta), "a.csv", rng, **drive)
    second = simulated(robot_in(model, change), (truth, theta), "b.csv", rng, **drive)
    return Case(model, truth, other, (first, second), (Change("a.csv"), change))


def gain_case(rng: np.random.Generator) -> Case:
    """A delayed drive, or less viscous friction than modelled; the controller of the second recording is softer."""
    model = rod(0.3, 0.0)
    truth, other = rng.permutation(["input_delay", "viscous_friction"])
    theta = np.array([rng.uniform(0.006, 0.009) if truth == "input_delay" else -rng.uniform(0.15, 0.25)])
    first, second = (
        simulated(model, (truth, theta), file, rng, kp=kp, kd=0.0, noise=0.2)
        for file, kp in (("a.csv", 30.0), ("b.csv", 12.0))
    )
    return Case(model, truth, other, (first, second), (Change("a.csv"), Change("b.csv")))


def separated(found: Diagnosis, truth: str, other: str) -> bool:
    """True if the true effect is found, and the other effect is neither found nor a rival."""
    named = {finding.effect for finding in found.findings}
    rivals = {at.effect for finding in found.findings for rival in finding.rivals for at in rival.effects}
    return bool(named & _SAME[truth]) and not (named | rivals) & _SAME[other]


def stated_growth(rng: np.random.Generator) -> tuple[bool, bool]:
    """Whether friction that grew is found with its ratio, to 10 %, without and with the declared change."""
    model = rod(0.3, 0.7)
    before, after = 0.3, rng.uniform(0.7, 1.5)
    drive = {"kp": 60.0, "kd": 8.0, "noise": 0.05}
    recordings = tuple(
        simulated(model, ("coulomb_friction", np.array([torque])), file, rng, **drive)
        for torque, file in ((before, "a.csv"), (after, "b.csv"))
    )
    truth = (0.7 + after) / (0.7 + before)
    out = []
    for changes in ((), (Change("a.csv"), Change("b.csv", changed=("friction",)))):
        found = diagnose(model, recordings, changes=changes)
        ratios = [f.parameters["ratio"].value for f in found.findings if f.recording and "ratio" in f.parameters]
        out.append(len(ratios) == 1 and not isinstance(ratios[0], list) and abs(ratios[0] / truth - 1) < 0.1)
    return out[0], out[1]


def both(case: Case) -> tuple[bool, bool]:
    """Whether the first recording alone distinguishes the causes, and whether both recordings do."""
    alone = diagnose(case.robot, case.recordings[:1])
    together = diagnose(case.robot, case.recordings, changes=case.changes)
    return separated(alone, case.truth, case.other), separated(together, case.truth, case.other)


def main() -> None:
    """Print how often causes are distinguished."""
    parser = argparse.ArgumentParser(description="How often a known change separates causes.")
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    kinds = {
        "payload | torque constant, a known mass more": lambda rng: both(load_case(rng)),
        "delay | viscous friction, a second gain": lambda rng: both(gain_case(rng)),
        "growth of friction, said to have changed": stated_growth,
    }
    print(f"{'':<46}{'one / unsaid':>14}{'two / said':>14}")
    for k, (words, measure) in enumerate(kinds.items()):
        outcomes = [measure(np.random.default_rng([arguments.seed, k, case])) for case in range(arguments.cases)]
        counts = np.sum(outcomes, axis=0)
        print(f"{words:<46}{counts[0]:>8} of {len(outcomes):<3}{counts[1]:>8} of {len(outcomes):<3}", flush=True)


if __name__ == "__main__":
    main()
