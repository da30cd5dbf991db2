"""What a tool hands in for a case: checked against the schema, one sentence for each fault, and made ready to judge."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from functools import cache
from math import inf, isfinite, nan
from pathlib import Path

SCHEMA_FILE = Path(__file__).with_name("submission.schema.json")
TYPES = {"object": dict, "array": list, "string": str, "number": (int, float), "null": type(None)}
WORDS = {"object": "an object", "array": "a list", "string": "a text", "number": "a number", "null": "null"}


class AnswerError(Exception):
    """A file that is no answer; each of its arguments is a sentence."""


@cache
def schema() -> dict:
    """The schema of an answer."""
    return json.loads(SCHEMA_FILE.read_text())


def _is(value: object, kind: str) -> bool:
    return isinstance(value, TYPES[kind]) and not isinstance(value, bool)


def _shown(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def faults(value: object, rules: dict | None = None, at: str = "the answer") -> Iterator[str]:
    """One sentence for each fault: where it is, what was given and what is wanted.

    Args:
        value: What JSON holds.
        rules: Part of the schema; only the keywords that the schema uses are known.
        at: Words for the place.
    """
    rules = schema() if rules is None else rules
    if "enum" in rules and value not in rules["enum"]:
        yield f"{at} is {_shown(value)}: give one of {', '.join(map(str, rules['enum']))}."
        return
    kinds = rules.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds and not any(_is(value, kind) for kind in kinds):
        yield f"{at} is {_shown(value)}: give {' or '.join(WORDS[kind] for kind in kinds)}."
        return
    if isinstance(value, dict):
        yield from _faults_of_object(value, rules, at)
    elif isinstance(value, list):
        if len(value) < rules.get("minItems", 0):
            yield f"{at} has no entry: give {rules['minItems']} or more."
        for i, entry in enumerate(value):
            yield from faults(entry, rules.get("items", {}), f"{at}[{i}]")
    elif _is(value, "number"):
        low, high = rules.get("minimum", -inf), rules.get("maximum", inf)
        if not isinstance(value, int | float) or not low <= value <= high or not isfinite(value):
            limits = [f"of {low:g} or more"] * isfinite(low) + [f"of {high:g} or less"] * isfinite(high)
            yield f"{at} is {_shown(value)}: give a finite number{' ' + ' and '.join(limits) if limits else ''}."


def _faults_of_object(value: dict, rules: dict, at: str) -> Iterator[str]:
    where = "" if at == "the answer" else f"{at}."
    for name in rules.get("required", []):
        if name not in value:
            yield f"{at} has no {name}: add it, see {SCHEMA_FILE.name}."
    for name, entry in value.items():
        more = rules.get("properties", {}).get(name, rules.get("additionalProperties"))
        if more is not None:
            yield from faults(entry, more, f"{where}{name}")


def read_answer(path: Path) -> dict:
    """The answer in a file.

    Raises:
        AnswerError: With one sentence for each fault.
    """
    try:
        value = json.loads(path.read_text())
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise AnswerError(f"{path.name} is no JSON ({error}): write one object for each case.") from error
    found = [f"{path.name}: {sentence}" for sentence in faults(value)]
    if found:
        raise AnswerError(*found)
    return value


def in_true_floors(truth: Mapping, joints: list[dict]) -> list[dict]:
    """What is left of each joint's torque beside the noise floor that the case truly has."""
    return [{**j, "noise_floor": floor} for j, floor in zip(joints, truth["noise_floor"], strict=True)]


def ready(truth: dict, answer: dict) -> dict:
    """The answer in the form that the scorer reads, with what may be left out filled in.

    Args:
        truth: What the generator wrote of the case.
        answer: As `read_answer` returns it.

    Raises:
        AnswerError: If the joints are not those of the case.
    """
    joints, names = answer.get("joints") or [], truth["joints"]
    if joints and [j["joint"] for j in joints] != names:
        said = ", ".join(j["joint"] for j in joints)
        raise AnswerError(f"{truth['id']}.json: joints are {said}: give {', '.join(names)} in this order, or none.")
    findings = [{"rivals": [], "parameters": {}, **f} for f in answer["findings"]]
    ranked = all(f.get("gap_closed") is not None for f in findings)
    for place, finding in enumerate(findings):
        finding["gap_closed"] = finding["gap_closed"] if ranked else -place
        if finding.get("probability") is None:
            finding["probability"] = nan
    return {**answer, "findings": findings, "joints": in_true_floors(truth, joints) if joints else []}
