# pyright: reportAttributeAccessIssue=false
"""Measure how often causes that several joints share, motions with little information and loads are identified right.

    python -m benchmarks.common_causes scale --seeds 0:20     # one torque scale on some joints
    python -m benchmarks.common_causes line --seeds 0:20      # all joints follow one profile; load, friction under load
    python -m benchmarks.common_causes load --seeds 0:20      # bare and loaded, links wrong by up to a half
    python -m benchmarks.common_causes load --seeds 0:20 --null

The arms are the UR5, the UR10 and the Panda with random motions, friction, rates and sizes. Pinocchio's own algorithm
computes the torques, without any code of the diagnosis. The script prints for each case the wrong causes that are
stated with more than 90 %, and the 95 % intervals that miss the truth; the last lines are the counts of `Score`.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from identification.data.changes import Change
from identification.data.recording import Recording
from identification.diagnosis.result import Finding
from identification.pipeline import diagnose
from phantom_dyn import load_robot
from phantom_dyn.model.robot import Robot

Array = np.ndarray

# Arms, and the joints of their hands that are held fixed.
ARMS = {"example:ur5": "", "example:ur10": "", "example:panda": "panda_finger_joint1, panda_finger_joint2"}
SECONDS = 30.0
CERTAIN, LEADING, SIDES = 0.9, 0.5, 1.96
FRICTION = ("coulomb_friction", "viscous_friction", "load_dependent_friction", "direction_dependent_friction")


@dataclass
class Truth:
    """What was added to the robot.

    Attributes:
        sizes: True sizes by effect, joints and parameter.
        names: Effects that are right answers.
        gain: Recorded torque divided by true torque, of all drives. Along one line it is a twin of all inertias and
            frictions together; if no torque constant is found, sizes refer to the recorded torque.
        under_load: Mean load-dependent friction of each joint [N m]; a constant contains it if no law of it is found.
    """

    sizes: dict[tuple[str, str | None, str], float] = field(default_factory=dict)
    names: set[tuple[str, str | None]] = field(default_factory=set)
    gain: float = 1.0
    under_load: dict[str, float] = field(default_factory=dict)

    def size(self, effect: str, joint: str | None, parameter: str, named: set[tuple[str, str | None]]) -> float | None:
        """True value of a finding's number that is not among its sizes, or None."""
        size = self.sizes.get((effect, joint, parameter))
        if size is None or parameter in ("ratio", "center_x", "center_y", "center_z"):
            return size
        if effect == "coulomb_friction" and ("load_dependent_friction", joint) not in named:
            size += self.under_load.get(joint or "", 0.0)
        scaled = any(name == "torque_constant" and joint in (where or "").split("+") for name, where in named)
        return size if scaled else self.gain * size


def _arm(name: str) -> Robot:
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "robot.yaml")
        config.write_text(f"lock: [{ARMS[name]}]\n")
        return load_robot(name, config=config)


class Case:
    """One arm with friction, and its recordings."""

    def __init__(self, kind: str, seed: int, *, null: bool):
        self.rng = np.random.default_rng([seed, sum(kind.encode())])
        self.robot = _arm(str(self.rng.choice(list(ARMS))))
        self.true = self.robot.model.copy()
        self.rate = float(self.rng.choice([100.0, 200.0, 250.0]))
        self.truth, self.null = Truth(), null
        usual = np.sqrt(np.mean(self.torque(self.true, *self.motion(line=False)) ** 2, axis=0))
        self.coulomb = self.rng.uniform(0.05, 0.25, self.robot.nv) * usual + 0.05
        self.viscous = self.rng.uniform(0.05, 0.25, self.robot.nv) * usual + 0.02
        if kind != "load":
            for row, joint in enumerate(self.robot.joint_names):
                self.truth.sizes["coulomb_friction", joint, "torque"] = float(self.coulomb[row])
                modelled = float(self.robot.viscous_friction[row])
                self.truth.sizes["viscous_friction", joint, "coefficient"] = float(self.viscous[row]) - modelled
        self.truth.names |= {(name, joint) for joint in self.robot.joint_names for name in FRICTION}
        self.recordings, self.changes = getattr(self, f"_{kind}")()

    def motion(self, *, line: bool) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations as sums of sines, different for each joint or the same for all."""
        model, rng, nv = self.robot.model, self.rng, self.robot.nv
        t = np.arange(0.0, SECONDS, 1.0 / self.rate)
        low, high = np.maximum(model.lowerPositionLimit, -2.5), np.minimum(model.upperPositionLimit, 2.5)
        middle, swing = 0.5 * (low + high), 0.5 * (high - low) * rng.uniform(0.3, 0.6, nv) * rng.choice([-1, 1], nv)
        late = rng.uniform(0.0, 0.006, nv) if line else np.zeros(nv)
        waves = [self._wave() for _ in range(1 if line else nv)]
        columns = [_values(waves[0 if line else j], t - late[j]) for j in range(nv)]
        q, v, a = (np.column_stack([column[k] for column in columns]) * swing for k in range(3))
        return q + middle, v, a

    def _wave(self) -> tuple[Array, Array, Array]:
        size = self.rng.uniform(0.3, 1.0, 4)
        return 2 * np.pi * self.rng.uniform(0.1, 0.6, 4), self.rng.uniform(0.0, 2 * np.pi, 4), size / size.sum()

    def torque(self, model: pin.Model, q: Array, v: Array, a: Array) -> Array:
        """Torque of the rigid bodies."""
        data = model.createData()
        return np.array([pin.rnea(model, data, *sample) for sample in zip(q, v, a, strict=True)])

    def with_friction(self, tau: Array, v: Array, ratio: float) -> Array:
        """The torque plus Coulomb, viscous and load-dependent friction."""
        return tau + self.viscous * v + (self.coulomb + ratio * np.abs(tau)) * np.tanh(v / 1e-3)

    def recorded(self, file: str, q: Array, tau: Array) -> Recording:
        """A recording with 20 urad of position noise and 0.4 % of torque noise."""
        noise = np.maximum(0.004 * np.sqrt(np.mean(tau**2, axis=0)), 1e-3)
        t = np.arange(len(q)) / self.rate
        read = q + 2e-5 * self.rng.standard_normal(q.shape)
        return Recording(file, self.robot.joint_names, t, read, tau + noise * self.rng.standard_normal(tau.shape))

    def _scale(self) -> tuple[tuple[Recording, ...], tuple[Change, ...]]:
        nv, rng = self.robot.nv, self.rng
        count = int(rng.integers(2, nv + 1))
        first = int(rng.integers(0, nv - count + 1))
        rows = sorted(rng.choice(nv, count, replace=False)) if rng.random() < 0.4 else range(first, first + count)
        ratio = float(rng.choice([0.6, 0.7, 0.8, 1.25, 1.4, 1.6]))
        q, v, a = self.motion(line=False)
        tau = self.with_friction(self.torque(self.true, q, v, a), v, 0.0)
        if not self.null:
            tau[:, list(rows)] /= ratio
            joints = "+".join(self.robot.joint_names[row] for row in rows)
            self.truth.sizes["torque_constant", joints, "ratio"] = ratio
            self.truth.names.add(("torque_constant", joints))
        return (self.recorded("log.csv", q, tau),), ()

    def _line(self) -> tuple[tuple[Recording, ...], tuple[Change, ...]]:
        q, v, a = self.motion(line=True)
        model = self.true if self.null else self._loaded(self.true)
        gain = 1.0 if self.null else float(self.rng.choice([0.85, 1.0, 1.15]))
        ratio, rigid = 0.0 if self.null else 0.1, self.torque(model, q, v, a)
        tau = gain * self.with_friction(rigid, v, ratio)
        self.truth.gain = gain
        self.truth.under_load = dict(zip(self.robot.joint_names, ratio * np.abs(rigid).mean(axis=0), strict=True))
        if gain != 1.0:
            joints = "+".join(self.robot.joint_names)
            self.truth.names |= {("torque_constant", joint) for joint in (joints, *self.robot.joint_names)}
        return (self.recorded("log.csv", q, tau),), ()

    def _load(self) -> tuple[tuple[Recording, ...], tuple[Change, ...]]:
        rng = self.rng
        for body in range(1, self.true.njoints):
            own = self.true.inertias[body]
            lever = own.lever + rng.uniform(-0.02, 0.02, 3)
            inertia = own.inertia * rng.uniform(0.7, 1.4)
            self.true.inertias[body] = pin.Inertia(own.mass * rng.uniform(0.6, 1.5), lever, inertia)
        ratio = float(rng.choice([0.0, 0.08]))
        models = {"bare.csv": self.true, "loaded.csv": self.true if self.null else self._loaded(self.true)}
        made = []
        for file, model in models.items():
            q, v, a = self.motion(line=False)
            made.append(self.recorded(file, q, self.with_friction(self.torque(model, q, v, a), v, ratio)))
        return tuple(made), (Change("bare.csv"), Change("loaded.csv", changed=("payload",)))

    def _loaded(self, model: pin.Model) -> pin.Model:
        """The model with a ball of 4 cm on its last link."""
        mass, center = float(self.rng.uniform(0.3, 3.0)), self.rng.uniform(-0.12, 0.12, 3)
        out, last = model.copy(), model.njoints - 1
        out.inertias[last] = out.inertias[last] + pin.Inertia(mass, center, 0.4 * mass * 0.04**2 * np.eye(3))
        self.truth.names.add(("payload", None))
        self.truth.sizes["payload", None, "mass"] = mass
        for axis, value in zip("xyz", center, strict=True):
            self.truth.sizes["payload", None, f"center_{axis}"] = float(value)
        return out


def _values(wave: tuple[Array, Array, Array], t: Array) -> tuple[Array, Array, Array]:
    w, phase, size = wave
    angle = t[:, None] * w + phase
    return np.sin(angle) @ size, np.cos(angle) @ (size * w), -np.sin(angle) @ (size * w**2)


@dataclass
class Score:
    """Counts over the cases.

    Attributes:
        found: Cases whose first finding is the cause.
        wrong: Findings stated with certainty that are not the cause.
        certain: Findings stated with certainty.
        inside, stated: Intervals of 95 % that contain the truth, and all intervals, of findings that are likelier than
            their rivals and whose true values are known.
    """

    cases: int = 0
    found: int = 0
    wrong: int = 0
    certain: int = 0
    inside: int = 0
    stated: int = 0

    def add(self, case: Case, cause: str, findings: tuple[Finding, ...]) -> list[str]:
        """Count one case; return what is wrong in its answer."""
        truth, said = case.truth, list[str]()
        self.cases += 1
        named = {(one.effect, one.joint) for one in findings}
        known = {name for name in truth.names if name[0] == cause}
        self.found += bool(named & known) if known else not any(one.effect == cause for one in findings)
        for one in findings:
            certain = one.probability > CERTAIN
            self.certain += certain
            if certain and (one.effect, one.joint) not in truth.names:
                self.wrong += 1
                said.append(f"wrong: {one.effect} {one.joint} {one.probability:.2f}")
            for name, value in one.parameters.items():
                size = truth.size(one.effect, one.joint, name, named)
                if one.probability < LEADING or size is None or not value.shown:
                    continue
                if isinstance(value.value, list) or isinstance(value.std, list):
                    continue
                holds = abs(value.value - size) <= SIDES * value.std
                self.stated += 1
                self.inside += int(holds)
                if not holds:
                    said.append(f"{one.effect} {one.joint} {name} {value.value:.4g} +- {value.std:.2g} for {size:.4g}")
        return said


def main() -> None:
    """Print each case and the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=("scale", "line", "load"))
    parser.add_argument("--seeds", default="0:10", help="FIRST:STOP, below 1000")
    parser.add_argument("--null", action="store_true", help="without the cause")
    arguments = parser.parse_args()
    first, stop = (int(text) for text in arguments.seeds.split(":"))
    cause = {"scale": "torque_constant", "line": "payload", "load": "payload"}[arguments.kind]
    score = Score()
    for seed in range(first, stop):
        case = Case(arguments.kind, seed, null=arguments.null)
        found = diagnose(case.robot, case.recordings, changes=case.changes)
        said = score.add(case, cause, found.findings)
        print(f"{seed}: {found.verdict}, {found.seconds:.0f} s; {'; '.join(said)}", flush=True)
    print(score)


if __name__ == "__main__":
    main()
