"""Write cases of robots on moving bases in the form of `benchmarks.given_cases`.

    python -m benchmarks.legged.cases --out DIR --nulls 0:6 --singles 0:12 --outsides 0:4

The robots alternate between a quadruped, a biped and an arm. Masses, friction and rotors of every robot differ from its
model within the model's tolerances, and its inertial sensor has usual errors. A single has one cause on one joint,
which is drawn again if free swings hardly show it. Causes outside the catalogue are soft ground and a sensor on a loose
mount. The size of the gap is computed from the simulated truth, without any diagnosis.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.blind.generate import seed_range
from benchmarks.given_cases import LEAST_FLOORS
from benchmarks.legged.files import urdf
from benchmarks.legged.motions import Task
from benchmarks.legged.robots import Numbers, Robot, arm, biped, quadruped
from benchmarks.legged.simulate import Drive, Ground, Run, Sensor, simulate
from benchmarks.legged.visible import gap_over_floor

Array = np.ndarray
Rng = np.random.Generator
DRAWS = 3  # number of draws of joint and size while the swings show less than `LEAST_FLOORS` of a cause
TRUSTED = 0.5  # deviation of the robot from its model, in standard deviations of its tolerances


@dataclass(frozen=True)
class Plant:
    """A robot with its drives."""

    robot: Robot
    numbers: Numbers
    drive: Drive


Change = Callable[[Plant, int, float], Plant]


def _added(name: str, factor: float) -> Change:
    def changed(plant: Plant, j: int, size: float) -> Plant:
        values = getattr(plant.numbers, name).copy()
        values[j] += size * factor
        return replace(plant, numbers=replace(plant.numbers, **{name: values}))

    return changed


def _payload(plant: Plant, j: int, size: float) -> Plant:
    """A point mass near the end of a link."""
    numbers, mass, at = plant.numbers, 0.15 * size, 1.3 * plant.numbers.center[j]
    total = numbers.mass[j] + mass
    center = (numbers.mass[j] * numbers.center[j] + mass * at) / total

    def about(weight: float, arm: Array) -> Array:
        return weight * (arm @ arm - arm**2)

    moment = numbers.mass[j] * numbers.radius[j] ** 2 + about(numbers.mass[j], numbers.center[j] - center)
    moment = moment + about(mass, at - center)
    masses, centers, radii = numbers.mass.copy(), numbers.center.copy(), numbers.radius.copy()
    masses[j], centers[j], radii[j] = total, center, np.sqrt(moment / total)
    return replace(plant, numbers=replace(numbers, mass=masses, center=centers, radius=radii))


def _scaled(plant: Plant, j: int, size: float) -> Plant:
    scale = plant.drive.scale.copy()
    scale[j] = 1.0 - 0.2 * size
    return replace(plant, drive=replace(plant.drive, scale=scale))


def _late(plant: Plant, j: int, size: float) -> Plant:
    delay = plant.drive.delay.copy()
    delay[j] = 0.006 * size
    return replace(plant, drive=replace(plant.drive, delay=delay))


CAUSES: dict[str, Change] = {
    "coulomb_friction": _added("friction", 0.35),
    "viscous_friction": _added("damping", 0.12),
    "rotor_inertia": _added("armature", 0.012),
    "payload": _payload,
    "torque_constant": _scaled,
    "input_delay": _late,
}
ROBOTS = (quadruped, biped, arm)
KINDS = ("null", "single", "outside")


def _accepted(name: str, joint: str) -> list[list[list[str | None]]]:
    """Slow motions cannot distinguish a delay and a lag; without payload_frame, a mass is a change of its body."""
    if name == "input_delay":
        return [[[near, joint]] for near in ("input_delay", "actuator_lag")]
    if name == "payload":
        return [[["inertial_parameters", joint]], [["payload", None]]]
    return [[[name, joint]]]


def _near_model(given: Numbers, rng: Rng) -> Numbers:
    """A robot within the tolerances of its model."""

    def about(values: Array, tolerance: float) -> Array:
        return values * (1 + TRUSTED * tolerance * rng.normal(size=values.shape))

    return replace(
        given,
        mass=about(given.mass, 0.05),
        armature=about(given.armature, 0.1),
        damping=about(given.damping, 0.05),
        friction=about(given.friction, 0.05),
    )


def _sensor(rng: Rng) -> Sensor:
    """Errors of ordinary inertial sensors, half of their specified values."""
    offsets = np.array([[0.5 * np.pi / 180], [0.1]]) * rng.normal(size=(2, 3))
    scales = 1 + 0.005 * rng.normal(size=(2, 3))
    turn, shift = 0.5 * np.pi / 180 * rng.normal(size=3), 0.005 * rng.normal(size=3)
    return Sensor(offsets, scales, turn, shift, rng.uniform(0.0, 0.004))


def _task(robot: Robot, rng: Rng) -> Task:
    hangs = robot.name == "arm" or bool(rng.random() < 0.4)
    rate = float(rng.choice([500.0, 1000.0]))
    if hangs:
        return Task(True, 24.0, rate, rng.uniform(0.8, 1.2), 0.5, 0.16, 0.0, 1.0 if robot.name == "arm" else 0.4)
    if robot.name == "biped":
        return Task(False, 24.0, rate, rng.uniform(0.7, 1.0), rng.uniform(0.55, 0.6), 0.14, rng.uniform(0.06, 0.1), 1.0)
    duty = rng.uniform(0.45, 0.52)
    return Task(False, 24.0, rate, rng.uniform(1.4, 1.9), duty, rng.uniform(0.05, 0.08), rng.uniform(0.06, 0.09), 1.0)


def _single(
    seed: int, healthy: Plant, task: Task, sensor: Sensor, ground: Ground, rng: Rng
) -> tuple[list[dict], Run, float]:
    """One cause on one joint, its run, and its gap; drawn again while the swings hardly show it."""
    robot, name = healthy.robot, list(CAUSES)[seed // len(ROBOTS) % len(CAUSES)]
    joints = robot.carries if name == "payload" else range(len(robot.parts))
    drawn: tuple[list[dict], Run, float] | None = None
    draws = 0
    while drawn is None or (drawn[2] < LEAST_FLOORS and draws < DRAWS):
        draws += 1
        j = int(rng.choice([j for j in joints if task.hangs or j not in robot.slow]))
        changed = CAUSES[name](healthy, j, float(rng.uniform(1.0, 2.0)))
        run = simulate(robot, changed.numbers, changed.drive, sensor, ground, task, rng)
        gap = gap_over_floor(robot, healthy.numbers, changed.numbers, run, task.rate)
        joint = robot.joints[j]
        drawn = [{"effect": name, "joint": joint, "accept": _accepted(name, joint)}], run, gap
    return drawn


def write_case(folder: Path, kind: str, seed: int) -> None:
    """Write the case of a kind and a seed into a folder of its own, unless it exists.

    Args:
        folder: Folder of all cases.
        kind: One of ``KINDS``.
        seed: Seed of the draw; the robots alternate.
    """
    case = folder / f"{kind}{seed:03d}"
    if (case / "answer.json").is_file():
        return
    rng = np.random.default_rng([1 + KINDS.index(kind), seed])
    # Nothing that the arm does touches the ground.
    robots = ROBOTS[:2] if kind == "outside" else ROBOTS
    robot = robots[seed % len(robots)]()
    task, sensor = _task(robot, rng), _sensor(rng)
    count, ground = len(robot.parts), Ground(rubs=float(rng.uniform(0.4, 0.9)))
    healthy = Plant(robot, _near_model(robot.numbers, rng), Drive(np.ones(count), np.zeros(count)))
    effects, gap = [], 0.0
    if kind == "single":
        effects, run, gap = _single(seed, healthy, task, sensor, ground, rng)
    else:
        if kind == "outside":
            soft = seed // len(robots) % 2 == 0
            effects = [{"effect": "soft_ground" if soft else "loose_mount", "joint": None}]
            if soft:
                task, ground = replace(task, hangs=False), replace(ground, softness=0.08)
            else:
                sensor = replace(sensor, mount=float(rng.uniform(6.0, 15.0)))
        run = simulate(robot, healthy.numbers, healthy.drive, sensor, ground, task, rng)
        gap = gap_over_floor(robot, healthy.numbers, healthy.numbers, run, task.rate)
    _write_run(case, robot, run)
    answer = {
        "effects": effects,
        "gap_over_floor": gap,
        "robot": robot.name,
        "hangs": task.hangs,
        "rate": task.rate,
    }
    (case / "answer.json").write_text(json.dumps(answer, indent=1) + "\n")


def _write_run(folder: Path, robot: Robot, run: Run) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(urdf(robot))
    rotors = "\n".join(
        f"  {joint}: {{rotor_inertia: {value:.6g}}}"
        for joint, value in zip(robot.joints, robot.numbers.armature, strict=True)
    )
    (folder / "robot.yaml").write_text(f"base: floating\ntorque_hold: zoh\njoints:\n{rotors}\n")
    np.savez(folder / "log.npz", **run.log)  # pyright: ignore[reportArgumentType]


def write_trot(folder: Path, seconds: float, rate: float) -> None:
    """Write a trotting quadruped with friction that its model lacks, to measure the cost of a diagnosis."""
    rng, robot = np.random.default_rng(7), quadruped()
    count = len(robot.parts)
    near = Plant(robot, _near_model(robot.numbers, rng), Drive(np.ones(count), np.zeros(count)))
    dry = CAUSES["coulomb_friction"](near, robot.joints.index("FR_thigh_joint"), 1.5)
    task = Task(False, seconds, rate, 1.6, 0.5, 0.06, 0.08, 1.0)
    _write_run(folder, robot, simulate(robot, dry.numbers, dry.drive, _sensor(rng), Ground(rubs=0.7), task, rng))


def main(arguments: list[str] | None = None) -> int:
    """Write the cases that do not exist yet."""
    parser = argparse.ArgumentParser(description="Write cases of robots on bases that move.")
    parser.add_argument("--out", type=Path, required=True)
    for kind in KINDS:
        parser.add_argument(f"--{kind}s", dest=kind, type=seed_range, default=range(0), metavar="FIRST:END")
    given = parser.parse_args(arguments)
    for kind in KINDS:
        for seed in getattr(given, kind):
            try:
                write_case(given.out, kind, seed)
            except FloatingPointError as reason:
                print(f"{kind} {seed}: {reason}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
