"""Reads YAML files of users and refuses repeated keys, empty values, infinite numbers and values of a wrong kind."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from yaml.reader import ReaderError

from phantom_dyn.errors import ParameterError, PhantomDynError, known_names, shortened
from phantom_dyn.model.files.plain_file import require_plain_file
from phantom_dyn.model.files.strict_yaml import load_yaml

LARGEST = 1e12
"""Largest number in SI units, far beyond any robot; its square does not overflow."""
# Largest size of a settings file [bytes]. Such a file takes half a minute to read; real files have a hundredth of this.
_LARGEST = 5_000_000


def read_settings(path: Path, error: type[PhantomDynError]) -> dict[str, Any]:
    """The mapping in a YAML file; an empty file gives an empty mapping.

    Args:
        path: The file.
        error: Type of the error to raise.

    Raises:
        PhantomDynError: An error of type ``error``, if the file cannot be read, is broken, is no mapping, or a value is
            empty, infinite or NaN.
    """
    content = load_mapping(path, error)
    _require_values(content, "", path, error)
    return content


def load_mapping(path: Path, error: type[PhantomDynError]) -> dict[str, Any]:
    """The mapping in a YAML file, as `read_settings`, but values may be null, infinite or NaN.

    Raises:
        PhantomDynError: An error of type ``error``, if the file cannot be read, is broken, or is no mapping.
    """
    require_plain_file(path, error, "a YAML file")
    try:
        size = path.stat().st_size
        if size > _LARGEST:
            raise error(f"{path} has {size / 1e6:.0f} MB, wanted a YAML file of at most {_LARGEST / 1e6:.0f} MB.")
        text = path.read_text(encoding="utf-8")
    except OSError as problem:
        raise error(f"{path} cannot be read ({problem.strerror}): give a YAML file.") from problem
    except UnicodeDecodeError as problem:
        raise error(f"{path} is not a text file: give a YAML file in UTF-8.") from problem
    try:
        content = load_yaml(text)
    except yaml.YAMLError as problem:
        raise error(f"{path} is not valid YAML{_position(problem)}: correct it there.") from problem
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise error(f"{path} holds {describe(content)}, wanted keys with values such as `key: value`.")
    return content


def describe(value: Any) -> str:
    """Words for a value in a message: its kind if it is a text or a list, and the value, shortened if it is long."""
    if isinstance(value, str):
        return f"the text {shortened(value)!r}"
    if isinstance(value, bool):
        return "true" if value else "false"
    return f"the list {shortened(str(value))}" if isinstance(value, list) else shortened(str(value))


def _position(problem: yaml.YAMLError) -> str:
    """Place of a YAML error in words; empty if it is not known."""
    if isinstance(problem, ReaderError):
        letter = problem.character if isinstance(problem.character, int) else ord(problem.character)
        return f" at character {problem.position + 1} (U+{letter:04X}, which no text holds)"
    if not isinstance(problem, yaml.MarkedYAMLError) or problem.problem_mark is None:
        return ""
    return f" at line {problem.problem_mark.line + 1} ({problem.problem})"


def _require_values(value: Any, key: str, path: Path, error: type[PhantomDynError]) -> None:
    """Refuse empty values and numbers that are not finite, at any depth."""
    if value is None:
        raise error(f"{path}: {key} is empty: give a value or remove the key.")
    if isinstance(value, float) and not math.isfinite(value):
        raise error(f"{path}: {key} is {value}, wanted a finite number.")
    if isinstance(value, dict):
        for name, item in value.items():
            word = shortened(str(name))
            _require_values(item, f"{key}.{word}" if key else word, path, error)
    if isinstance(value, list):
        for index, item in enumerate(value):
            _require_values(item, f"{key}[{index}]", path, error)


def mapping_at(value: Any, file: str, key: str, wanted: tuple[str, ...] | None) -> Mapping[str, Any]:
    """The value, if it is a mapping with exactly the ``wanted`` keys; None allows any keys that are text.

    Raises:
        ParameterError: If the value is no mapping, or a key is missing or unknown.
    """
    if not isinstance(value, Mapping):
        known = f" with the keys {', '.join(wanted)}" if wanted else ""
        raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a mapping{known}.")
    for name in value:
        if not isinstance(name, str):
            raise ParameterError(
                f"{file}: the key {shortened(str(name))} in {key or 'the file'} is no text: put it in quotes."
            )
    if wanted is not None:
        _check_keys(value, file, key, wanted)
    return value


def _check_keys(value: Mapping[str, Any], file: str, key: str, wanted: tuple[str, ...]) -> None:
    """Refuse a mapping with an unknown key, or without one of the ``wanted`` keys."""
    inside = f" in {key}" if key else ""
    for name in value:
        if name not in wanted:
            raise ParameterError(
                f"{file}: there is no key {shortened(name)}{inside}, {known_names(name, wanted, 'keys')}"
            )
    for name in wanted:
        if name not in value:
            raise ParameterError(f"{file}: the key {name} is missing{inside}, wanted {', '.join(wanted)}.")


def list_at(value: Any, file: str, key: str) -> list[Any]:
    """The value, if it is a list.

    Raises:
        ParameterError: If the value is no list.
    """
    if not isinstance(value, list):
        raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a list (an empty one is []).")
    return value


def text_at(value: Any, file: str, key: str) -> str:
    """The value, if it is a text.

    Raises:
        ParameterError: If the value is no text.
    """
    if not isinstance(value, str):
        raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a text: put it in quotes.")
    return value


def number_at(value: Any, file: str, key: str, *, unknown: bool = False, most: float = math.inf) -> float:
    """The value, if it is a finite number with a magnitude of at most ``most``; NaN for null if ``unknown`` is True.

    Raises:
        ParameterError: If the value is anything else.
    """
    if value is None and unknown:
        return math.nan
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        if abs(value) > most:
            raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a number within {most:g}: use SI units.")
        return float(value)
    raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a finite number{' or null' if unknown else ''}.")
