"""Result of measured poses as plain data of ``diagnosis.json``, and its reading.

Frames and findings of poses are in the same lists as those of torques (docs/files.md); ``geometry`` holds the rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from math import nan
from typing import Any

from identification.geometry.result import (
    FittedPose,
    FrameGap,
    GeometryResult,
    Lateness,
    Number,
    Place,
    PoseBound,
    PoseFinding,
    PoseRival,
    Unseen,
)
from identification.geometry.terms import ELASTIC
from identification.words.note_words import sentences

_BESIDE = ("frames", "findings", "evidence", "warnings", "claims")


def frames_json(found: GeometryResult) -> list[dict[str, Any]]:
    """Gaps of the frames, with the keys of the gaps of joints."""
    return [asdict(frame) | {"rms_torque": None, "rms_within_tolerance": frame.rms_before} for frame in found.frames]


def findings_json(findings: Iterable[PoseFinding]) -> list[dict[str, Any]]:
    """Findings with the same keys as findings of torques; ``measured`` is ``poses``."""
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
    """The entry ``geometry``: everything but frames and findings, which are listed with those of torques."""
    rest = {name: value for name, value in vars(found).items() if name not in _BESIDE}
    lists = ("bounds", "not_testable", "fitted", "delays")
    return (
        rest
        | {name: [asdict(one) for one in rest[name]] for name in lists}
        | {
            "minor": findings_json(found.minor),
            "notes": list(sentences(found.notes)),
        }
    )


def read_geometry(content: Mapping[str, Any]) -> GeometryResult | None:
    """Result of poses in the content of a ``diagnosis.json``, without errors of single poses; None without poses."""
    rest = content.get("geometry")
    if rest is None:
        return None
    interval = rest["interval"]
    return GeometryResult(
        verdict=rest["verdict"],
        closed=rest["closed"],
        interval=None if interval is None else (interval[0], interval[1]),
        frames=tuple(_frame(one) for one in content["frames"]),
        findings=tuple(_finding(one) for one in content["findings"] if is_of_poses(one)),
        minor=tuple(_finding(one) for one in rest["minor"]),
        bounds=tuple(PoseBound(**one) for one in rest["bounds"]),
        not_testable=tuple(Unseen(**one) for one in rest["not_testable"]),
        fitted=tuple(FittedPose(**{**one, "pose": tuple(one["pose"])}) for one in rest["fitted"]),
        delays=tuple(Lateness(**one) for one in rest["delays"]),
        rank=rest["rank"],
        structured=rest["structured"],
        warnings=(),
        torque_verdict=rest["torque_verdict"],
        notes=tuple(rest["notes"]),
    )


def is_of_poses(finding: Mapping[str, Any]) -> bool:
    """True for a finding in measured poses."""
    return finding.get("measured") == "poses"


def _frame(one: Mapping[str, Any]) -> FrameGap:
    low, high = one["noise_floor_interval"]
    own = {name: value for name, value in one.items() if name not in ("rms_torque", "rms_within_tolerance")}
    return FrameGap(**{**own, "noise_floor_interval": (low, high)})


def _finding(one: Mapping[str, Any]) -> PoseFinding:
    low, high = one["gap_closed_interval"]
    return PoseFinding(
        effect=one["effect"],
        joint=one["joint"],
        parameters={
            name: Number(**{**value, "std": nan if value["std"] is None else value["std"]})
            for name, value in one["parameters"].items()
        },
        share=one["share"],
        gap_closed=one["gap_closed"],
        gap_closed_interval=(low, high),
        probability=one["probability"],
        rivals=tuple(
            PoseRival(
                tuple(Place(at["effect"], at["joint"], tuple(at["parameters"])) for at in rival["effects"]),
                rival["probability"],
            )
            for rival in one["rivals"]
        ),
    )
