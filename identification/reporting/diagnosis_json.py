"""The diagnosis as ``diagnosis.json`` (schema ``gap-diagnosis/1``)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from identification.diagnosis.result import Diagnosis, EffectAt, Finding, Rival, Unexplained

SCHEMA = "gap-diagnosis/1"

Json = dict[str, "Json"] | list["Json"] | str | float | int | bool | None


def to_json(diagnosis: Diagnosis) -> dict[str, Json]:
    """The content of ``diagnosis.json``: plain types, nothing rounded, null where a number is not finite."""
    return {
        "schema": SCHEMA,
        "verdict": diagnosis.verdict,
        "joints": [_plain(asdict(joint)) for joint in diagnosis.joints],
        "band_hz": _plain(diagnosis.band_hz),
        "findings": [_finding(finding) for finding in diagnosis.findings],
        "adjusted": [_plain(asdict(adjusted)) for adjusted in diagnosis.adjusted],
        "unexplained": _unexplained(diagnosis.unexplained),
        "bounds": [_plain(asdict(bound)) for bound in diagnosis.bounds],
        "not_testable": [_plain(asdict(entry)) for entry in diagnosis.not_testable],
        "data_warnings": _plain(diagnosis.data_warnings),
        "next_experiment": _plain(diagnosis.next_experiment),
        "rollout": _plain(diagnosis.rollout),
        "seconds": _plain(diagnosis.seconds),
        "version": diagnosis.version,
    }


def json_text(diagnosis: Diagnosis) -> str:
    """The text of ``diagnosis.json``, ending in a newline."""
    return json.dumps(to_json(diagnosis), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _finding(finding: Finding) -> Json:
    return {
        "effect": finding.effect,
        "joint": finding.joint,
        "regime": finding.regime,
        "parameters": {name: _plain(asdict(value)) for name, value in finding.parameters.items()},
        "gap_closed": _plain(finding.gap_closed),
        "gap_closed_interval": _plain(finding.gap_closed_interval),
        "probability": _plain(finding.probability),
        "rivals": [_rival(rival) for rival in finding.rivals],
        "verdict": finding.verdict,
    } | ({} if finding.recording is None else {"recording": finding.recording})


def _rival(rival: Rival) -> Json:
    return {"effects": [_effect_at(at) for at in rival.effects], "probability": _plain(rival.probability)}


def _effect_at(at: EffectAt) -> Json:
    return {"effect": at.effect, "joint": at.joint} | ({} if at.recording is None else {"recording": at.recording})


def _unexplained(rest: Unexplained) -> Json:
    return {
        "fraction_of_explainable": _plain(rest.fraction_of_explainable),
        "structured": _plain(rest.structured),
        "where": {"joint": rest.joint, "regime": rest.regime},
    }


def _plain(value: object) -> Json:
    """Plain JSON types; a number that is not finite becomes null, because JSON has no word for it."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(entry) for entry in value]
    raise TypeError(f"a diagnosis holds no {type(value).__name__}")
