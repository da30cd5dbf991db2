"""Checks of values in YAML that users may have edited: each refusal names file, key, value and what was wanted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from phantom_dyn.errors import ParameterError, known_names
from phantom_dyn.model.settings_file import describe


def mapping_at(value: Any, file: str, key: str, wanted: tuple[str, ...] | None) -> Mapping[str, Any]:
    """A mapping with exactly the `wanted` keys, or with any keys that are text for None.

    Raises:
        ParameterError: If it is no mapping, or a key is missing or unknown.
    """
    if not isinstance(value, Mapping):
        known = f" with the keys {', '.join(wanted)}" if wanted else ""
        raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a mapping{known}.")
    for name in value:
        if not isinstance(name, str):
            raise ParameterError(f"{file}: the key {name} in {key or 'the file'} is no text: put it in quotes.")
    if wanted is not None:
        _check_keys(value, file, key, wanted)
    return value


def _check_keys(value: Mapping[str, Any], file: str, key: str, wanted: tuple[str, ...]) -> None:
    place = f" in {key}" if key else ""
    for name in value:
        if name not in wanted:
            raise ParameterError(f"{file}: there is no key {name}{place}, {known_names(name, wanted, 'keys')}")
    for name in wanted:
        if name not in value:
            raise ParameterError(f"{file}: the key {name} is missing{place}, wanted {', '.join(wanted)}.")


def list_at(value: Any, file: str, key: str) -> list[Any]:
    """A list.

    Raises:
        ParameterError: If the value is something else.
    """
    if not isinstance(value, list):
        raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a list (an empty one is []).")
    return value


def text_at(value: Any, file: str, key: str) -> str:
    """A text.

    Raises:
        ParameterError: If the value is something else.
    """
    if not isinstance(value, str):
        raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a text: put it in quotes.")
    return value


def number_at(value: Any, file: str, key: str, *, unknown: bool = False) -> float:
    """A finite number; with `unknown` also null, which is read as NaN.

    Raises:
        ParameterError: If the value is something else.
    """
    if value is None and unknown:
        return math.nan
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a finite number{' or null' if unknown else ''}.")
