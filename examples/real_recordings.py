"""What the diagnosis says of each real recording, beside what is published, as a table of the documentation.

``python examples/real_recordings.py [NAME ...] [--folder FOLDER] [--write docs/real_recordings.md]``. Every recording
goes through ``phantom-dyn diagnose`` with the files of ``examples/data``, as a user's own would; the reports stay in
the folder.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from arguments import CHECKOUT
from double_pendulum_logs import write_double_pendulum_logs
from emps_log import write_emps_log
from published_truth import COULOMB, LOAD, VISCOUS, Cause, Truth, frictions, judged
from real_logs import write_odrive_logs, write_so101_logs, write_sts3215_log, write_xl330_logs
from real_words import said

from identification.cli.main import main as phantom_dyn
from identification.data import datasets
from phantom_dyn.errors import LogError

DATA = Path(__file__).parent / "data"
SO101_MOTIONS = ("backlash_detection", "friction_gravity", "multisine", "velocity_ramp")
BEGIN, END = "<!-- real:begin -->", "<!-- real:end -->"
HEAD = "| recording | model given | published | what the diagnosis says | right? |\n|---|---|---|---|---|"
UR10_JOINTS = (
    *(f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow")),
    *(f"wrist_{k}_joint" for k in (1, 2, 3)),
)
TX40_JOINTS = tuple(f"joint_{k}" for k in range(1, 7))
PANDA_JOINTS = tuple(f"panda_joint{k}" for k in range(1, 8))
SO101_FRICTION = ("presliding_friction", "coulomb_friction", "stribeck_friction")


@dataclass(frozen=True)
class RealRecording:
    """A row of the table.

    Attributes:
        name: How the command line calls it; also the folder of its report.
        title: What was recorded.
        model: What the given model holds, in words.
        published: What its authors say of it.
        truth: The same as causes of the catalogue.
        robot: ROBOT of the command, asked for late: a file of the recording may have to be fetched.
        logs: Writes the logs into a folder, or says where they are.
        options: Of the command.
    """

    name: str
    title: str
    model: str
    published: str
    truth: Truth
    robot: Callable[[], str]
    logs: Callable[[Path], Sequence[Path]]
    options: tuple[str, ...] = ()


def _beside(name: str, file: str) -> str:
    return str(DATA / name / file)


def _in_registry(name: str, file: str) -> Path:
    return datasets.fetch(name) / file


def _go1(mass: int) -> RealRecording:
    """The bare lever with a mass at its tip; without one there is friction alone."""
    return RealRecording(
        f"go1_{mass}kg",
        f"Go1 leg drive with a pendulum, {mass} kg at its tip, 6 s",
        "the bare lever of 0.08 kg, no friction",
        f"{mass} kg at 0.15 m" if mass else "the lever alone",
        Truth((Cause(LOAD, size=float(mass), kind="mass"),), ("torque_constant",)) if mass else Truth((), LOAD),
        lambda: str(_in_registry("go1_pendulum", "robot.urdf")),
        lambda _: (_in_registry("go1_pendulum", f"sin_sin_{mass}kg.csv"),),
    )


def _double_pendulum(name: str, title: str, file: str, model: str, published: str, truth: Truth) -> RealRecording:
    return RealRecording(
        name,
        title,
        model,
        published,
        truth,
        lambda: str(datasets.fetch("dfki_double_pendulum") / file),
        write_double_pendulum_logs,
        ("--robot-config", _beside("double_pendulum", "robot.yaml")),
    )


def _so101_logs(folder: Path) -> list[Path]:
    """Four motions without steps, which ask a servo for more torque than it has."""
    return [path for path in write_so101_logs(folder) if path.stem in SO101_MOTIONS]


RECORDINGS = (
    RealRecording(
        "emps",
        "EMPS, one linear axis, 25 s",
        "mass only",
        "friction by direction: 20.1 and 20.6 N, 166.7 and 240.4 N s/m",
        Truth(
            (
                Cause(("direction_dependent_friction",), "axis", 20.4, "coulomb"),
                Cause(("direction_dependent_friction",), "axis", 203.5, "viscous"),
            )
        ),
        lambda: "emps",
        lambda folder: (write_emps_log(folder),),
    ),
    RealRecording(
        "ur10",
        "UR10, exciting trajectory, 28 s",
        "vendor's URDF, no friction",
        "friction on every joint",
        Truth(tuple(Cause((*COULOMB, *VISCOUS), joint) for joint in UR10_JOINTS)),
        lambda: "example:ur10",
        lambda folder: (datasets.fetch("ur10_unisa") / "ur10_exciting_trajectory.db3",),
        ("--robot-config", _beside("ur10", "robot.yaml")),
    ),
    RealRecording(
        "tx40",
        "Staubli TX40, exciting trajectory, 7 s",
        "vendor's URDF, no friction",
        "viscous friction 8.1, 5.6, 2.0, 1.1, 1.3, 0.05 N m s/rad, Coulomb 7.0, 8.1, 6.3, 2.5, 3.0, 0.2 N m; joints 5 "
        "and 6 coupled: 2.03 N m, 0.60 N m s/rad",
        Truth(
            (
                # Published are 1.858 and 0.644 N m s/rad of joints 5 and 6, where the coupling's 0.5975 acts on the
                # speed of the other joint alone; ours acts on the sum of both speeds, and so holds that much of each.
                *frictions(TX40_JOINTS, (8.107, 5.601, 1.978, 1.107, 1.260, 0.046), VISCOUS, "viscous"),
                *frictions(TX40_JOINTS, (6.967, 8.123, 6.307, 2.484, 3.026, 0.244), COULOMB, "coulomb"),
                Cause(("joint_coupling",), "joint_5+joint_6", 2.033, "coulomb"),
                Cause(("joint_coupling",), "joint_5+joint_6", 0.5975, "viscous"),
            ),
            ("torque_saturation",),
        ),
        lambda: str(_in_registry("tx40", "robot.urdf")),
        lambda _: (_in_registry("tx40", "log.csv"),),
    ),
    RealRecording(
        "panda_gaz2019",
        "Franka Panda, exciting trajectory, torque sensors, 21 s",
        "URDF with the hand, no friction",
        "friction 0.27, 0.44, 0.32, 0.64, 0.42, 0.15, 0.28 N m; very likely no hand was mounted",
        Truth(
            (
                *frictions(PANDA_JOINTS, (0.27, 0.44, 0.32, 0.64, 0.42, 0.15, 0.28), COULOMB, "coulomb"),
                Cause(LOAD, size=-0.73, kind="mass"),
            ),
            ("cogging", "transmission_compliance", "backlash"),
        ),
        lambda: str(_in_registry("panda_gaz2019", "robot.urdf")),
        lambda _: (_in_registry("panda_gaz2019", "log.npz"),),
    ),
    *(_go1(mass) for mass in (0, 1, 2)),
    _double_pendulum(
        "double_pendulum",
        "double pendulum C.1, ten runs",
        "C1_model.urdf",
        "published masses and inertias, no friction",
        "Coulomb friction on both joints: 0.16 and 0.12 N m",
        Truth((Cause(COULOMB, "Joint1", 0.16, "coulomb"), Cause(COULOMB, "Joint2", 0.12, "coulomb"))),
    ),
    _double_pendulum(
        "double_pendulum_wrong",
        "the same double pendulum",
        "design_C1_identified.urdf",
        "the authors' own URDF",
        "its friction is in it, its inertias count m r^2 twice",
        Truth((Cause(("inertial_parameters",)),)),
    ),
    RealRecording(
        "odrive_cogging",
        "brushless motor, three slow turns; 1 N m stands for 1 A",
        "inertia only",
        "cogging: 7, 28, 14, 36 and 12 cycles a turn lead the map of holding currents",
        Truth((Cause(("cogging",), "motor"),), ("torque_saturation",)),
        lambda: _beside("odrive_cogging", "robot.urdf"),
        write_odrive_logs,
        ("--columns", _beside("odrive_cogging", "columns.yaml")),
    ),
    RealRecording(
        "xl330",
        "XL330 servo with a pendulum, four runs of 6 s, from its voltage, without where it stands",
        "load and rotor inertia, no friction",
        "friction that grows with load, and Stribeck's, fit better than Coulomb and viscous alone",
        Truth((Cause(("load_dependent_friction",), "servo"), Cause(("stribeck_friction",), "servo"))),
        lambda: _beside("xl330", "robot.urdf"),
        write_xl330_logs,
        ("--recordings", _beside("xl330", "recordings.yaml")),
    ),
    RealRecording(
        "so101",
        "SO-101 arm, commands and positions alone, four motions of 120 s at 50 Hz",
        "URDF, no friction; gains are not published: 12 N m/rad, as the sag shows",
        "positions come 120 to 140 ms after commands; joints stick and slip",
        Truth((Cause(("input_delay", "actuator_lag")), Cause(SO101_FRICTION))),
        lambda: "example:so101",
        _so101_logs,
        ("--robot-config", _beside("so101", "robot.yaml"), "--motion-only"),
    ),
    RealRecording(
        "sts3215",
        "STS3215 servo on a backlash stand, commands and positions alone, 27 s at 10 Hz",
        "a bare lever, pulled by bands of 2.2 N",
        "14.8 counts (22.7 mrad) apart under loads of opposite sign: play, dead band and controller together",
        Truth((Cause(("backlash",), "servo", 0.0227, "gap"),)),
        lambda: _beside("sts3215", "robot.urdf"),
        write_sts3215_log,
        ("--columns", _beside("sts3215", "columns.yaml"), "--motion-only"),
    ),
)


def diagnosed(recording: RealRecording, folder: Path) -> dict | str:
    """``diagnosis.json`` of a recording, or the sentence with which the command refused it."""
    report = folder / recording.name / "report"
    logs = recording.logs(folder / recording.name)
    errors = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        words = ["diagnose", recording.robot(), *map(str, logs), *recording.options, "--out", str(report)]
        code = phantom_dyn(words)
    if code != 0:
        return errors.getvalue().strip().rpartition("phantom-dyn: ")[2]
    return json.loads((report / "diagnosis.json").read_text())


def row(recording: RealRecording, folder: Path) -> str:
    """One line of the table."""
    found = diagnosed(recording, folder)
    says, right = (
        (f"refused: {found}", "-") if isinstance(found, str) else (said(found), judged(recording.truth, found))
    )
    return f"| {recording.title} | {recording.model} | {recording.published} | {says} | {right} |"


def with_table(text: str, table: str) -> str:
    """A text with everything between the two markers replaced.

    Raises:
        LogError: If the markers are not there, each once and in order.
    """
    pattern = re.compile(f"{BEGIN}.*?{END}", re.DOTALL)
    if text.count(BEGIN) != 1 or text.count(END) != 1 or not pattern.search(text):
        raise LogError(f"the text has to hold {BEGIN} and then {END}, each once: put them where the table goes.")
    return pattern.sub(lambda _: table, text)


def main(words: Sequence[str] | None = None) -> None:
    names = [recording.name for recording in RECORDINGS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", metavar="NAME", nargs="*", help=f"of {', '.join(names)}; default: all")
    parser.add_argument("--folder", type=Path, default=CHECKOUT / "demo" / "real", help="default: demo/real")
    parser.add_argument("--write", type=Path, metavar="FILE", help="put the table between the markers of this file")
    arguments = parser.parse_args(words)
    unknown = [name for name in arguments.names if name not in names]
    if unknown:
        raise LogError(f"there is no recording {unknown[0]}: give some of {', '.join(names)}.")
    if arguments.write and arguments.names:
        raise LogError("--write needs the whole table: leave the names out.")
    chosen = [recording for recording in RECORDINGS if not arguments.names or recording.name in arguments.names]
    lines = [BEGIN, HEAD]
    for recording in chosen:
        lines.append(row(recording, arguments.folder))
        print(lines[-1], flush=True)
    table = "\n".join([*lines, END])
    if arguments.write:
        arguments.write.write_text(with_table(arguments.write.read_text(), table))
    else:
        print(f"\n{table}")


if __name__ == "__main__":
    try:
        main()
    except LogError as error:
        sys.exit(str(error))
