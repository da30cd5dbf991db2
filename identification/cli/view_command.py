"""The command ``phantom-dyn view``: replays a recording in the browser, next to simulations of the models."""

from __future__ import annotations

import argparse
import os
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from identification.cli.arguments import (
    DONE,
    Parser,
    add_effects,
    add_list,
    add_log,
    add_robot,
    excluded_stretches,
    expand_one_episode,
    one_blas_thread,
    robot_with_effects,
    with_reading_options,
)
from identification.cli.terminal.printed import say
from identification.cli.terminal.progress import VIEW, Progress
from identification.files import require_existing, require_not_swapped
from identification.stages import Stage
from phantom_dyn.errors import UsageError
from phantom_dyn.libraries import is_installed, missing_library
from phantom_dyn.model.robot_files import find_robot

if TYPE_CHECKING:
    from identification.data.recording import Recording
    from identification.viewing.replay import Replay

_PORTS = 65_535


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn view",
        description="Replay a recording in the browser: the measured motion beside that of the given model and, with "
        "--diagnosis, of the corrected one. Joints are coloured by their torque residual, and curves can be scrubbed "
        "through. Ctrl-C ends it.",
        examples=(
            "view robot.urdf log.csv --diagnosis report/",
            "view example:ur10 log.csv --columns columns.yaml --port 9000 --no-open",
        ),
    )
    add_robot(out)
    add_log(out)
    out.add_argument(
        "--diagnosis",
        metavar="FILE",
        type=Path,
        help="diagnosis.json, the folder of diagnose --out, or a corrected.yaml: it gives the corrected model",
    )
    add_effects(out)
    add_list(out, "--with", dest="known", metavar="FILE", help="corrected.yaml that is already part of the given model")
    out.add_argument(
        "--motion-only",
        action="store_true",
        help="do not use the torque of the log: take the one that the controllers ask for at the q_ref. columns (a log "
        "without torque needs no option)",
    )
    out.add_argument(
        "--horizon",
        metavar="S",
        type=float,
        help="time after which the simulation restarts from the recorded motion [s] (default: as in the diagnosis, "
        "else 0.5)",
    )
    out.add_argument("--host", default="127.0.0.1", help="address to listen on (default: 127.0.0.1, this machine only)")
    out.add_argument("--port", metavar="N", type=int, help="port to listen on (default: 8080 or the next that is free)")
    out.add_argument("--no-open", action="store_true", help="do not open a browser")
    return out


def run(arguments: argparse.Namespace) -> int:
    """Prepare the replay and serve it until Ctrl-C."""
    one_blas_thread()
    excluded_stretches(arguments)  # raises an error for wrong times before any slow work
    _require_numbers(arguments)
    require_not_swapped(arguments.robot, [arguments.log])
    find_robot(arguments.robot)
    require_existing(arguments.log)
    expand_one_episode(arguments)
    if not is_installed("viser"):
        raise UsageError(missing_library("viser"))
    from identification.viewing.browser import served

    replay = _replay(arguments)
    for note in replay.notes:
        say(f"note: {note}")
    with served(replay, host=arguments.host, port=arguments.port) as page:
        say(f"{replay.file} is replayed at {page.url} (Ctrl-C ends it)", flush=True)
        if not arguments.no_open and _has_browser():
            webbrowser.open(page.url)
        try:
            page.run()
        except KeyboardInterrupt:
            say("\nended")
    return DONE


def _require_numbers(arguments: argparse.Namespace) -> None:
    """Raise an error for a port or horizon out of range."""
    if arguments.port is not None and not 0 < arguments.port <= _PORTS:
        raise UsageError(f"--port {arguments.port} was given, wanted a number from 1 to {_PORTS}")
    if arguments.horizon is not None and not 0 < arguments.horizon < float("inf"):
        raise UsageError(f"--horizon {arguments.horizon:g} was given, wanted a time in seconds above 0")


def _replay(arguments: argparse.Namespace) -> Replay:
    """Prepare the replay from the arguments of the command."""
    with Progress(Stage.LOADING, sys.stderr, stages=VIEW) as progress:
        from identification.data.reading import read_recording
        from identification.export.corrected.corrected_yaml import known_effects
        from identification.scenarios.torque_or_motion import driven_by_controllers, torque_or_motion
        from identification.viewing.corrections import read_correction
        from identification.viewing.replay import replay_of

        robot = robot_with_effects(arguments)
        correction = None if arguments.diagnosis is None else read_correction(arguments.diagnosis, robot)
        known = known_effects(tuple(Path(path) for path in arguments.known), robot)
        read_with_options = with_reading_options(read_recording, arguments)

        def read(torque_needed: bool) -> tuple[Recording, ...]:
            return (read_with_options(arguments.log, robot, torque_needed=torque_needed),)

        driven, recordings, motion = torque_or_motion(robot, read, motion_only=arguments.motion_only)
        if motion:
            driven, recordings = driven_by_controllers(driven, recordings)
        return replay_of(
            driven,
            recordings[0],
            correction=correction,
            known=known,
            horizon_s=arguments.horizon,
            progress=progress.show,
        )


def _has_browser() -> bool:
    """False on a computer without a screen, where a text browser would open in the terminal."""
    return sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
