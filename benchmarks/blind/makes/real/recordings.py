"""Reads real recordings as arrays with the model of their robot, and cuts them into two parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from identification.data import datasets
from identification.data.reading import read_recording
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot_files import examples_folder, find_example

Array = np.ndarray
CHECKOUT = Path(__file__).resolve().parents[4]
EXAMPLES = CHECKOUT / "examples" / "data"
SHORTEST = 3.0  # shortest piece [s]: a shorter one has hardly any motion
PIECES = (2, 4, 6)  # numbers of pieces into which a long recording may be cut


@dataclass(frozen=True)
class Run:
    """One log: times [s], shape ``(N,)``, positions and torques as recorded, shape ``(N, n)``."""

    t: Array
    q: Array
    tau: Array

    def between(self, first: int, end: int) -> Run:
        """Its samples from ``first`` to before ``end``, with times from zero."""
        return Run(self.t[first:end] - self.t[first], self.q[first:end], self.tau[first:end])


@dataclass(frozen=True)
class Source:
    """A recorded robot.

    Attributes:
        name: Name of the robot in answers.
        joints: Names of the joints from the base outwards.
        urdf: Text of the given URDF.
        yaml: Text of the given ``robot.yaml``; may be empty.
        runs: The recorded logs.
    """

    name: str
    joints: tuple[str, ...]
    urdf: str
    yaml: str
    runs: tuple[Run, ...]


def _folder(name: str) -> Path:
    found = datasets.local(name)
    if found is None:
        raise FileNotFoundError(
            f"The recording {name} is not here: set PHANTOM_DYN_DATA to the folder that holds it, or take it with "
            f"'phantom-dyn datasets fetch {name}'."
        )
    return found


def emps() -> Source:
    """A ball-screw axis; its model has no friction."""
    public = loadmat(_folder("emps") / "DATA_EMPS.mat", squeeze_me=True)
    # Volts times the drive's gain [N/V].
    run = Run(public["t"], public["qm"][:, None], (public["gtau"] * public["vir"])[:, None])
    folder = CHECKOUT / "urdf" / "emps"
    return Source("emps", ("axis",), (folder / "robot.urdf").read_text(), (folder / "robot.yaml").read_text(), (run,))


def ur10() -> Source:
    """A UR10 with its vendor's inertias; its model has no friction."""
    robot = load_robot("example:ur10")
    log = read_recording(_folder("ur10_unisa") / "ur10_exciting_trajectory.db3", robot)
    urdf = find_example("ur10", examples_folder()).read_text()
    run = Run(log.t - log.t[0], np.array(log.q), np.array(log.tau))
    return Source("ur10", tuple(robot.joint_names), urdf, (EXAMPLES / "ur10" / "robot.yaml").read_text(), (run,))


def panda() -> Source:
    """A Franka Panda with torque sensors; its model has a hand that was not mounted, and no friction."""
    folder, joints = _folder("panda_gaz2019"), tuple(f"panda_joint{k}" for k in range(1, 8))
    with np.load(folder / "log.npz") as log:
        q, tau = (np.column_stack([log[f"{what}.{joint}"] for joint in joints]) for what in ("q", "tau"))
        run = Run(log["t"] - log["t"][0], q, tau)
    return Source("panda", joints, (folder / "robot.urdf").read_text(), (folder / "robot.yaml").read_text(), (run,))


def _double_pendulum(name: str, design: str) -> Source:
    folder = _folder("dfki_double_pendulum")
    with np.load(folder / f"{design}_sysid.npz") as log:
        names = sorted({key.partition("__")[0] for key in log})
        runs = tuple(Run(log[f"{x}__t"] - log[f"{x}__t"][0], log[f"{x}__q"], log[f"{x}__tau_meas"]) for x in names)
    yaml = (EXAMPLES / "double_pendulum" / "robot.yaml").read_text()
    return Source(name, ("Joint1", "Joint2"), (folder / "C1_model.urdf").read_text(), yaml, runs)


def double_pendulum() -> Source:
    """Ten runs of a double pendulum; its model has no friction."""
    return _double_pendulum("double_pendulum", "C1")


def other_pendulum() -> Source:
    """Nine runs of a double pendulum with other links, for which the model of the first one is given."""
    return _double_pendulum("other_pendulum", "C0")


def odrive() -> Source:
    """Slow turns of a brushless motor; its model has its inertia alone, and 1 N m stands for 1 A."""
    with np.load(_folder("odrive_cogging") / "slow_and_pull.npz") as log:
        runs = tuple(
            Run(
                log[f"{x}__t"] - log[f"{x}__t"][0],
                log[f"{x}__pos_counts"][:, None] * 2.0 * np.pi / 8192,
                np.asarray(log[f"{x}__iq_A"], dtype=float)[:, None],
            )
            for x in ("slow2_nocomp_1", "slow2_nocomp_2", "slow2_slower_nocomp_0")
        )
    folder = EXAMPLES / "odrive_cogging"
    return Source("odrive", ("motor",), (folder / "robot.urdf").read_text(), (folder / "robot.yaml").read_text(), runs)


SOURCES: tuple[Callable[[], Source], ...] = (emps, ur10, panda, double_pendulum, other_pendulum, odrive)


def _pieces(run: Run, count: int) -> list[Run]:
    edges = np.linspace(0, len(run.t), count + 1).astype(int)
    return [run.between(first, end) for first, end in pairwise(edges)]


def parts(source: Source, which: int) -> tuple[tuple[Run, ...], tuple[Run, ...]]:
    """The two parts of a recording: one to correct the model with, and one to add the effect to.

    Several runs are shuffled and assigned to the parts in turn. A single long run is cut into 2, 4 or 6 pieces, which
    are assigned in turn. Larger numbers ``which`` also skip a little of its beginning, so that the cuts are elsewhere.

    Args:
        source: The recording.
        which: Number of the cut; an odd number exchanges the parts of the even number before.
    """
    order, runs = which // 2, list(source.runs)
    if len(runs) > 1:
        runs = [runs[k] for k in np.random.default_rng([0x9A27, order]).permutation(len(runs))]
    else:
        run = runs[0]
        seconds = run.t[-1] - run.t[0]
        possible = [count for count in PIECES if seconds / count >= SHORTEST]
        skipped = 0.03 * (order // len(possible) % 6)
        runs = _pieces(run.between(int(skipped * len(run.t)), len(run.t)), possible[order % len(possible)])
    # Neighbouring pieces belong to different parts, so that a slow change of the robot affects both parts.
    one, two = tuple(runs[0::2]), tuple(runs[1::2])
    return (two, one) if which % 2 else (one, two)
