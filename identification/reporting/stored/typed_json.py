"""Builds dataclasses and other annotated types from the plain data of a JSON file.

The message of an error states the position of the wrong data in the file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

_LARGEST = 1e150
"""Largest number that is accepted, so that its square, which intervals need, is still finite."""


def from_json(kind: Any, data: Any, at: str = "$") -> Any:
    """Builds an object of a type from plain JSON data; null for a float becomes NaN.

    Args:
        kind: Type: a dataclass, number, str, bool, tuple, list, mapping or literal, or a union of these.
        data: Plain data; an object that already is of the dataclass is returned unchanged.
        at: Position of the data in the file, for the message.

    Raises:
        ValueError: If the data is of another type, or a key is missing or unknown.
    """
    plain, parts = get_origin(kind) or kind, get_args(kind)
    if kind is float:
        return _number(data, at)
    if plain in (Union, UnionType):
        return _one_of(parts, data, at)
    if plain is Literal:
        return data if data in parts else _refuse(f"one of {', '.join(map(str, parts))}", data, at)
    if is_dataclass(plain):
        return data if type(data) is plain else _object(plain, parts, data, at)
    if plain in (tuple, list):
        return plain(_entries(parts, data, at))
    if issubclass(plain, Mapping):
        pairs = data.items() if isinstance(data, dict) else _refuse("object", data, at)
        return {key: from_json(parts[1], value, f"{at}.{key}") if parts else value for key, value in pairs}
    # ``isinstance`` would accept true and false as integers.
    return data if type(data) is plain else _refuse(plain.__name__, data, at)


def _number(data: Any, at: str) -> float:
    """A float; NaN for null."""
    if data is None:
        return math.nan
    if type(data) not in (int, float):
        _refuse("float", data, at)
    if not abs(data) <= _LARGEST:
        raise ValueError(f"Expected a number of at most {_LARGEST:g} - at {at}")
    return float(data)


def _one_of(kinds: tuple[Any, ...], data: Any, at: str) -> Any:
    """An object of the first type in a union that fits the data."""
    if data is None and NoneType in kinds:
        return None
    *others, last = (kind for kind in kinds if kind is not NoneType)
    for kind in others:
        try:
            return from_json(kind, data, at)
        except ValueError:
            continue
    return from_json(last, data, at)


def _object(kind: Any, parameters: tuple[Any, ...], data: Any, at: str) -> Any:
    """An object of a dataclass; ``parameters`` are the types for its type variables."""
    known = fields(kind)
    if not isinstance(data, dict):
        _refuse("object", data, at)
    if unknown := set(data) - {one.name for one in known}:
        raise ValueError(f"Unknown key {min(unknown)} - at {at}")
    required = {one.name for one in known if one.default is MISSING and one.default_factory is MISSING}
    if missing := required - set(data):
        raise ValueError(f"Missing key {min(missing)} - at {at}")
    hints = _hints(kind)
    types = {
        name: hints[name][parameters] if getattr(hints[name], "__parameters__", ()) else hints[name] for name in data
    }
    return kind(**{name: from_json(types[name], value, f"{at}.{name}") for name, value in data.items()})


def _entries(parts: tuple[Any, ...], data: Any, at: str) -> list[Any]:
    """Entries of a list or tuple; ``parts`` has a type for each, or one for all, as ``float`` or ``float, ...``."""
    if not isinstance(data, list | tuple):
        _refuse("array", data, at)
    kinds = parts if len(parts) > 1 and parts[-1] is not Ellipsis else parts[:1] * len(data)
    if len(kinds) != len(data):
        raise ValueError(f"Expected {len(kinds)} entries, got {len(data)} - at {at}")
    return [from_json(kind, entry, f"{at}[{k}]") for k, (kind, entry) in enumerate(zip(kinds, data, strict=True))]


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _refuse(wanted: str, data: Any, at: str) -> Any:
    raise ValueError(f"Expected {wanted}, got {type(data).__name__} - at {at}")
