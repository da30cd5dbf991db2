"""Pages of the documentation that are written from the code: effects, help of the commands, keys of the files."""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from collections.abc import Iterable
from pathlib import Path

import msgspec
import numpy as np
from effect_figures import ARM, shown_sizes, write_figures

from identification.cli.main import COMMANDS
from identification.data.change_kinds import KINDS
from identification.data.readers.column_map import WHOLE_KEYS
from identification.data.readers.contract_columns import ALONE, FRAME_AXES, FRAME_FLAGS, UNITS
from identification.data.readers.map_source import ENTRY_KEYS
from identification.scenarios.recordings_file import CONTROLLER_KEYS, PAYLOAD_KEYS, RECORDING_KEYS
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.model import robot_config
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_config import wanted_value


def write_pages(folder: Path) -> None:
    """Write all generated pages into a folder, made where it is missing."""
    folder.mkdir(exist_ok=True)
    (folder / "effects.rst").write_text(effects_page())
    write_figures(folder, EFFECTS)
    (folder / "commands.rst").write_text(commands_page())
    (folder / "keys.rst").write_text(keys_page())


def effects_page() -> str:
    """Every effect in the catalogue's order: its law as its module states it, its parameters and their ranges."""
    robot = load_robot(ARM)
    lead = (
        "From the catalogue of this version. Ranges are those of the first place on the arm of the first diagnosis, "
        "which weighs some kilograms and whose drives give 12 to 20 N m; where they depend on the model, as friction "
        "that cannot be less than none, another robot has others.\n\n"
        "The figure of an effect is drawn by its own law, on an elbow that swings along a sine: what it leaves beyond "
        "the model over velocity, position and time, with the sizes below it."
    )
    parts = (_table(EFFECTS, robot), *(_effect(effect, robot) for effect in EFFECTS))
    return "\n".join([_heading("All effects", "="), lead, "", *parts])


def _table(effects: tuple[Effect, ...], robot: Robot) -> str:
    """Name, law and parameters of each effect, a row each."""
    lines = [".. list-table::", "   :header-rows: 1", "", "   * - effect", "     - what it is", "     - parameters"]
    for effect in effects:
        known = effect.parameters(robot, effect.places(robot)[0])
        names = "by name" if effect.inertial == "free" else ", ".join(f"``{one.name}``" for one in known)
        lists = ": lists" if any(one.listed for one in known) else ""
        lines += [f"   * - `{effect.name}`_", f"     - {_law(effect).splitlines()[0]}", f"     - {names}{lists}"]
    return "\n".join([*lines, ""])


def _law(effect: Effect) -> str:
    """The text of the effect's module; its first line says what the effect is."""
    return inspect.getdoc(sys.modules[type(effect).__module__]) or ""


def _effect(effect: Effect, robot: Robot) -> str:
    lines = [_heading(effect.name, "-"), _law(effect), ""]
    lines += [f".. figure:: effect_{effect.name}.svg", f"   :alt: {effect.name} over velocity, position, time", ""]
    lines += [f"   {shown_sizes(effect)}", ""]
    place = effect.places(robot)[0]
    # Inertial parameters are ten a body, with one range each kind.
    shown = effect.parameters(robot, place)[:10]
    lines += [".. list-table::", "   :header-rows: 1", "", "   * - parameter", "     - unit", "     - possible"]
    lines += ["     - plausible", "     - why"]
    for parameter in shown:
        lines += [
            f"   * - ``{parameter.name}``",
            f"     - {parameter.unit if parameter.unit != '1' else 'none'}",
            f"     - {_range(parameter.lower, parameter.upper)}",
            f"     - {_plausible(parameter)}",
            f"     - {parameter.plausible_because or 'nothing can be said'}",
        ]
    return "\n".join([*lines, "", f"Next step: {effect.words.next_step}", ""])


def _plausible(parameter: Parameter) -> str:
    return "any" if parameter.plausible is None else _range(*parameter.plausible)


def _range(low: float, high: float) -> str:
    if np.isfinite(low) and np.isfinite(high):
        return f"{low:.4g} to {high:.4g}"
    if np.isfinite(low):
        return f"{low:.4g} or more"
    return f"{high:.4g} or less" if np.isfinite(high) else "any"


def commands_page() -> str:
    """The help of every command, as the terminal shows it."""
    lines = [_heading("Every command", "=")]
    # argparse wraps to the width of the terminal that builds the pages.
    width, os.environ["COLUMNS"] = os.environ.get("COLUMNS"), "100"
    try:
        for name, (module, _) in COMMANDS.items():
            text = importlib.import_module(module).parser().format_help()
            lines += [_heading(f"phantom-dyn {name}", "-"), "::", ""]
            lines += [f"   {line}".rstrip() for line in text.splitlines()] + [""]
    finally:
        if width is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = width
    return "\n".join(lines)


ROBOT_TABLES = {
    "robot.yaml": robot_config.RobotConfig,
    "tolerance": robot_config.ToleranceConfig,
    "joints: each": robot_config.JointConfig,
    "controller": robot_config.ControllerConfig,
    "loops: kind linear": robot_config.LinearLoop,
    "loops: kind point": robot_config.PointLoop,
    "loops: kind frame": robot_config.FrameLoop,
}
"""Tables of a ``robot.yaml`` by their place in it."""


def keys_page() -> str:
    """Every column of a log with its units, and every key of the YAML files, as their readers have them."""
    lead = "From the readers of this version; :doc:`/files` says what each of them means."
    parts = [_heading("Every key, its values and units", "="), lead, ""]
    parts += [_heading("Columns of a log", "-"), *_rows(("column", "units"), _columns())]
    entries = [("entry of one column", ENTRY_KEYS), ("whole map", WHOLE_KEYS)]
    parts += [_heading("Column map", "-"), *_rows(("of", "keys"), [(of, _names(keys)) for of, keys in entries])]
    recordings = [("entry of recordings", RECORDING_KEYS), ("payload", PAYLOAD_KEYS), ("controller", CONTROLLER_KEYS)]
    recordings += [("changed: one or more of", KINDS)]
    parts += [_heading("recordings.yaml", "-"), *_rows(("of", "keys"), [(of, _names(k)) for of, k in recordings])]
    for place, struct in ROBOT_TABLES.items():
        parts += [_heading(place, "-"), *_rows(("key", "value", "default"), _fields(struct))]
    return "\n".join(parts)


def _columns() -> list[tuple[str, str]]:
    """Names of a log's columns, each with the units that a column map may state; the first is that of the log."""
    out = []
    for quantity, units in UNITS.items():
        if quantity in ALONE:
            names = [quantity]
        elif quantity in FRAME_AXES:
            names = [f"{quantity}.<frame>.{axis}" for axis in FRAME_AXES[quantity]]
        else:
            names = [f"{quantity}.<{'frame' if quantity in FRAME_FLAGS else 'joint'}>"]
        out.append((_names(names), _names(unit for unit in units if unit != "1") or "none"))
    return out


def _fields(struct: type[msgspec.Struct]) -> list[tuple[str, str, str]]:
    """Keys of a table of ``robot.yaml``, what each takes, and its default."""
    out = []
    for field in msgspec.structs.fields(struct):
        plain = isinstance(field.default, bool | int | float | str)
        default = "required" if field.required else str(field.default).lower() if plain else "none"
        out.append((f"``{field.name}``", wanted_value(struct, [field.name]), default))
    return out


def _rows(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """A table of reStructuredText."""
    lines = [".. list-table::", "   :header-rows: 1", ""]
    for row in (head, *rows):
        lines += [f"   {'* -' if k == 0 else '  -'} {cell}" for k, cell in enumerate(row)]
    return [*lines, ""]


def _names(names: Iterable[str]) -> str:
    return ", ".join(f"``{name}``" for name in names)


def _heading(text: str, mark: str) -> str:
    return f"{text}\n{mark * len(text)}\n"
