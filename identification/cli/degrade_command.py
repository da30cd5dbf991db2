"""``phantom-dyn degrade``: the log that a cheaper device would have given."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path

from identification.cli.arguments import Parser, add_reading, add_robot, one_blas_thread
from phantom_dyn.errors import UsageError


@dataclass
class Group:
    """One ``--effect`` with what follows it."""

    effect: str
    joint: str | None = None
    values: dict[str, tuple[float, ...]] = field(default_factory=dict)


class _Grouped(argparse.Action):
    """Collects ``--effect``, and the ``--joint`` and ``--set`` behind it, in a list of groups."""

    def __call__(self, parser, namespace, values, option_string=None):
        groups = getattr(namespace, self.dest, None) or []
        setattr(namespace, self.dest, groups)
        if option_string == "--effect":
            groups.append(Group(str(values)))
        elif not groups:
            raise UsageError(f"{option_string} stands before any --effect: name the effect first")
        elif option_string == "--joint":
            if groups[-1].joint is not None:
                raise UsageError(f"--effect {groups[-1].effect} has two joints: give --effect again for the second")
            groups[-1].joint = str(values)
        else:
            for word in values or []:
                name, numbers = _setting(word)
                if name in groups[-1].values:
                    raise UsageError(f"--set {name} is given twice for {groups[-1].effect}: give it once")
                groups[-1].values[name] = numbers


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    out = Parser(
        prog="phantom-dyn degrade",
        description="Write the log that a cheaper device would have given: the same motion, and what it then takes. "
        "--effect, --joint and --set go together, and may be repeated for several effects.",
    )
    add_robot(out)
    out.add_argument("log", metavar="LOG", help="CSV, Parquet, NPZ, ROS bag or MCAP")
    grouped = {"action": _Grouped, "dest": "effects", "default": None}
    out.add_argument("--effect", metavar="NAME", **grouped, help="what the device gets, such as coulomb_friction")
    out.add_argument("--joint", metavar="J", **grouped, help="where; J1+J2 for a coupling; none for the whole robot")
    out.add_argument(
        "--set", metavar="NAME=VALUE", nargs="+", **grouped, help="its parameters; lists are separated by commas"
    )
    out.add_argument("--out", metavar="LOG2", type=Path, required=True, help="CSV, NPZ or Parquet to write, by ending")
    add_reading(out)
    return out


def run(arguments: argparse.Namespace) -> int:
    """Write the log and say what was changed."""
    if not arguments.effects:
        raise UsageError("no --effect was given, wanted at least one; see phantom-dyn degrade --help")
    one_blas_thread()
    from identification.data.readers.read_table import read_table, require_existing
    from phantom_dyn.model.robot_files import find_robot

    find_robot(arguments.robot)
    require_existing(arguments.log)
    if arguments.out.exists() and arguments.out.samefile(arguments.log):
        raise UsageError(f"--out {arguments.out} is the LOG itself: name another file, the recording stays")
    from identification.export.log_and_map_files import require_ending, write_log

    require_ending(arguments.out)
    from identification.data.reading import recording
    from identification.degrade.degradation import degradation
    from identification.degrade.degraded_log import degrade
    from phantom_dyn.model.loading import load_robot

    robot = load_robot(arguments.robot, config=arguments.robot_config)
    faults = tuple(degradation(robot, group.effect, group.joint, group.values) for group in arguments.effects)
    table = read_table(arguments.log, columns=arguments.columns, topic=arguments.topic)
    result = degrade(robot, table, recording(table, robot), faults)
    write_log(arguments.out, result.columns)
    for note in (*table.warnings, *result.notes):
        print(f"note: {note}")
    for line in _changes(table.columns, result.columns):
        print(line)
    print(f"wrote {arguments.out}")
    return 0


def _changes(before, after) -> list[str]:
    """Root mean square of what was changed, column by column."""
    import numpy as np

    changed = {name: values - before[name] for name, values in after.items() if np.any(values != before[name])}
    if not changed:
        return ["no column is changed"]
    return [f"{name} changed by {np.sqrt(np.mean(values**2)):.4g} rms" for name, values in changed.items()]


def _setting(word: str) -> tuple[str, tuple[float, ...]]:
    """``name=value``, or ``name=value,value`` for a list."""
    name, equals, text = word.partition("=")
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if not (name and equals and numbers):
        raise UsageError(f"--set {word} was given, wanted name=value such as torque=0.3") from None
    return name, numbers
