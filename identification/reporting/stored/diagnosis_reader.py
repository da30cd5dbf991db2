"""A diagnosis read back from its ``diagnosis.json`` (schema ``gap-diagnosis/3`` or ``2``), without its samples."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.rest_law import Dependence, FrequencyAnswer, InputCurve, InputGain, Law, LawTerm
from identification.diagnosis.result import (
    Adjusted,
    Bound,
    Diagnosis,
    EffectAt,
    Finding,
    Gap,
    JointGap,
    NotTestable,
    Rival,
    Unexplained,
    Value,
)
from identification.diagnosis.written import WrittenFile
from identification.engine.claims import Claim, GateResult
from identification.reporting.stored.diagnosis_files import INDEX, SCHEMA
from identification.reporting.stored.diagnosis_schema import require_document
from identification.reporting.stored.geometry_json import is_of_poses, read_geometry
from identification.words.effect_words import shown_as
from phantom_dyn.errors import LogError, shortened
from phantom_dyn.model.files.plain_file import require_plain_file

FILE = INDEX
OLDER = ("gap-diagnosis/2",)
"""Schemas of earlier versions that can be read as well."""


def read_diagnosis(path: str | Path) -> Diagnosis:
    """The diagnosis in a file; numbers that were not finite are NaN.

    The file does not contain samples, names of recordings, notes or the proposed motion, and files of earlier versions
    not the name of the robot. These are empty.

    Args:
        path: ``diagnosis.json``, or the folder that contains it.

    Raises:
        LogError: If there is no such file, or if it is no diagnosis of this schema. The message says what to do.
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
    except (ValueError, RecursionError) as error:  # RecursionError: lists nested without end
        raise LogError(f"{path} is no JSON ({error}): give a {FILE} that phantom-dyn diagnose wrote.") from error
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema not in (SCHEMA, *OLDER):
        found = f"has the schema {shortened(str(schema))}" if schema else "is no diagnosis"
        raise LogError(f"{path} {found}, wanted {SCHEMA}: diagnose the recording again with this version.")
    try:
        require_document(content)
        return _diagnosis(content)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        reason = shortened(str(error).replace("`", ""), 200)
        raise LogError(f"{path} is not a whole {SCHEMA} ({reason}): diagnose the recording again.") from error


def _diagnosis(content: Mapping[str, Any]) -> Diagnosis:
    left = content["unexplained"]
    where = left["where"]
    gap = content["gap"]
    joints = tuple(_joint(joint) for joint in content["joints"])
    low, high = content["band_hz"]
    return Diagnosis(
        verdict=content["verdict"],
        robot=content.get("robot") or "",
        recordings=(),
        joints=joints,
        band_hz=(float(low), float(high)),
        findings=tuple(_finding(finding) for finding in content["findings"] if not is_of_poses(finding)),
        adjusted=tuple(Adjusted(**move) for move in content["adjusted"]),
        unexplained=Unexplained(
            _number(left["fraction_of_explainable"]),
            left["structured"],
            where["joint"],
            where["regime"],
            tuple((float(start), float(stop)) for start, stop in where["times"]),
            _law(left["law"]),
            _dependence(left.get("dependence")),
        ),
        bounds=tuple(Bound(**bound) for bound in content["bounds"]),
        not_testable=tuple(NotTestable(**entry) for entry in content["not_testable"]),
        data_warnings=tuple(content["data_warnings"]),
        next_experiment=content["next_experiment"],
        rollout=content["rollout"],
        seconds=_number(content["seconds"]),
        version=content["version"],
        evidence=no_evidence(len(joints)),
        gap=Gap(gap["closed"], _interval(gap["interval"])),
        minor=tuple(_finding(finding) for finding in content["minor"]),
        run=content["run"],
        geometry=read_geometry(content),
        ledger=tuple(_claim(claim) for claim in content.get("ledger", ())),
        files=tuple(_file(file) for file in content.get("files", ())),
    )


def _file(file: Mapping[str, Any]) -> WrittenFile:
    return WrittenFile(
        file["file"],
        {joint: _number(value) for joint, value in file["rms_left"].items()},
        {joint: _number(value) for joint, value in file["rms_given"].items()},
        tuple(file["holds"]),
        tuple(file["lacks"]),
        file.get("refused", ""),
    )


def no_evidence(nv: int) -> Evidence:
    """Evidence without samples for ``nv`` joints."""
    none = np.zeros((0, nv))
    return Evidence(np.zeros(0), none, none, none, none, none, none, ({},) * nv)


def _joint(joint: Mapping[str, Any]) -> JointGap:
    numbers = {name: _number(joint[name]) for name in ("rms_before", "rms_after", "noise_floor")}
    return JointGap(**{**joint, **numbers, "noise_floor_interval": _interval(joint["noise_floor_interval"])})


def _finding(finding: Mapping[str, Any]) -> Finding:
    low, high = finding["gap_closed_interval"]
    return Finding(
        effect=finding["effect"],
        joint=finding["joint"],
        regime=finding["regime"],
        parameters={
            name: Value(_numbers(value["value"]), _numbers(value["std"]), value["unit"])
            for name, value in finding["parameters"].items()
        },
        gap_closed=_number(finding["gap_closed"]),
        gap_closed_interval=(_number(low), _number(high)),
        probability=_number(finding["probability"]),
        rivals=tuple(
            Rival(tuple(EffectAt(**at) for at in rival["effects"]), _number(rival["probability"]))
            for rival in finding["rivals"]
        ),
        verdict=finding["verdict"],
        recording=finding.get("recording"),
        share=finding["share"],
        law=finding.get("law"),
        words=None if (name := finding.get("name")) is None else shown_as(name),
    )


def _claim(claim: Mapping[str, Any]) -> Claim[EffectAt]:
    numbers = ({name: _number(result[name]) for name in ("value", "needed")} for result in claim["gates"])
    return Claim(
        tuple(EffectAt(**at) for at in claim["effects"]),
        tuple(GateResult(**{**result, **own}) for result, own in zip(claim["gates"], numbers, strict=True)),
        claim["outcome"],
        tuple(EffectAt(**at) for at in claim.get("instead", ())),
        {name: _number(value) for name, value in claim.get("figures", {}).items()},
        claim.get("judged_by", "torques"),
    )


def _law(law: Mapping[str, Any] | None) -> Law | None:
    if law is None:
        return None
    return Law(
        joint=law["joint"],
        inputs=tuple(law["inputs"]),
        formula=law["formula"],
        gap_closed=_number(law["gap_closed"]),
        gap_closed_interval=_pair(law["gap_closed_interval"]),
        valid={name: _pair(pair) for name, pair in law["valid"].items()},
        like=law["like"],
    )


def _dependence(found: Mapping[str, Any] | None) -> Dependence | None:
    if found is None:
        return None
    gains = [
        InputGain(tuple(one["inputs"]), _number(one["gain"]), _pair(one["interval"]), _number(one["chance"]))
        for one in found["gains"]
    ]
    curves = [
        InputCurve(
            one["input"],
            one["unit"],
            one["direction"],
            *(tuple(_number(value) for value in one[name]) for name in ("x", "torque", "low", "high")),
        )
        for one in found["curves"]
    ]
    series = ("hz", "gain", "gain_low", "gain_high", "phase", "phase_low", "phase_high")
    answers = [
        FrequencyAnswer(one["input"], one["unit"], *(tuple(_number(value) for value in one[name]) for name in series))
        for one in found.get("answers", [])
    ]
    terms = [
        LawTerm(one["term"], one["unit"], _number(one["coefficient"]), _pair(one["interval"]), _number(one["chosen"]))
        for one in found["terms"]
    ]
    return Dependence(
        joint=found["joint"],
        unit=found["unit"],
        inputs=tuple(found["inputs"]),
        gains=tuple(gains),
        curves=tuple(curves),
        answers=tuple(answers),
        terms=tuple(terms),
        same_terms=_number(found["same_terms"]),
        rest_closed=_number(found["rest_closed"]),
        blocks=found["blocks"],
    )


def _pair(pair: list[float | None]) -> tuple[float, float]:
    return _number(pair[0]), _number(pair[1])


def _numbers(value: Any) -> float | list[float]:
    return [_number(entry) for entry in value] if isinstance(value, list) else _number(value)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _interval(pair: list[float] | None) -> tuple[float, float] | None:
    return None if pair is None else (_number(pair[0]), _number(pair[1]))
