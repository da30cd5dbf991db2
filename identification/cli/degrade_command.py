"""The command ``phantom-dyn degrade``: adds effects to a log, as if it were recorded on a cheaper device."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from identification.cli.arguments import (
    DONE,
    Parser,
    add_effects,
    add_reading,
    add_robot,
    expand_one_episode,
    one_blas_thread,
    robot_with_effects,
)
from identification.cli.terminal.printed import say
from identification.files import (
    require_ending,
    require_existing,
    require_new_log,
    require_not_swapped,
    require_writable,
)
from phantom_dyn.errors import UsageError
from phantom_dyn.model.robot_files import find_robot

if TYPE_CHECKING:
    import numpy as np


@dataclass
class EffectOptions:
    """An ``--effect`` with the ``--joint`` and ``--set`` options that follow it."""

    effect: str
    joint: str | None = None
    values: dict[str, tuple[float, ...]] = field(default_factory=dict)


class _CollectEffects(argparse.Action):
    """Collects each ``--effect``, with the ``--joint`` and ``--set`` after it, in a list of `EffectOptions`."""

    def __call__(self, _, namespace, values, option_string=None):
        effects = getattr(namespace, self.dest, None) or []
        setattr(namespace, self.dest, effects)
        if option_string == "--effect":
            effects.append(EffectOptions(str(values)))
        elif not effects:
            raise UsageError(f"{option_string} stands before any --effect: name the effect first")
        elif option_string == "--joint":
            if effects[-1].joint is not None:
                raise UsageError(f"--effect {effects[-1].effect} has two joints: give --effect again for the second")
            effects[-1].joint = str(values)
        else:
            for word in values or []:
                name, numbers = _named_values(word)
                if name in effects[-1].values:
                    raise UsageError(f"--set {name} is given twice for {effects[-1].effect}: give it once")
                effects[-1].values[name] = numbers


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn degrade",
        description="Write the log that a cheaper device would have given: the same motion with the torque that it "
        "then takes. --effect, --joint and --set belong together, and may be repeated for several effects.",
        examples=(
            "degrade robot.urdf log.csv --effect backlash --joint j2 --set gap=0.002 --out cheap.csv",
            "degrade emps emps.csv --effect cogging --joint axis --set order=40 amplitude=2 phase=0 --out cheap.csv",
        ),
    )
    add_robot(out)
    out.add_argument("log", metavar="LOG", help="CSV, Parquet, NPZ, ROS bag or MCAP")
    add_effect_option = partial(out.add_argument, action=_CollectEffects, dest="effects", default=None)
    add_effect_option("--effect", metavar="NAME", help="effect to add, such as coulomb_friction")
    add_effect_option("--joint", metavar="J", help="its joint; J1+J2 for a coupling; none for the whole robot")
    add_effect_option("--set", metavar="NAME=VALUE", nargs="+", help="its parameters; lists are separated by commas")
    add_effects(out)
    out.add_argument("--out", metavar="LOG2", type=Path, required=True, help="CSV, NPZ or Parquet to write, by ending")
    add_reading(out)
    return out


def run(arguments: argparse.Namespace) -> int:
    """Write the changed log, and print the root mean square change of each column."""
    one_blas_thread()
    if not arguments.effects:
        raise UsageError("no --effect was given, wanted at least one; see phantom-dyn degrade --help")
    require_not_swapped(arguments.robot, [arguments.log])
    find_robot(arguments.robot)
    require_existing(arguments.log)
    expand_one_episode(arguments)
    if arguments.out.exists() and Path(arguments.log).exists() and arguments.out.samefile(arguments.log):
        raise UsageError(
            f"--out {arguments.out} is the LOG itself: name another file, as the recording is not overwritten"
        )
    require_ending(arguments.out)
    require_writable(arguments.out, "--out")
    require_new_log(arguments.out, "--out")
    from identification.data.readers.read_table import read_table
    from identification.data.reading import recording
    from identification.degrade.degraded_log import degradation, degrade
    from identification.export.log_and_map_files import write_log

    robot = robot_with_effects(arguments)
    faults = tuple(degradation(robot, given.effect, given.joint, given.values) for given in arguments.effects)
    table = read_table(
        arguments.log,
        columns=arguments.columns,
        topic=arguments.topic,
        ref_topic=arguments.ref_topic,
        joints=robot.joint_names,
        other_joints=(*robot.passive_names, *robot.locked),
    )
    result = degrade(robot, table, recording(table, robot), faults)
    write_log(arguments.out, result.columns)
    for note in (*table.warnings, *result.notes):
        say(f"note: {note}")
    for line in _changes(table.columns, result.columns):
        say(line)
    say(f"wrote {arguments.out}")
    return DONE


def _changes(before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray]) -> list[str]:
    """One line for each changed column, with the root mean square of its change."""
    import numpy as np

    changed = {name: values - before[name] for name, values in after.items() if np.any(values != before[name])}
    if not changed:
        return ["no column is changed"]
    return [f"{name} changed by {np.sqrt(np.mean(values**2)):.4g} rms" for name, values in changed.items()]


def _named_values(word: str) -> tuple[str, tuple[float, ...]]:
    """Name and values of ``name=value`` or ``name=value,value``."""
    name, equals, text = word.partition("=")
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if not (name and equals and numbers):
        raise UsageError(f"--set {word} was given, wanted name=value such as torque=0.3") from None
    return name, numbers
