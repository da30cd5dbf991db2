"""The command ``phantom-dyn identify``: estimates the parameters of a robot from recordings."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from identification.cli.arguments import (
    DONE,
    Parser,
    add_list,
    add_logs,
    add_robot,
    excluded_stretches,
    expand_episodes,
    given_files,
    one_blas_thread,
    require_files,
    with_reading_options,
)
from identification.cli.terminal.printed import say
from identification.cli.terminal.progress import IDENTIFICATION, Progress
from identification.stages import Announcement, Stage

if TYPE_CHECKING:
    from identification.data.recording import Recording


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn identify",
        description="Estimate the base parameters, friction and drives of a robot, judge them on data that no fit has "
        "used, and write a report and models to simulate. Of one LOG the last fifth is held out, of several the last "
        "one.",
        examples=(
            "identify robot.urdf log.csv --out fitted/",
            "identify robot.urdf log.csv --hold-out other.csv --estimator consistent --out fitted/",
        ),
    )
    add_robot(out)
    add_logs(out)
    out.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        required=True,
        help="folder for identification.json, report.html, corrected.urdf and corrected.xml",
    )
    out.add_argument(
        "--estimator",
        metavar="NAME",
        default="wls",
        help="ols, wls (default), irls, consistent; with q_ref and controllers in robot.yaml: iv, didim",
    )
    out.add_argument(
        "--friction",
        metavar="TERM[,TERM]",
        default="viscous,coulomb,offset",
        help="terms of every joint: viscous,coulomb,offset (default), direction_dependent, or none for the file's own",
    )
    out.add_argument("--rotors", action="store_true", help="estimate rotor inertias as well")
    add_list(out, "--hold-out", metavar="LOG", help="recordings to judge on, in place of those above")
    return out


def run(arguments: argparse.Namespace) -> int:
    """Identify the parameters, write the files and print a summary."""
    one_blas_thread()
    excluded_stretches(arguments)  # raises an error for wrong times before any slow work
    expand_episodes(arguments)
    require_files(arguments)
    from identification.data.reading import read_recording
    from identification.estimators.estimator_list import estimator_named
    from identification.identify.identification_files import check_folder, write_outputs
    from identification.identify.identification_words import summary
    from identification.identify.identified_model import JointTerms, friction_terms
    from identification.identify.identify import identify
    from phantom_dyn.model.loading import load_robot

    with Progress(Stage.READING, sys.stderr, stages=IDENTIFICATION) as progress:
        estimator_named(arguments.estimator)
        friction = friction_terms([word.strip() for word in arguments.friction.split(",")])
        terms = JointTerms(friction, arguments.rotors)
        check_folder(arguments.out, given_files(arguments))
        robot = load_robot(arguments.robot, config=arguments.robot_config)
        read_with_options = with_reading_options(read_recording, arguments)

        def read(path: str) -> Recording:
            progress.show(Announcement(Stage.READING, detail={"file": Path(path).name}))
            return read_with_options(Path(path), robot)

        found = identify(
            robot,
            tuple(read(path) for path in arguments.logs),
            hold_out=tuple(read(path) for path in arguments.hold_out),
            estimator=arguments.estimator,
            terms=terms,
            folder=arguments.out,
            config=arguments.robot_config,
            progress=progress.show,
        )
        progress.show(Announcement(Stage.WRITING))
        written = write_outputs(found, arguments.out)
    say(summary(found))
    for path in written:
        say(f"wrote {path}")
    return DONE
