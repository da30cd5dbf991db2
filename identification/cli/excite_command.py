"""The command ``phantom-dyn excite``: designs a motion from which inertial parameters can be identified."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from identification.cli.arguments import DONE, Parser, add_robot, one_blas_thread
from identification.cli.terminal.printed import say
from identification.cli.terminal.progress import EXCITATION, Progress
from identification.files import require_ending, require_new_log, require_writable
from identification.stages import Announcement, Stage
from phantom_dyn.errors import UsageError
from phantom_dyn.model.robot_files import find_robot

if TYPE_CHECKING:
    import numpy as np

    from identification.excitation.collisions import Collisions
    from identification.excitation.criteria import Criterion
    from identification.excitation.limits import FrameBox
    from identification.excitation.motion_shapes import Shapes
    from phantom_dyn.model.robot import Robot


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn excite",
        description="Design a motion from rest to rest that makes the inertial parameters of a robot visible and keeps "
        "its limits of position, velocity and torque. Try it slowly first: obstacles around the robot are not known.",
        examples=(
            "excite robot.urdf --duration 10 --out ref.csv",
            "excite example:ur10 --share 0.5 --box tool0=,,0.1: --out ref.csv",
        ),
    )
    add_robot(out)
    out.add_argument("--duration", metavar="S", type=float, default=10.0, help="length [s] (default: 10)")
    out.add_argument("--out", metavar="FILE", type=Path, required=True, help="CSV, NPZ or Parquet, by ending")
    out.add_argument("--rate", metavar="HZ", type=float, default=100.0, help="rows per second (default: 100)")
    out.add_argument(
        "--shapes",
        choices=("fourier", "splines", "triangles"),
        default="fourier",
        help="basis of the motion: Fourier series (default), B-splines, or triangles and sines, whose constant speeds "
        "show friction",
    )
    out.add_argument(
        "--harmonics", metavar="N", type=int, default=5, help="of the series; splines have twice as many pieces"
    )
    out.add_argument(
        "--criterion",
        choices=("condition", "information"),
        default="condition",
        help="condition number of the base regressor, each column divided by its norm (default), or information "
        "(D-optimality: smallest volume of the parameters' uncertainty)",
    )
    out.add_argument(
        "--velocity",
        metavar="V",
        nargs="+",
        type=float,
        help="highest speed, if the robot file allows more [rad/s or m/s]; one number, or one per joint",
    )
    out.add_argument(
        "--acceleration",
        metavar="A",
        nargs="+",
        type=float,
        help="highest acceleration [rad/s^2 or m/s^2] (default: no limit); one number, or one per joint",
    )
    out.add_argument(
        "--share", type=float, default=1.0, help="share of the velocity and torque limits to use, as 0.8 (default: 1)"
    )
    out.add_argument(
        "--box",
        metavar="FRAME=X0:X1,Y0:Y1,Z0:Z1",
        action="append",
        default=[],
        help="box [m] along the base's axes that a frame must not leave; an empty number is no limit: tool0=,,0.1:",
    )
    out.add_argument(
        "--clearance", metavar="M", type=float, help="least distance between bodies of the robot [m] (default: 0.01)"
    )
    out.add_argument("--ignore-collisions", action="store_true", help="do not check distances between bodies")
    out.add_argument(
        "--clear",
        metavar="D",
        type=float,
        help="least distance from a singularity of loops that are closed numerically, above 0 and below 1 (default: "
        "0.25, a four-bar at a transmission angle of 20 degrees; 0.5 is one at 41 degrees)",
    )
    out.add_argument(
        "--earlier",
        metavar="LOG",
        nargs="+",
        default=[],
        help="earlier recordings: show what they leave open",
    )
    out.add_argument("--seed", type=int, default=0, help="seed of the random motions that it starts from (default: 0)")
    return out


def run(arguments: argparse.Namespace) -> int:
    """Design the motion, write it to a file, and print its properties."""
    one_blas_thread()
    if arguments.seed < 0:
        raise UsageError(f"--seed {arguments.seed} was given, wanted 0 or more")
    if arguments.ignore_collisions and arguments.clearance is not None:
        raise UsageError("--clearance and --ignore-collisions exclude each other: give one of them")
    find_robot(arguments.robot)
    require_ending(arguments.out)
    require_writable(arguments.out, "--out")
    require_new_log(arguments.out, "--out")
    from identification.excitation.excite import PlannedRecording, excite
    from identification.excitation.limits import limits_of
    from identification.export.log_and_map_files import write_log
    from phantom_dyn.model.loading import load_robot

    with Progress(Stage.LOADING, sys.stderr, stages=EXCITATION) as progress:
        shapes, criterion = _shapes(arguments), _criterion(arguments.criterion)
        boxes = [_box(text) for text in arguments.box]
        robot = load_robot(arguments.robot, config=arguments.robot_config)
        limits = limits_of(
            robot,
            velocity=arguments.velocity,
            acceleration=arguments.acceleration,
            share=arguments.share,
            boxes=boxes,
            collisions=_collisions(arguments, robot),
            clear=_clear(arguments.clear, robot),
        )
        result = excite(
            robot,
            shapes,
            limits=limits,
            criterion=criterion,
            planned=PlannedRecording(arguments.rate, earlier=_earlier(arguments, robot)),
            seed=arguments.seed,
            progress=progress.show,
        )
        progress.show(Announcement(Stage.WRITING))
        write_log(arguments.out, result.columns(arguments.rate))
    for note in result.notes:
        say(f"note: {note}")
    say(result.summary())
    say(f"wrote {arguments.out}")
    return DONE


def _shapes(arguments: argparse.Namespace) -> Shapes:
    from identification.excitation.motion_shapes import BSplines, FourierSeries, TrianglesAndSines

    duration, harmonics = arguments.duration, arguments.harmonics
    if arguments.shapes == "splines":
        return BSplines(duration, 2 * harmonics)
    if arguments.shapes == "triangles":
        return TrianglesAndSines(duration, harmonics=harmonics)
    return FourierSeries(duration, harmonics)


def _criterion(name: str) -> Criterion:
    from identification.excitation.criteria import ConditionNumber, DOptimality

    return ConditionNumber() if name == "condition" else DOptimality()


def _collisions(arguments: argparse.Namespace, robot: Robot) -> Collisions | None:
    if arguments.ignore_collisions:
        return None
    from identification.excitation.collisions import CLEARANCE, collisions_of

    return collisions_of(robot, clearance=CLEARANCE if arguments.clearance is None else arguments.clearance)


def _clear(given: float | None, robot: Robot) -> float:
    """Smallest distance of closed chains from a singularity: the value of ``--clear``, or the default.

    Raises:
        UsageError: If ``--clear`` was given for a robot without numerically solved loops.
    """
    from identification.excitation.closable import CLEAR, solved_numerically

    if given is None:
        return CLEAR
    if not solved_numerically(robot):
        raise UsageError(
            f"--clear {given:g} was given, and {robot.name} has no loop that is closed numerically: leave it out"
        )
    return given


def _earlier(arguments: argparse.Namespace, robot: Robot) -> np.ndarray | None:
    """Triangular factor of the regressor of earlier recordings; None without earlier recordings.

    The recordings are reduced to about the sample rate of the new motion.
    """
    if not arguments.earlier:
        return None
    from identification.data.reading import read_recording
    from identification.data.signals import process
    from identification.excitation.design_problem import earlier_factor

    motions = []
    for path in arguments.earlier:
        log = process(read_recording(path, robot), robot)
        rows = log.valid.nonzero()[0][:: max(1, round(log.band.rate_hz / arguments.rate))]
        motions.append(log.motion.at(rows))
    return earlier_factor(robot, motions)


def _box(text: str) -> FrameBox:
    """The box in ``frame=x0:x1,y0:y1,z0:z1``; an empty number or axis means no limit."""
    import numpy as np

    from identification.excitation.limits import FrameBox

    frame, equals, ranges = text.partition("=")
    ends = [[-np.inf, np.inf] for _ in range(3)]
    axes = ranges.split(",")
    try:
        for k, axis in enumerate(axes if axes != [""] else []):
            low, colon, high = axis.partition(":")
            if axis.strip() and not colon:
                raise ValueError(axis)
            ends[k] = [float(low) if low.strip() else -np.inf, float(high) if high.strip() else np.inf]
    except (ValueError, IndexError):
        frame = ""
    if not (frame and equals) or len(axes) != 3:
        raise UsageError(
            f"--box {text} was given, wanted FRAME=X0:X1,Y0:Y1,Z0:Z1 such as tool0=-0.5:0.5,-0.5:0.5,0.1:1"
        )
    lower, upper = np.array(ends).T
    return FrameBox(frame, lower, upper)
