"""The forty recordings of `same_answers`: sealed development cases, and real ones in the folder PHANTOM_DYN_DATA.

This module does not import the two packages, so changes to them cannot change a case.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

CHECKOUT = Path(__file__).resolve().parents[1]
EXAMPLES = CHECKOUT / "examples" / "data"
# Seed modulo 6: robot (one, two, three joints, PHANToM, six joints); modulo 23: effect; modulo 5: cause.
SEEDS: dict[str, tuple[int, ...]] = {
    "single": (2, 3, 4, 6, 7, 13, 18, 19, 31, 32, 43, 44, 56, 62, 80),
    "null": (1, 4, 6, 14),
    "pair": (0, 1, 2, 7, 8),
    "outside": (0, 1, 8, 19),
}
SO101_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")  # no gripper
SO101_RUNS = ("backlash_detection", "friction_gravity", "multisine", "velocity_ramp")
XL330_RUNS = ("r10h28m10", "r10h28m32", "r10h28m42", "r10h29m04")
XL330_FULL_SCALE = 885  # unit of the load register
ODRIVE_RUNS = ("slow2_nocomp_1", "slow2_nocomp_2", "slow2_slower_nocomp_0")
PENDULUM_RUNS = tuple(
    f"C1_sysid_{time}"
    for time in (143339, 143524, 143601, 143704, 143747, 143906, 144003, 144115, 154220, 154548)  # columns as recorded
)
EMPS_GAIN = 35.1507  # force per voltage [N/V]
STS3215_COUNTS, STS3215_BAND = 4096, 0.225 * 9.81  # counts per turn; force at the end of the lever [N]

Write = Callable[[Path], None]


@dataclass(frozen=True)
class Recording:
    """A folder of files, and the arguments of ``diagnose`` when it runs in that folder."""

    name: str
    words: tuple[str, ...]
    write: Write


def data_folder(name: str) -> Path:
    """The folder of one real recording."""
    folder = Path(os.environ.get("PHANTOM_DYN_DATA", CHECKOUT.parent / "shared" / "data")) / name
    if not folder.is_dir():
        raise SystemExit(f"there is no folder {folder}: set PHANTOM_DYN_DATA to the folder of the real recordings")
    return folder


def write_sealed(kind: str, seed: int, folder: Path) -> None:
    """Draw a case of the sealed generator, without its answer."""
    from benchmarks.blind.generate import draw

    with tempfile.TemporaryDirectory() as place:
        name = draw(seed, kind, Path(place), Path(place) / "answers")
        shutil.copytree(Path(place) / name, folder, dirs_exist_ok=True)


def save(folder: Path, log: str, columns: Mapping[str, np.ndarray]) -> None:
    """Writes one log as NPZ."""
    np.savez(folder / f"{log}.npz", allow_pickle=False, **{key: np.asarray(x, float) for key, x in columns.items()})


def write_emps(folder: Path) -> None:
    """Write the axis with its force in newtons."""
    from scipy.io import loadmat

    public = loadmat(data_folder("emps") / "DATA_EMPS.mat", squeeze_me=True)
    save(folder, "emps", {"t": public["t"], "q.axis": public["qm"], "tau.axis": EMPS_GAIN * public["vir"]})


def write_ur10(folder: Path) -> None:
    """Copy the bag."""
    shutil.copy(data_folder("ur10_unisa") / "ur10_exciting_trajectory.db3", folder)


def write_pendulum(model: str, runs: Sequence[str], folder: Path) -> None:
    """Write some runs of the double pendulum, with one of its two models."""
    source = data_folder("dfki_double_pendulum")
    shutil.copy(source / model, folder / "robot.urdf")
    with np.load(source / "C1_sysid.npz") as every:
        for run in runs:
            q, tau = every[f"{run}__q"], every[f"{run}__tau_meas"]
            columns = {f"q.Joint{k + 1}": q[:, k] for k in range(2)} | {
                f"tau.Joint{k + 1}": tau[:, k] for k in range(2)
            }
            save(folder, run, {"t": every[f"{run}__t"], **columns})


def write_xl330(runs: Sequence[str], folder: Path) -> None:
    """Write some runs of the servo with its pendulum: position and voltage."""
    with np.load(data_folder("bam_xl330") / "bam_xl330.npz") as every:
        for run in runs:
            volts = every[f"{run}__load"] / XL330_FULL_SCALE * every[f"{run}__input_volts"]
            save(folder, run, {"t": every[f"{run}__timestamp"], "q.servo": every[f"{run}__position"], "u.servo": volts})


def write_odrive(runs: Sequence[str], folder: Path) -> None:
    """Write some slow runs of the motor, in counts and amperes."""
    with np.load(data_folder("odrive_cogging") / "slow_and_pull.npz") as every:
        for run in runs:
            save(folder, run, {name: every[f"{run}__{name}"] for name in ("t", "pos_counts", "iq_A")})


def write_so101(runs: Sequence[str], folder: Path) -> None:
    """Write some motions of the arm: positions and commands."""
    with np.load(data_folder("sage_so101") / "so101.npz") as every:
        for run in runs:
            q = {f"q.{joint}": every[f"{run}__q"][:, k] for k, joint in enumerate(SO101_JOINTS)}
            asked = {f"q_ref.{joint}": every[f"{run}__q_cmd"][:, k] for k, joint in enumerate(SO101_JOINTS)}
            save(folder, run, {"t": every[f"{run}__t"], **q, **asked})


def write_sts3215(folder: Path) -> None:
    """Write the servo on its stand: position, target, and the force of the two bands on its lever."""
    with (data_folder("robonine_backlash") / "single.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))

    def register(name: str) -> np.ndarray:
        return np.array([float(row[name]) for row in rows])

    def stretched(motor: int) -> np.ndarray:
        position, target = register(f"pos ({motor})"), register(f"target pos ({motor})")
        slack, tight = target[0], target[np.argmax(np.abs(target - target[0]))]
        return np.clip((position - slack) / (tight - slack), 0.0, 1.0)

    angle = register("pos (5)") * 2 * np.pi / STS3215_COUNTS
    force = STS3215_BAND * (stretched(4) - stretched(3))
    tip = {"f.tip.x": -force * np.sin(angle), "f.tip.y": force * np.cos(angle), "f.tip.z": np.zeros(len(force))}
    save(
        folder,
        "single",
        {"t": register("t_s"), "position": register("pos (5)"), "target": register("target pos (5)")} | tip,
    )


def with_examples(name: str, write: Write) -> Write:
    """A function that also copies the robot and column files of one example."""

    def both(folder: Path) -> None:
        shutil.copytree(EXAMPLES / name, folder, dirs_exist_ok=True)
        write(folder)

    return both


def sealed() -> tuple[Recording, ...]:
    """The cases of the generator."""
    return tuple(
        Recording(f"{kind}-{seed}", ("robot.urdf", "log.csv"), partial(write_sealed, kind, seed))
        for kind, seeds in SEEDS.items()
        for seed in seeds
    )


def real() -> tuple[Recording, ...]:
    """The recordings of real robots."""

    def made(name: str, robot: str, logs: Sequence[str], example: str, write: Write, *options: str) -> Recording:
        return Recording(name, (robot, *(f"{log}.npz" for log in logs), *options), with_examples(example, write))

    beside, config, columns = "robot.urdf", ("--robot-config", "robot.yaml"), ("--columns", "columns.yaml")
    ours, theirs = "C1_model.urdf", "design_C1_identified.urdf"
    fitted, held_out = PENDULUM_RUNS[2:6], PENDULUM_RUNS[6:8]

    def pendulum(name: str, model: str, runs: Sequence[str], *options: str, more: Sequence[str] = ()) -> Recording:
        return made(name, beside, runs, "double_pendulum", partial(write_pendulum, model, (*runs, *more)), *options)

    def servo(name: str, runs: Sequence[str], *options: str) -> Recording:
        return made(name, beside, runs, "xl330", partial(write_xl330, runs), *options)

    def motor(name: str, runs: Sequence[str]) -> Recording:
        return made(name, beside, runs, "odrive_cogging", partial(write_odrive, runs), *columns)

    def arm(name: str, runs: Sequence[str]) -> Recording:
        return made(name, "example:so101", runs, "so101", partial(write_so101, runs), *config, "--motion-only")

    bag = ("example:ur10", "ur10_exciting_trajectory.db3", *config)
    hold_out = ("--hold-out", *(f"{run}.npz" for run in held_out))
    return (
        Recording("emps", ("emps", "emps.npz"), write_emps),
        Recording("ur10", bag, with_examples("ur10", write_ur10)),
        pendulum("pendulum", ours, PENDULUM_RUNS),
        pendulum("pendulum-wrong", theirs, PENDULUM_RUNS),
        pendulum("pendulum-held-out", ours, fitted, *hold_out, more=held_out),
        servo("xl330", XL330_RUNS, "--recordings", "recordings.yaml"),
        servo("xl330-one", XL330_RUNS[1:2]),
        motor("odrive", ODRIVE_RUNS),
        motor("odrive-one", ODRIVE_RUNS[2:]),
        arm("so101", SO101_RUNS),
        arm("so101-multisine", SO101_RUNS[2:3]),
        made("sts3215", beside, ("single",), "sts3215", write_sts3215, *columns, "--motion-only"),
    )


def recordings() -> tuple[Recording, ...]:
    """All of them, the real ones first."""
    return (*real(), *sealed())


def prepared(recording: Recording, cache: Path) -> Path:
    """The folder of a recording; it is written once, under a temporary name until it is complete."""
    folder = cache / recording.name
    if not folder.is_dir():
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cache) as place:
            part = Path(place) / "part"
            part.mkdir()
            recording.write(part)
            part.rename(folder)
    return folder


def fingerprint(recording: Recording, folder: Path) -> str:
    """A hash of the command's arguments and of every file in the folder."""
    said = hashlib.sha256(json.dumps(recording.words).encode())
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        said.update(path.relative_to(folder).as_posix().encode() + hashlib.sha256(path.read_bytes()).digest())
    return said.hexdigest()[:16]
