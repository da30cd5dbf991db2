"""Checks the arguments of public functions before a function runs, and describes allowed values in messages."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from numbers import Integral, Real
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np

from phantom_dyn.errors import UsageError

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Kind:
    """Allowed values of an argument.

    Attributes:
        wanted: Description of allowed values, with which a message ends.
        allows: Function that returns True for an allowed value.
    """

    wanted: str
    allows: Callable[[object], bool]


def path_of(what: str) -> Kind:
    """Kind of an argument that is a path or the name of a built-in file; ``what`` describes it."""
    return Kind(what, lambda given: isinstance(given, str | Path))


def or_none(kind: Kind) -> Kind:
    """The same kind, with None allowed."""
    return Kind(f"{kind.wanted}, or None", lambda given: given is None or kind.allows(given))


def parts_of(given: object) -> tuple[object, ...] | None:
    """Elements of a list or another iterable; None for any other object, and for a text, table or dictionary."""
    if isinstance(given, Iterable) and not isinstance(given, str | bytes) and not hasattr(given, "keys"):
        return tuple(given)
    return None


def _is_number(given: object) -> bool:
    return isinstance(given, Real) and not isinstance(given, bool)


def _is_text(given: object) -> bool:
    return isinstance(given, str)


def _are_numbers(given: object) -> bool:
    parts = parts_of(given)
    return all(map(_is_number, (given,) if parts is None else parts))


def _are_names(given: object) -> bool:
    return isinstance(given, str) or (isinstance(given, list | tuple) and all(map(_is_text, given)))


def _are_stretches(given: object) -> bool:
    if not isinstance(given, list | tuple | np.ndarray):
        return False
    return all(isinstance(one, list | tuple | np.ndarray) and len(one) == 2 and _are_numbers(one) for one in given)


def _is_whole(given: object) -> bool:
    return isinstance(given, Integral) and not isinstance(given, bool)


def _is_seed(given: object) -> bool:
    return isinstance(given, Integral) and _is_whole(given) and int(given) >= 0


NUMBER = Kind("a number", _is_number)
WHOLE = Kind("a whole number", _is_whole)
SEED = Kind("a whole number of 0 or more", _is_seed)
FLAG = Kind("True or False", lambda given: isinstance(given, bool | np.bool_))
TEXT = Kind("a text", _is_text)
NAMES = Kind("a name or a list of names", _are_names)
NUMBERS = Kind("a number or a list of numbers", _are_numbers)
STRETCHES = Kind("a list of starts and ends such as [(0, 1.5)]", _are_stretches)
TEXT_CALLBACK = Kind("a function that takes a text, such as print", callable)
FILE = path_of("the path of a file")
FOLDER = path_of("the path of a folder")


def takes(**kinds: Kind) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator that makes a function raise a `UsageError` for an argument of the wrong kind.

    Args:
        kinds: Allowed values of each argument, by its name. Other arguments are not checked.
    """

    def checking(function: Callable[P, R]) -> Callable[P, R]:
        signature = inspect.signature(function)

        @functools.wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            given = signature.bind(*args, **kwargs).arguments
            for name, kind in kinds.items():
                if name in given and not kind.allows(given[name]):
                    raise UsageError(f"{described(given[name])} was given as {name}, wanted {kind.wanted}.")
            return function(*args, **kwargs)

        return checked

    return checking


def described(given: object) -> str:
    """Description of an argument, short enough for a message."""
    text = " ".join(repr(given).split())
    kind = type(given).__name__
    return f"{text if len(text) <= 40 else text[:39] + '…'} ({kind})"
