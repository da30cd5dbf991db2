"""Types of the values in ``diagnosis.json`` (schema ``gap-diagnosis/3`` or ``2``), to refuse damaged files."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

_LARGEST = 1e150  # intervals need the square of a number
Number = Annotated[float, Meta(ge=-_LARGEST, le=_LARGEST)]
Pair = tuple[Number | None, Number | None]


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A part of the document; an unknown key means another version."""


class ValuePart(_Part, frozen=True):
    """An estimate with its standard deviation and unit."""

    value: Number | list[Number | None] | None
    std: Number | list[Number | None] | None
    unit: str


class EffectPart(_Part, frozen=True):
    """An effect and where it acts."""

    effect: str
    joint: str | None
    recording: str | None = None
    parameters: list[str] = []


class RivalPart(_Part, frozen=True):
    """An alternative to a finding."""

    effects: list[EffectPart]
    probability: Number | None


class FindingPart(_Part, frozen=True):
    """A named cause."""

    effect: str
    joint: str | None
    regime: str
    parameters: dict[str, ValuePart]
    share: Number | None
    gap_closed: Number | None
    gap_closed_interval: Pair
    probability: Number | None
    rivals: list[RivalPart]
    verdict: str
    law: str | None = None
    recording: str | None = None
    measured: str | None = None
    name: str | None = None


class JointPart(_Part, frozen=True):
    """Gap of a joint."""

    joint: str
    unit: str
    rms_before: Number | None
    rms_after: Number | None
    noise_floor: Number | None
    hold_out_samples: int
    rms_torque: Number | None
    rms_within_tolerance: Number | None
    noise_floor_interval: Pair | None
    noise_floor_source: str | None
    closed: Number | None
    discrepancy: Number | None = None


class FramePart(_Part, frozen=True):
    """Gap of a frame whose poses were measured."""

    frame: str
    unit: str
    rms_before: Number
    rms_after: Number
    noise_floor: Number
    hold_out_samples: int
    rms_torque: None
    rms_within_tolerance: Number
    noise_floor_interval: tuple[Number, Number]
    noise_floor_source: str
    closed: Number | None


class PoseBoundPart(_Part, frozen=True):
    """Size of a geometric error above which poses would have shown it."""

    effect: str
    joint: str | None
    parameter: str
    below: Number
    unit: str


class UnseenPart(_Part, frozen=True):
    """A geometric error that poses cannot show."""

    effect: str
    joint: str | None
    parameter: str
    why: str


class FittedPart(_Part, frozen=True):
    """A pose that the recordings do not give and that was fitted."""

    what: str
    file: str
    frame: str | None
    pose: list[Number]


class LatenessPart(_Part, frozen=True):
    """Delay of measured poses."""

    file: str
    delay: Number
    std: Number


class GeometryPart(_Part, frozen=True):
    """Result of measured poses."""

    verdict: str
    closed: Number | None
    interval: tuple[Number, Number] | None
    minor: list[FindingPart]
    bounds: list[PoseBoundPart]
    not_testable: list[UnseenPart]
    fitted: list[FittedPart]
    delays: list[LatenessPart]
    rank: int
    structured: bool
    torque_verdict: str | None
    notes: list[str]


class GapPart(_Part, frozen=True):
    """Share of the gap that all findings close."""

    closed: Number | None
    interval: Pair | None


class AdjustedPart(_Part, frozen=True):
    """A modelled quantity that moved within its tolerance."""

    quantity: str
    change: Number | None
    tolerance: Number | None
    at_limit: bool


class WherePart(_Part, frozen=True):
    """Joint, regime and times of the residual."""

    joint: str | None
    regime: str | None
    times: list[tuple[Number, Number]]


class LawPart(_Part, frozen=True):
    """The law of the residual on one joint."""

    joint: str
    inputs: list[str]
    formula: str
    gap_closed: Number | None
    gap_closed_interval: Pair
    valid: dict[str, Pair]
    like: str | None


class InputGainPart(_Part, frozen=True):
    """Share of the residual that inputs predict."""

    inputs: list[str]
    gain: Number | None
    interval: Pair
    chance: Number | None


class InputCurvePart(_Part, frozen=True):
    """Torque over an input."""

    input: str
    unit: str
    direction: str
    x: list[Number]
    torque: list[Number | None]
    low: list[Number | None]
    high: list[Number | None]


class FrequencyAnswerPart(_Part, frozen=True):
    """Gain and phase of the torque over the frequency of an input."""

    input: str
    unit: str
    hz: list[Number]
    gain: list[Number | None]
    gain_low: list[Number | None]
    gain_high: list[Number | None]
    phase: list[Number | None]
    phase_low: list[Number | None]
    phase_high: list[Number | None]


class LawTermPart(_Part, frozen=True):
    """A term of a law."""

    term: str
    unit: str
    coefficient: Number | None
    interval: Pair
    chosen: Number | None


class DependencePart(_Part, frozen=True):
    """Inputs of the residual."""

    joint: str
    unit: str
    inputs: list[str]
    rest_closed: Number | None
    same_terms: Number | None
    blocks: int
    gains: list[InputGainPart]
    curves: list[InputCurvePart]
    terms: list[LawTermPart]
    answers: list[FrequencyAnswerPart] = []


class UnexplainedPart(_Part, frozen=True):
    """What is left unexplained."""

    fraction_of_explainable: Number | None
    structured: bool
    where: WherePart
    law: LawPart | None
    dependence: DependencePart | None = None


class BoundPart(_Part, frozen=True):
    """Size of an effect above which it would have been seen."""

    effect: str
    joint: str | None
    parameter: str
    below: Number | None
    unit: str
    of_torque: Number | None


class NotTestablePart(_Part, frozen=True):
    """An effect that this recording cannot show."""

    effect: str
    joint: str | None
    why: str


class FilePart(_Part, frozen=True):
    """A model file: its errors and contents, or why it was not written."""

    file: str
    rms_left: dict[str, Number | None]
    rms_given: dict[str, Number | None]
    holds: list[str]
    lacks: list[str]
    refused: str = ""


class GatePart(_Part, frozen=True):
    """Result of a gate."""

    gate: str
    value: Number | None
    needed: Number | None
    unit: str
    passed: bool


class ClaimPart(_Part, frozen=True):
    """An entry of the ledger."""

    effects: list[EffectPart]
    gates: list[GatePart]
    outcome: Literal["claimed", "minor", "not_claimed", "displaced"]
    instead: list[EffectPart] = []
    figures: dict[str, Number | None] = {}
    judged_by: Literal["torques", "poses", "rests"] = "torques"


class Document(_Part, frozen=True):
    """The whole file."""

    schema: str
    verdict: str
    run: str
    gap: GapPart
    joints: list[JointPart]
    band_hz: tuple[Number, Number]
    findings: list[FindingPart]
    minor: list[FindingPart]
    adjusted: list[AdjustedPart]
    unexplained: UnexplainedPart
    bounds: list[BoundPart]
    not_testable: list[NotTestablePart]
    data_warnings: list[str]
    next_experiment: dict[str, Any] | None
    rollout: dict[str, Any] | None
    seconds: Number | None
    version: str
    robot: str | None = None
    frames: list[FramePart] = []
    geometry: GeometryPart | None = None
    ledger: list[ClaimPart] = []
    files: list[FilePart] = []


def require_document(content: dict[str, Any]) -> None:
    """Refuse content that does not match the schema.

    Raises:
        ValueError: If it does not. The message says which value is wrong, where it is, and what was wanted.
    """
    found = msgspec.convert(content, Document)
    for finding in (*found.findings, *found.minor):
        for name, value in finding.parameters.items():
            if _length(value.value) != _length(value.std):
                raise ValueError(f"{name} of {finding.effect} has not as many standard deviations as values")


def _length(value: float | list[float | None] | None) -> int | None:
    """Length of a list; None for a number."""
    return len(value) if isinstance(value, list) else None
