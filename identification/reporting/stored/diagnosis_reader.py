"""Reads a diagnosis from ``diagnosis.json`` (schema ``gap-diagnosis/3`` or ``2``); the file contains no samples."""

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
from identification.reporting.stored.diagnosis_files import DEPENDENCE_KEYS, INDEX, SCHEMA
from identification.reporting.stored.geometry_json import geometry_of, is_of_poses
from identification.reporting.stored.typed_json import from_json
from identification.words.effect_words import shown_as
from phantom_dyn.errors import LogError, shortened
from phantom_dyn.model.files.plain_file import require_plain_file

FILE = INDEX
OLDER = ("gap-diagnosis/2",)
"""Schemas of earlier versions that can also be read."""


@dataclass(frozen=True)
class _Document:
    """The fields of `Diagnosis` that the file contains, and its schema."""

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
    """The diagnosis in a file; numbers that were not finite are NaN.

    Samples, names of recordings, notes and the proposed motion are empty, because the file does not contain them; so is
    the name of the robot in files of earlier versions.

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
        return _diagnosis(from_json(_Document, _fields_of(content)))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        reason = shortened(str(error).replace("`", ""), 200)
        raise LogError(f"{path} is not a whole {SCHEMA} ({reason}): diagnose the recording again.") from error


def _fields_of(content: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of `_Document`, from the content of a file."""
    fields = {key: value for key, value in content.items() if key not in ("frames", "geometry")}
    # Findings in measured poses are a part of ``geometry``.
    fields["findings"] = [_finding_fields(one) for one in content["findings"] if not is_of_poses(one)]
    fields["minor"] = [_finding_fields(one) for one in content["minor"]]
    fields["unexplained"] = _unexplained_fields(content["unexplained"])
    fields["geometry"] = geometry_of(content)
    return fields


def _unexplained_fields(stored: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of `Unexplained`: the file nests some of them in ``where``, and ``dependence`` has other keys."""
    fields = dict(stored)
    fields |= fields.pop("where")
    dependence = fields.get("dependence")
    if dependence is not None:
        renamed = _renamed(dependence, {key: name for name, key in DEPENDENCE_KEYS.items()})
        renamed["curves"] = [_renamed(curve, {"torque": "middle"}) for curve in dependence["curves"]]
        fields["dependence"] = renamed
    return fields


def _renamed(stored: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """A mapping with other names for some of its keys."""
    return {names.get(key, key): value for key, value in stored.items()}


def _finding_fields(stored: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of `Finding`. For an effect that a user has defined, the file has a ``name`` in place of ``words``."""
    fields = {key: value for key, value in stored.items() if key != "name"}
    name = stored.get("name")
    fields["words"] = None if name is None else shown_as(str(name))
    return fields


def _diagnosis(found: _Document) -> Diagnosis:
    """The diagnosis with the fields of a file.

    Raises:
        ValueError: If a parameter has not as many standard deviations as values.
    """
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
