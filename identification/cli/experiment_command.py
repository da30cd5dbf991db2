"""The command ``phantom-dyn experiment``: fits friction at constant speeds, or the stiffness of a transmission."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from identification.cli.arguments import (
    DONE,
    Parser,
    add_logs,
    add_robot,
    excluded_stretches,
    expand_episodes,
    one_blas_thread,
    with_reading_options,
)
from identification.cli.terminal.printed import say
from identification.file_sets import renamed_together
from identification.files import require_existing, require_own, require_writable_folder
from phantom_dyn.errors import LogError, UsageError, known_names
from phantom_dyn.model.robot_files import find_robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification.data.recording import Recording
    from identification.experiments.linear_fit import LinearFit
    from phantom_dyn.model.robot import Robot

# Smallest share of its motion for which a friction test must have constant speed. Triangles have more, sines less.
_STEADY = 0.5
_NAMES = {"K": "stiffness", "B": "damping", "C": "dry friction", "offset": "offset"}


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn experiment",
        description="friction: viscous and Coulomb friction of each joint that moves at constant speeds (triangles of "
        "several speeds), without a model of the masses; for the CEA branch also its passive joints, from three tests. "
        "stiffness: stiffness, damping and dry friction of a transmission, from the torque and position of its motor "
        "while the arm is held and the torque goes up and down; give recordings of several rates.",
        examples=(
            "experiment friction robot.urdf triangles.csv --out friction/",
            "experiment stiffness robot.urdf slow.csv fast.csv --joint j1 --out stiffness/",
        ),
    )
    out.add_argument("test", metavar="TEST", choices=("friction", "stiffness"), help="friction or stiffness")
    add_robot(out)
    add_logs(out)
    out.add_argument(
        "--joint", metavar="NAME", help="for stiffness: the motor that pushed (default: the one that moves)"
    )
    out.add_argument("--out", metavar="DIR", type=Path, help="write experiment.json and a figure there")
    return out


def run(arguments: argparse.Namespace) -> int:
    """Fit the test, print the parameters, and write the files."""
    one_blas_thread()
    if arguments.joint is not None and arguments.test == "friction":
        raise UsageError("--joint was given with friction, which takes every joint that moves: leave it out.")
    excluded_stretches(arguments)  # raises an error for wrong times before any slow work
    find_robot(arguments.robot)
    expand_episodes(arguments)
    for log in arguments.logs:
        require_existing(log)
    picture = f"{arguments.test}.png"
    if arguments.out is not None:
        require_writable_folder(arguments.out, ("experiment.json", picture))
        require_own(arguments.out, ("experiment.json", picture), index="experiment.json", unmarked=(picture,))
    from identification.data.reading import read_recording
    from phantom_dyn.model.loading import load_robot

    robot = load_robot(arguments.robot, config=arguments.robot_config)
    # With a held arm the joint hardly moves, so the checks for a moving robot would refuse the recording.
    arm_held = arguments.test == "stiffness"
    read = with_reading_options(read_recording, arguments)
    recordings = tuple(read(log, robot, anyway=arguments.anyway or arm_held) for log in arguments.logs)
    if not arm_held:
        from identification.data.refusal import require_right

        require_right(recordings)
    entries, figure = (_stiffness if arm_held else _friction)(robot, recordings, arguments.joint)
    if arguments.out is not None:
        content = {"program": "phantom-dyn", "test": arguments.test, "robot": robot.name, "results": entries}
        text = json.dumps(content, indent=1) + "\n"
        written = [arguments.out / name for name in ("experiment.json", picture)]
        with renamed_together(arguments.out) as temporary_path:
            temporary_path(written[0]).write_text(text, encoding="utf-8")
            figure.savefig(temporary_path(written[1]))
        for path in written:
            say(f"wrote {path}")
    return DONE


def _friction(robot: Robot, recordings: tuple[Recording, ...], _: str | None) -> tuple[list[dict], Figure]:
    """Fit friction and print the result; returns entries of the JSON file and a figure."""
    from identification.data.signals import process
    from identification.experiments.constant_speed_friction import friction_tests
    from identification.reporting.experiment_figures import friction_figure
    from identification.words.numbers_and_names import percent

    logs = [process(recording, robot) for recording in recordings]
    tests = [test for log in logs for test in friction_tests(log, robot.torque_units)]
    for test in tests:
        say(f"{test.file}, {test.joint}: {_words(test.fit)}")
    for test in tests:
        negative = [name for name in test.fit.names if _below_zero(test.fit, name)]
        doubts = [f"its {' and '.join(negative)} friction is below zero"] if negative else []
        if test.steady < _STEADY:
            doubts.append(f"its speed was constant in {percent(test.steady)} of its motion")
        if doubts:
            say(
                f"note: {test.file}, {test.joint}: {', and '.join(doubts)}; the result is friction only if one joint "
                "at a time moves in triangles of several speeds."
            )
    entries = [{"recording": test.file, "joint": test.joint, "parameters": _numbers(test.fit)} for test in tests]
    if robot.source == "cea_branch" and len(logs) > 1:
        entries += _passive(logs)
    return entries, friction_figure(tests)


def _passive(logs: list) -> list[dict]:
    """Friction of the passive joints of the CEA branch, from three tests, as entries of the JSON file."""
    from identification.experiments.parallelogram_friction import MOVING, fit_friction_test, passive_friction, test_of

    named = {test_of(log.motion): log for log in logs}
    if missing := [name for name in MOVING if name not in named]:
        raise LogError(
            f"The recordings lack test {', '.join(missing)}: record q2 and q5 at one speed (t1), q2 alone (t2) and q5 "
            "alone (t3)."
        )
    found = passive_friction({name: fit_friction_test(name, log.motion, log.tau) for name, log in named.items()})
    numbers, parts = {}, []
    for name, kind, unit in (("FV3R", "viscous", "N m s/rad"), ("FC3R", "coulomb", "N m")):
        value, std = found[name]
        numbers[kind] = {"value": value, "std": std, "unit": unit}
        parts.append(f"{kind} {value:.4g} ± {std:.2g} {unit}")
    say(f"passive joints together: {', '.join(parts)}")
    return [{"recording": None, "joint": "passive joints", "parameters": numbers}]


def _stiffness(robot: Robot, recordings: tuple[Recording, ...], joint: str | None) -> tuple[list[dict], Figure]:
    """Fit the stiffness of a transmission and print the result; returns entries of the JSON file and a figure."""
    from dataclasses import replace

    from identification.experiments.transmission import cutoff_of, fit_transmission, loop_of, moving_joint
    from identification.reporting.experiment_figures import stiffness_figure

    if joint is not None and joint not in robot.joint_names:
        raise UsageError(
            f"--joint names the unknown joint {joint!r}, {known_names(joint, robot.joint_names, 'joints')}"
        )
    joint = moving_joint(recordings) if joint is None else joint
    loops = tuple(loop_of(recording, joint) for recording in recordings)
    fit = fit_transmission(loops, cutoff_hz=cutoff_of(loops))
    if robot.torque_units[robot.joint_names.index(joint)] == "N":
        fit = replace(fit, units=("N/m", "N s/m", "N", "N"))
    say(f"{joint}: {_words(fit)}")
    if len(loops) == 1:
        say("note: one recording hardly separates damping from dry friction; record loops of several rates.")
    if _below_zero(fit, "K"):
        say(
            "note: no transmission has a stiffness below zero: the arm was not held, or the torque has the wrong sign; "
            "hold the arm, or mend the sign with --columns."
        )
    entries = [{"recording": [one.file for one in recordings], "joint": joint, "parameters": _numbers(fit)}]
    return entries, stiffness_figure(joint, loops, fit)


def _words(fit: LinearFit) -> str:
    """Parameters of a fit with their standard errors and units."""
    parts = zip(fit.names, fit.theta, fit.std(), fit.units, strict=True)
    return ", ".join(f"{_NAMES.get(name, name)} {value:.4g} ± {std:.2g} {unit}" for name, value, std, unit in parts)


def _below_zero(fit: LinearFit, name: str) -> bool:
    """True if a parameter is negative by more than two standard errors."""
    k = fit.names.index(name)
    return bool(fit.theta[k] < -2 * fit.std()[k])


def _numbers(fit: LinearFit) -> dict[str, dict[str, float | str]]:
    """Parameters of a fit as an entry of the JSON file."""
    parts = zip(fit.names, fit.theta, fit.std(), fit.units, strict=True)
    return {
        _NAMES.get(name, name): {"value": float(value), "std": float(std), "unit": unit}
        for name, value, std, unit in parts
    }
