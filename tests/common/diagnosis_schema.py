"""The contract's diagnosis.json (schema gap-diagnosis/3) as types: every field, nothing besides."""

from typing import Annotated, Any, Literal

import msgspec

from phantom_dyn.effects.catalogue import EFFECTS

Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Regime = Literal[
    "velocity_reversal",
    "low_speed",
    "high_speed",
    "high_load",
    "high_acceleration",
    "one_direction",
    "periodic_in_angle",
    "posture",
    "saturated",
    "time_drift",
    "everywhere",
]
Effect = Literal[tuple(effect.name for effect in EFFECTS)]


class Strict(msgspec.Struct, forbid_unknown_fields=True):
    """Knows all its fields."""


class Joint(Strict):
    joint: str
    unit: Literal["N m", "N"]
    rms_before: NotNegative
    rms_after: NotNegative
    noise_floor: Positive
    hold_out_samples: Annotated[int, msgspec.Meta(ge=0)]
    rms_torque: NotNegative | None
    rms_within_tolerance: NotNegative | None
    noise_floor_interval: tuple[NotNegative, Positive] | None
    noise_floor_source: Literal["sensors", "repetitions", "none"] | None
    closed: float | None
    discrepancy: NotNegative | None


class Gap(Strict):
    closed: float | None
    interval: tuple[float, float] | None


class Value(Strict):
    value: float | list[float]
    std: float | list[float | None] | None
    unit: str


class EffectAt(Strict):
    effect: Effect
    joint: str | None


class Rival(Strict):
    effects: Annotated[list[EffectAt], msgspec.Meta(min_length=1)]
    probability: Annotated[float, msgspec.Meta(ge=0.05, le=1)]


class Finding(Strict):
    effect: Effect
    joint: str | None
    regime: Regime
    parameters: dict[str, Value]
    share: float | None
    gap_closed: float
    gap_closed_interval: tuple[float, float]
    probability: Share
    rivals: list[Rival]
    verdict: Literal["one_of", "supported"]


class Adjusted(Strict):
    quantity: str
    change: float
    tolerance: Positive
    at_limit: bool


class Where(Strict):
    joint: str | None
    regime: Regime | None
    times: list[tuple[float, float]]


class Law(Strict):
    joint: str
    inputs: list[str]
    formula: str
    gap_closed: float
    gap_closed_interval: tuple[float, float]
    valid: dict[str, tuple[float, float]]
    like: str | None


class Unexplained(Strict):
    fraction_of_explainable: Share
    structured: bool
    where: Where
    law: Law | None
    # What the rest depends on: beyond the contract, and only where there is a rest.
    dependence: dict[str, Any] | None = None


class Bound(Strict):
    effect: Effect
    joint: str | None
    parameter: str
    below: Positive
    unit: str
    of_torque: NotNegative | None


class NotTestable(Strict):
    effect: Effect
    joint: str | None
    why: str


class Gate(Strict):
    gate: str
    value: float | None
    needed: float | None
    unit: str
    passed: bool


class Entry(Strict):
    effects: list[EffectAt]
    gates: list[Gate]
    outcome: Literal["claimed", "minor", "not_claimed", "displaced"]
    instead: list[EffectAt]
    judged_by: Literal["torques", "poses", "rests"]
    figures: dict[str, float | None]


class File(Strict):
    file: str
    rms_left: dict[str, Positive]
    rms_given: dict[str, Positive]
    holds: list[str]
    lacks: list[str]
    refused: str = ""


class Next(Strict):
    separates: list[tuple[str, str | None]]
    reference: str
    expected_power: float
    say: str


class Rollout(Strict):
    horizon_s: float
    rms_before: dict[str, float | None]
    rms_after: dict[str, float | None]
    # What the noise of the readings makes of it: beyond the contract, and only where it was looked at.
    reading_noise: dict[str, Any] | None = None


class Document(Strict):
    schema: Literal["gap-diagnosis/3"]
    verdict: Literal["explained", "partly_explained", "unknown", "no_gap", "not_testable"]
    run: Annotated[str, msgspec.Meta(min_length=8)]
    robot: str
    gap: Gap
    joints: list[Joint]
    band_hz: tuple[float, Positive]
    findings: list[Finding]
    minor: list[Finding]
    adjusted: list[Adjusted]
    unexplained: Unexplained
    bounds: list[Bound]
    not_testable: list[NotTestable]
    data_warnings: list[str]
    next_experiment: Next | None
    rollout: Rollout | None
    ledger: list[Entry]
    files: list[File]
    seconds: Positive
    version: str
