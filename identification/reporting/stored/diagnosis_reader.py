"""Reads a diagnosis from its ``diagnosis.json`` (schema ``gap-diagnosis/3`` or ``2``), which has no samples."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import (
    Adjusted,
    Bound,
    Diagnosis,
    EffectAt,
    Finding,
    Gap,
    JointGap,
    NotTestable,
    Unexplained,
)
from identification.diagnosis.written import WrittenFile
from identification.engine.claims import Claim
from identification.geometry.result import GeometryResult
from identification.reporting.stored.built import built
from identification.reporting.stored.diagnosis_files import DEPENDENCE_KEYS, INDEX, SCHEMA
from identification.reporting.stored.geometry_json import geometry_of, is_of_poses
from identification.words.effect_words import shown_as
from phantom_dyn.errors import LogError, shortened
from phantom_dyn.model.files.plain_file import require_plain_file

FILE = INDEX
OLDER = ("gap-diagnosis/2",)
"""Schemas of earlier versions that can be read too."""


@dataclass(frozen=True)
class _Document:
    """Fields of a diagnosis that its file contains."""

    schema: str
    verdict: str
    run: str
    gap: Gap
    joints: tuple[JointGap, ...]
    band_hz: tuple[float, float]
    findings: tuple[Finding, ...]
    minor: tuple[Finding, ...]
    adjusted: tuple[Adjusted, ...]
    unexplained: Unexplained
    bounds: tuple[Bound, ...]
    not_testable: tuple[NotTestable, ...]
    data_warnings: tuple[str, ...]
    next_experiment: dict | None
    rollout: dict | None
    seconds: float
    version: str
    robot: str | None = None
    geometry: GeometryResult | None = None
    ledger: tuple[Claim[EffectAt], ...] = ()
    files: tuple[WrittenFile, ...] = ()


def read_diagnosis(path: str | Path) -> Diagnosis:
    """Reads the diagnosis in a file; numbers that were not finite are NaN.

    Samples, names of recordings, notes and the proposed motion are not in the file and remain empty. In files of
    earlier versions this also applies to the name of the robot.

    Args:
        path: ``diagnosis.json``, or the folder that contains it.

    Raises:
        LogError: If the file does not exist or is no diagnosis of a known schema.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    require_plain_file(path, LogError, f"a {FILE}")
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise LogError(
            f"{path} cannot be read ({error.strerror}): give a {FILE}, or the folder that diagnose --out wrote."
        ) from error
    except (ValueError, RecursionError) as error:  # RecursionError: lists that are nested too deeply
        raise LogError(f"{path} is no JSON ({error}): give a {FILE} that phantom-dyn diagnose wrote.") from error
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema not in (SCHEMA, *OLDER):
        found = f"has the schema {shortened(str(schema))}" if schema else "is no diagnosis"
        raise LogError(f"{path} {found}, wanted {SCHEMA}: diagnose the recording again with this version.")
    try:
        return _diagnosis(built(_Document, _fields_of(content)))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        reason = shortened(str(error).replace("`", ""), 200)
        raise LogError(f"{path} is not a whole {SCHEMA} ({reason}): diagnose the recording again.") from error


def _fields_of(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a file, rearranged into the fields of a diagnosis."""
    residual = dict(content["unexplained"])
    residual |= residual.pop("where")
    dependence = residual.get("dependence")
    if dependence is not None:
        curves = [
            {"middle" if key == "torque" else key: part for key, part in one.items()} for one in dependence["curves"]
        ]
        fields = {key: name for name, key in DEPENDENCE_KEYS.items()}
        residual["dependence"] = {**{fields.get(key, key): part for key, part in dependence.items()}, "curves": curves}
    own = {key: value for key, value in content.items() if key not in ("frames", "geometry")}
    return own | {
        "findings": [_with_words(one) for one in content["findings"] if not is_of_poses(one)],
        "minor": [_with_words(one) for one in content["minor"]],
        "unexplained": residual,
        "geometry": geometry_of(content),
    }


def _with_words(finding: Mapping[str, Any]) -> dict[str, Any]:
    """A finding whose ``name``, which the file has for effects defined by a user, is replaced by words that show it."""
    words = None if (name := finding.get("name")) is None else shown_as(str(name))
    return {key: value for key, value in finding.items() if key != "name"} | {"words": words}


def _diagnosis(found: _Document) -> Diagnosis:
    """The diagnosis with the content of a file, after a check that values and standard deviations match."""
    for finding in (*found.findings, *found.minor):
        for name, value in finding.parameters.items():
            if _length(value.value) != _length(value.std):
                raise ValueError(f"{name} of {finding.effect} has not as many standard deviations as values")
    stored = {name: value for name, value in vars(found).items() if name != "schema"}
    stored |= {"robot": found.robot or "", "recordings": (), "evidence": no_evidence(len(found.joints))}
    return Diagnosis(**stored)


def _length(value: float | list[float]) -> int | None:
    """Length of a list; None for a number."""
    return len(value) if isinstance(value, list) else None


def no_evidence(nv: int) -> Evidence:
    """Evidence without samples for ``nv`` joints."""
    none = np.zeros((0, nv))
    return Evidence(np.zeros(0), none, none, none, none, none, none, ({},) * nv)
