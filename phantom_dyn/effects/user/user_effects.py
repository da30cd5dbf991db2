"""Adds effects of a user to a robot: from a Python file, from classes, and from installed packages.

They are stored in the robot (`Robot.user_effects`), so that every process with the robot, also a worker on another
machine, has the same effects. A file is run as a Python module that cannot be imported; its classes are pickled by
value for workers.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.user.trial import tried
from phantom_dyn.errors import EffectError
from phantom_dyn.model.files.plain_file import require_plain_file
from phantom_dyn.model.robot import Robot

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "phantom_dyn.effects"
"""Group of entry points by which an installed package offers effects."""

EffectsLike = str | Path | Effect | type[Effect] | Iterable[str | Path | Effect | type[Effect]]
"""Effects as a user may give them: the path of a Python file, classes or instances; one or several."""

# Origin of an effect (file, class or package, with which messages begin), and its class or the effect itself.
_Offered = tuple[str, Effect | type[Effect]]


def with_user_effects(robot: Robot, given: EffectsLike = ()) -> Robot:
    """The robot with additional effects: those of installed packages, and those that are given.

    Args:
        robot: The robot; effects that it already has are kept.
        given: Paths of files, classes or instances.

    Raises:
        EffectError: If an effect cannot be used; the message says its origin, the reason and what to do.
    """
    known = {effect.name: "the catalogue has" for effect in EFFECTS}
    known |= {effect.name: "the robot has" for effect in robot.user_effects}
    in_robot = {effect.name for effect in robot.user_effects}
    installed = [(origin, effect) for origin, effect in _installed() if getattr(effect, "name", "") not in in_robot]
    out: list[Effect] = []
    for origin, offered in (*installed, *_given(given)):
        effect = tried(_made(offered, origin), robot, origin)
        if effect.name in known:
            raise EffectError(
                f"{origin} has the name {effect.name}, which {known[effect.name]} already: give it another name."
            )
        known[effect.name] = f"{origin} brings"
        out.append(effect)
    return replace(robot, user_effects=(*robot.user_effects, *out)) if out else robot


def effects_in(path: str | Path) -> tuple[_Offered, ...]:
    """The classes of effects that a Python file defines, each with its origin.

    Raises:
        EffectError: If the file cannot be read or run, or defines no effect.
    """
    file = Path(path)
    require_plain_file(file, EffectError, "a Python file with classes of effects")
    try:
        code = compile(file.read_bytes(), str(file), "exec")
    except OSError as error:
        raise EffectError(
            f"{file} cannot be read ({error.strerror}), wanted a Python file with classes of effects: correct the path."
        ) from error
    except (SyntaxError, ValueError) as error:
        line = f" in line {error.lineno}" if isinstance(error, SyntaxError) and error.lineno else ""
        raise EffectError(
            f"{file} is no Python ({type(error).__name__}{line}: {getattr(error, 'msg', error)}), wanted a file with "
            "classes of effects: correct it."
        ) from error
    module = _run(file, code)
    own = [
        one
        for one in vars(module).values()
        if inspect.isclass(one) and issubclass(one, Effect) and one.__module__ == module.__name__
    ]
    bases = {base for one in own for base in one.__mro__[1:]}
    offered = tuple((f"{file}: class {one.__name__}", one) for one in own if one not in bases)
    if not offered:
        raise EffectError(
            f"{file} defines no effect, wanted a class of LawEffect or Effect from phantom_dyn.effects.author: write "
            "one."
        )
    return offered


def _run(file: Path, code: Any) -> ModuleType:
    """Run a file, and return its module; while it runs it is in ``sys.modules``, where dataclasses look it up."""
    module = ModuleType(f"effects of {file}")
    module.__file__ = str(file)
    sys.modules[module.__name__] = module
    try:
        exec(code, vars(module))
    except (Exception, SystemExit) as error:
        raise EffectError(
            f"{file} cannot be run ({type(error).__name__}: {error}){_line(error, file)}, wanted classes of effects: "
            "correct it."
        ) from error
    finally:
        del sys.modules[module.__name__]
    return module


def _line(error: BaseException, file: Path) -> str:
    """Number of the last line of the file in the traceback of an error, in words, as `` in line 3``."""
    line, entry = None, error.__traceback__
    while entry is not None:
        line = entry.tb_lineno if entry.tb_frame.f_code.co_filename == str(file) else line
        entry = entry.tb_next
    return "" if line is None else f" in line {line}"


def _given(given: object) -> Iterator[_Offered]:
    """Effects given by a user, one by one, with their origins."""
    if isinstance(given, str | Path):
        yield from effects_in(given)
    elif isinstance(given, Effect):
        yield f"class {type(given).__name__}", given
    elif inspect.isclass(given):
        yield f"class {given.__name__}", cast("type[Effect]", given)
    elif isinstance(given, Iterable):
        for one in given:
            yield from _given(one)
    else:
        raise EffectError(
            f"{given!r} was given as an effect, wanted the path of a Python file, a class or an instance."
        )


def _installed() -> Iterator[_Offered]:
    """Effects of installed packages, with their origins."""
    from importlib.metadata import entry_points

    for point in entry_points(group=GROUP):
        origin = _origin(point)
        try:
            found = point.load()
        except Exception as error:
            raise EffectError(
                f"{origin} cannot be loaded ({type(error).__name__}: {error}): mend or uninstall that package."
            ) from error
        for one in found if isinstance(found, list | tuple) else (found,):
            if not (isinstance(one, Effect) or (inspect.isclass(one) and issubclass(one, Effect))):
                raise EffectError(
                    f"{origin} offers {one!r}, wanted a class of LawEffect or Effect, or several in a tuple: mend or "
                    "uninstall that package."
                )
            yield origin, one


def _origin(point: EntryPoint) -> str:
    package = "" if point.dist is None else f" of the package {point.dist.name}"
    return f"The plug-in {point.name}{package}"


def _made(offered: Effect | type[Effect], origin: str) -> Effect:
    """An instance of the offered class, or the offered instance itself.

    Raises:
        EffectError: If the class is not an effect, is not complete, or needs arguments.
    """
    if isinstance(offered, Effect):
        return offered
    if not issubclass(offered, Effect):
        raise EffectError(
            f"{origin} is no effect, wanted a class of LawEffect or Effect from phantom_dyn.effects.author."
        )
    lacking = sorted(getattr(offered, "__abstractmethods__", ()))
    if lacking:
        raise EffectError(f"{origin} lacks {', '.join(lacking)}: write {'it' if len(lacking) == 1 else 'them'}.")
    try:
        return offered()
    except Exception as error:
        raise EffectError(
            f"{origin} cannot be made ({type(error).__name__}: {error}), wanted a class that takes no arguments: "
            "correct it, or give an instance."
        ) from error
