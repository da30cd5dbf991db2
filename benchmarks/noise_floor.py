"""Compare the noise floor that is propagated from the sensors with the true floor, joint by joint.

    python benchmarks/noise_floor.py given FOLDER...       cases with answers that state the floor of the sensors
    python benchmarks/noise_floor.py make --seeds 0:20     sealed cases without an effect, with known noise-free signals
    python benchmarks/noise_floor.py repeated FILE...      noise relative to torque, from diagnoses of repeated motions

The true floor is the root mean square, in a stated band, of the inverse dynamics of the noisy signals minus that of the
noise-free signals of the same run, with the true friction. A given answer states it below a frequency of its own
(``sensor_floor_below_8_hz``); the white part is scaled to this band. The goal is a ratio within 1.2
for 95 % of the joints.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.blind.generate import seed_range
from benchmarks.gapbench.generator.files import robot_yaml, urdf_text
from benchmarks.gapbench.generator.setup import draw_setup, logged_torque, run_of, tracks
from identification.data.log import Log
from identification.data.reading import read_recording
from identification.data.recording import Recording
from identification.data.signals import process
from identification.diagnosis.columns.motion.standstill import usable_samples
from identification.diagnosis.columns.session import Session, session_of
from identification.diagnosis.noise.sensor_floor import SensorFloor, sensor_floor
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot

Array = np.ndarray

GIVEN_BAND = 8.0  # edge of the band in which given answers state the floor [Hz]
WITHIN = 1.2


@dataclass(frozen=True)
class Compared:
    """A case with the ratio of the propagated to the true floor of each joint, or NaN.

    Attributes:
        name: Name of the case.
        joints: Names of the joints.
        ratio: Propagated floor divided by true floor.
        inside: True if the true floor is inside the interval, without the discrepancy.
    """

    name: str
    joints: tuple[str, ...]
    ratio: Array
    inside: Array


def propagated(session: Session) -> SensorFloor:
    """The floor of a session's joints that can be judged, else NaN."""
    return sensor_floor(session, tuple(usable_samples(log).astype(float) for log in session.logs))


def given(folder: Path) -> Compared:
    """A given case, whose answer states the floor of the sensors."""
    answer = json.loads((folder / "answer.json").read_text())["sensor_floor_below_8_hz"]
    robot = load_robot(folder / "robot.urdf")
    session = session_of(robot, (read_recording(folder / "log.npz", robot),))
    found = propagated(session)
    wider = np.sqrt(GIVEN_BAND / session.cutoff_hz)
    true = np.array([answer[name] for name in robot.joint_names])
    return _compared(folder.name, robot, true, found, wider)


def of_make(seed: int) -> Compared | None:
    """A sealed null of the first make with known noise-free signals, or None if the seed gives none."""
    setup = draw_setup(seed, kind="null")
    run = run_of(setup)
    if not tracks(run, setup):
        return None
    robot = _written(
        urdf_text(setup.owner),
        robot_yaml(
            setup.owner,
            torque_hold=setup.torque_hold,
            encoder_counts=setup.session.encoder_counts,
            tolerance=setup.tolerance,
        ),
    )
    tau = logged_torque(run, setup.torque_hold)
    noisy = Recording("noisy", robot.joint_names, run.t, run.measured, tau)
    acting = logged_torque(replace(run, command=run.command + setup.session.disturbance), setup.torque_hold)
    session = session_of(robot, (noisy,))
    log = session.logs[0]
    clean = process(replace(noisy, file="clean", q=run.seen, tau=acting), robot, cutoff_hz=log.band.cutoff_hz)
    error = session.log_in_judged_band(log.band(_rigid_balance(robot, log) - _rigid_balance(robot, clean)), 0)
    use = usable_samples(log)
    true = np.sqrt(np.sum(np.where(use, error**2, 0.0), axis=0) / np.maximum(use.sum(axis=0), 1))
    return _compared(
        f"{seed} {setup.owner.name}", robot, np.where(use.any(axis=0), true, np.nan), propagated(session), 1
    )


def _written(urdf: str, yaml: str) -> Robot:
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "robot.urdf").write_text(urdf)
        (Path(place) / "robot.yaml").write_text(yaml)
        return load_robot(Path(place) / "robot.urdf")


def _rigid_balance(robot: Robot, log: Log) -> Array:
    """Torque minus the torque of the motion without friction."""
    return log.tau - inverse_dynamics(robot, log.motion) + modelled_friction(robot, log.motion)


def _compared(name: str, robot: Robot, true: Array, found: SensorFloor, wider: float) -> Compared:
    scaled = np.hypot(found.torque * wider, found.encoders)
    ratio = scaled / true
    inside = (ratio * found.low / found.value <= 1.0) & (ratio * found.high / found.value >= 1.0)
    return Compared(name, robot.joint_names, ratio, inside)


def summary(cases: Sequence[Compared]) -> list[str]:
    """How many floors are known, and how many of these are right."""
    ratio = np.concatenate([case.ratio for case in cases])
    inside = np.concatenate([case.inside for case in cases])
    known = np.isfinite(ratio)
    right = np.maximum(ratio[known], 1.0 / ratio[known]) <= WITHIN
    ends = np.percentile(ratio[known], [2.5, 16, 50, 84, 97.5])
    return [
        f"joints                 {len(ratio)}, floor known of {known.sum()}",
        f"within a factor of {WITHIN} {right.sum()} of {known.sum()} ({100 * right.mean():.0f} %)",
        f"inside the interval    {inside[known].sum()} of {known.sum()} ({100 * inside[known].mean():.0f} %)",
        "ratio at 2.5, 16, 50, 84, 97.5 %: " + ", ".join(f"{end:.2f}" for end in ends),
    ]


def _cases(words: argparse.Namespace) -> Iterator[Compared]:
    if words.kind == "given":
        for folder in words.folders:
            yield from (given(one.parent) for one in sorted(folder.glob("*/answer.json")))
    else:
        for seed in words.seeds:
            case = of_make(seed)
            if case is not None:
                yield case


def repeated(diagnosis: Path) -> list[str]:
    """Noise relative to torque of the joints whose noise a ``diagnosis.json`` has from repetitions."""
    return [
        f"{diagnosis} {one['joint']} {100 * one['noise_floor'] / one['rms_torque']:.1f} %"
        for one in json.loads(diagnosis.read_text())["joints"]
        if one["noise_floor_source"] == "repetitions"
    ]


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line and print one line for each case, then the results."""
    parser = argparse.ArgumentParser(description="The propagated noise floor against the true one.")
    kinds = parser.add_subparsers(dest="kind", required=True)
    kinds.add_parser("given").add_argument("folders", nargs="+", type=Path)
    kinds.add_parser("make").add_argument("--seeds", type=seed_range, default=range(20))
    kinds.add_parser("repeated").add_argument("diagnoses", nargs="+", type=Path)
    given_words = parser.parse_args(words)
    if given_words.kind == "repeated":
        print(*(line for file in given_words.diagnoses for line in repeated(file)), sep="\n")
        return
    cases = []
    for case in _cases(given_words):
        cases.append(case)
        print(case.name, *(f"{j} {r:.2f}" for j, r in zip(case.joints, case.ratio, strict=True)), flush=True)
    print(*summary(cases), sep="\n")


if __name__ == "__main__":
    main()
