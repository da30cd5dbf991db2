"""Writes cases of a quadruped in the form of `benchmarks.given_cases`: nulls, and one cause on one joint.

    python -m benchmarks.legged.cases --out DIR --nulls 0:6 --singles 0:12

Masses, friction and rotors of every robot differ from its model by what the model's tolerances allow.
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
from benchmarks.legged.quadruped import CALF, JOINTS, Numbers, stated, urdf
from benchmarks.legged.simulate import Drive, Task, simulate

Array = np.ndarray
Rng = np.random.Generator
TRUSTED = 0.5  # of a tolerance of one sigma: how far the robot is from its model


@dataclass(frozen=True)
class Plant:
    """A robot with its drives."""

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
    """A point mass near the foot of the shank."""
    numbers, mass, at = plant.numbers, 0.15 * size, np.array([0.0, 0.0, -0.8 * CALF])
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
# Of a delay and a lag no slow motion tells which; a mass is that of a body where nobody states payload_frame.
NEAR = {"input_delay": ("input_delay", "actuator_lag"), "payload": ("inertial_parameters",)}


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


def _task(rng: Rng) -> Task:
    hangs = bool(rng.random() < 0.4)
    rate = float(rng.choice([500.0, 1000.0]))
    if hangs:
        return Task(True, 24.0, rate, rng.uniform(0.8, 1.2), 0.5, 0.16, 0.0, 60.0, 2.0)
    gait, duty = rng.uniform(1.4, 1.9), rng.uniform(0.45, 0.52)
    return Task(False, 24.0, rate, gait, duty, rng.uniform(0.05, 0.08), rng.uniform(0.06, 0.09), 150.0, 5.0)


def write_case(folder: Path, kind: str, seed: int) -> None:
    """Writes the case of a kind (``null`` or ``single``) and a seed into a folder of its own; it is kept if there."""
    case = folder / f"{kind}{seed:03d}"
    if (case / "answer.json").is_file():
        return
    rng = np.random.default_rng([{"null": 1, "single": 2}[kind], seed])
    given, task = stated(), _task(rng)
    plant = Plant(_near_model(given, rng), Drive(np.ones(12), np.zeros(12), np.full(12, 1e9)))
    effects = []
    if kind == "single":
        name = list(CAUSES)[seed % len(CAUSES)]
        joints = [j for j, joint in enumerate(JOINTS) if "calf" in joint or name != "payload"]
        # A hip hardly turns in a trot.
        joints = [j for j in joints if task.hangs or "hip" not in JOINTS[j]]
        j = int(rng.choice(joints))
        plant = CAUSES[name](plant, j, float(rng.uniform(1.0, 2.0)))
        accept = [[[near, JOINTS[j]]] for near in NEAR.get(name, (name,))]
        effects = [{"effect": name, "joint": JOINTS[j], "accept": accept}]
    log = simulate(plant.numbers, plant.drive, task, rng)
    case.mkdir(parents=True, exist_ok=True)
    (case / "robot.urdf").write_text(urdf(given))
    rotors = "\n".join(f"  {joint}: {{rotor_inertia: {given.armature[j]:.6g}}}" for j, joint in enumerate(JOINTS))
    (case / "robot.yaml").write_text(f"base: floating\ntorque_hold: zoh\njoints:\n{rotors}\n")
    np.savez(case / "log.npz", **log)  # pyright: ignore[reportArgumentType]
    gap = 10.0 if effects else 0.0
    answer = {"effects": effects, "gap_over_floor": gap, "hangs": task.hangs, "rate": task.rate}
    (case / "answer.json").write_text(json.dumps(answer, indent=1) + "\n")


def main(arguments: list[str] | None = None) -> int:
    """Writes the cases that are not there yet."""
    parser = argparse.ArgumentParser(description="Write cases of a quadruped.")
    parser.add_argument("--out", type=Path, required=True)
    for kind in ("null", "single"):
        parser.add_argument(f"--{kind}s", dest=kind, type=seed_range, default=range(0), metavar="FIRST:END")
    given = parser.parse_args(arguments)
    for kind in ("null", "single"):
        for seed in getattr(given, kind):
            try:
                write_case(given.out, kind, seed)
            except FloatingPointError as reason:
                print(f"{kind} {seed}: {reason}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
