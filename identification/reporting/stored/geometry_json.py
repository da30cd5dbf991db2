"""Converts the result on measured poses to plain data for ``diagnosis.json``, and back.

Findings in poses are in the same list as findings in torques. The entry ``frames`` has the gaps of frames, and the
entry ``geometry`` has the rest (docs/files.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

from identification.geometry.result import GeometryResult, PoseFinding
from identification.geometry.terms import ELASTIC
from identification.words.note_words import sentences

_STORED_ELSEWHERE = ("frames", "findings", "evidence", "warnings", "claims")


def frames_json(found: GeometryResult) -> list[dict[str, Any]]:
    """Gaps of the frames, with the same keys as gaps of joints."""
    return [asdict(frame) | {"rms_torque": None, "rms_within_tolerance": frame.rms_before} for frame in found.frames]


def findings_json(findings: Iterable[PoseFinding]) -> list[dict[str, Any]]:
    """Findings in poses with the same keys as findings in torques, and ``measured: poses``."""
    return [
        {
            "effect": one.effect,
            "joint": one.joint,
            "regime": "high_load" if one.effect == ELASTIC else "posture",
            "parameters": {name: asdict(value) for name, value in one.parameters.items()},
            "share": one.share,
            "gap_closed": one.gap_closed,
            "gap_closed_interval": one.gap_closed_interval,
            "probability": one.probability,
            "rivals": [
                {"effects": [asdict(place) for place in rival.places], "probability": rival.probability}
                for rival in one.rivals
            ],
            "verdict": one.verdict,
            "measured": "poses",
        }
        for one in findings
    ]


def geometry_json(found: GeometryResult) -> dict[str, Any]:
    """The entry ``geometry``: everything except frames and findings."""
    rest = {name: value for name, value in vars(found).items() if name not in _STORED_ELSEWHERE}
    lists = ("bounds", "not_testable", "fitted", "delays")
    return (
        rest
        | {name: [asdict(one) for one in rest[name]] for name in lists}
        | {
            "minor": findings_json(found.minor),
            "notes": list(sentences(found.notes)),
        }
    )


def geometry_of(content: Mapping[str, Any]) -> dict[str, Any] | None:
    """Fields of the `GeometryResult` in the content of a ``diagnosis.json``, as plain data; None without one."""
    rest = content.get("geometry")
    if rest is None:
        return None
    joint_keys = ("rms_torque", "rms_within_tolerance")
    return {
        **rest,
        "frames": [{key: value for key, value in one.items() if key not in joint_keys} for one in content["frames"]],
        "findings": [_finding_fields(one) for one in content["findings"] if is_of_poses(one)],
        "minor": [_finding_fields(one) for one in rest["minor"]],
        "warnings": [],
    }


def is_of_poses(finding: Mapping[str, Any]) -> bool:
    """True if an entry of ``findings`` is a finding in measured poses."""
    return finding.get("measured") == "poses"


def _finding_fields(finding: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a `PoseFinding`, without keys that exist only for uniformity with findings in torques."""
    rivals = [{"places": one["effects"], "probability": one["probability"]} for one in finding["rivals"]]
    torque_keys = ("regime", "verdict", "measured")
    return {key: value for key, value in finding.items() if key not in torque_keys} | {"rivals": rivals}
