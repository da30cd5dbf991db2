"""Prepares the rows of the report's tables; every cell is text that is not yet escaped."""

from __future__ import annotations

import math
from dataclasses import dataclass

from identification.diagnosis.result import Bound, Diagnosis, Finding, JointGap, NotTestable
from identification.words import diagnosis_words as words
from identification.words.effect_words import (
    REGIMES,
    is_between_joints,
    meaning_of,
    regime_words,
    report_order,
    value_cell,
    words_of,
)
from identification.words.numbers_and_names import NO_BREAK, number, percent, with_unit

Row = tuple[str, ...]

_EMPHASIS_RATIO = 1.5  # a regime is emphasised from this ratio of its share of the energy to its share of time
_EMPHASIS_SHARE = 0.25  # without a share of time, a regime is emphasised from this share of the energy
_HALVES = {"one_direction": 0.5, "time_drift": 0.5}  # regimes that are half of a motion, with half the energy by chance
_LEAST = 0.1  # a regime with a smaller share of the energy is never emphasised
NOT_SHOWN = "not shown by this motion"
"""Text that replaces a number that the recordings do not determine."""


@dataclass(frozen=True)
class RegimeShare:
    """Row of the table of regimes: shares of residual energy and of time as text, and the width of a bar [%]."""

    regime: str
    share: str
    time: str
    width: float
    emphasised: bool


@dataclass(frozen=True)
class DetectableSize:
    """Size above which an effect's parameter would have been seen: ``short`` is a range, ``places`` has each joint."""

    effect: str
    parameter: str
    short: str
    places: tuple[Row, ...]


def parameter_rows(finding: Finding) -> list[Row]:
    """Rows with name, value (standard deviation, unit) and meaning of each parameter of a finding."""
    return [
        (words.parameter_name(name), value_cell(value) if value.shown else NOT_SHOWN, meaning_of(finding, name))
        for name, value in finding.parameters.items()
    ]


def gap_row(joint: JointGap, samples: int) -> Row:
    """Row of a joint: residuals of the given, tolerated and corrected model, noise floor, unit, held-out samples."""
    within = "–" if joint.rms_within_tolerance is None else number(joint.rms_within_tolerance)
    after, floor = number(joint.rms_after), number(joint.noise_floor)
    if joint.noise_floor_interval is not None:
        low, high = (number(end) for end in joint.noise_floor_interval)
        # The interval must not break across lines, also not at the minus sign of a number such as 8.6e-05.
        interval = f"({low} to {high})".replace(" ", NO_BREAK).replace("-", "\N{NON-BREAKING HYPHEN}")
        floor = f"{floor} {interval}"
    held_out = f"{joint.hold_out_samples}{NO_BREAK}of{NO_BREAK}{samples}" if samples else str(joint.hold_out_samples)
    return (joint.joint, number(joint.rms_before), within, after, floor, joint.unit, held_out)


def regime_table(diagnosis: Diagnosis, joint: int) -> list[RegimeShare]:
    """Rows of the regimes that contain residual energy of the given model on a joint, the largest share first."""
    evidence = diagnosis.evidence
    shares = evidence.regime_shares[joint] if joint < len(evidence.regime_shares) else {}
    times = evidence.regime_times[joint] if joint < len(evidence.regime_times) else {}
    rows = []
    for regime in sorted(shares, key=lambda name: (-shares[name], list(REGIMES).index(name) if name in REGIMES else 0)):
        share, time = shares[regime], times.get(regime)
        expected = _HALVES.get(regime) if time is None else time
        least = _EMPHASIS_SHARE if expected is None else max(_LEAST, _EMPHASIS_RATIO * expected)
        width = 0.0 if math.isnan(share) else 100 * min(max(share, 0.0), 1.0)
        in_time = "" if time is None else percent(time)
        rows.append(RegimeShare(words.capital(regime_words(regime)), percent(share), in_time, width, share >= least))
    return rows


def rollout_rows(diagnosis: Diagnosis) -> list[Row]:
    """Rows with the errors of simulated motion before and after correction, for each joint.

    Rows over all recordings come first, followed by rows of each recording if there are several.
    """
    rollout = diagnosis.rollout or {}
    units = {joint.joint: "m" if joint.unit == "N" else "rad" for joint in diagnosis.joints}
    rows = []
    for part in (rollout, *rollout.get("recordings", ())):
        before, after = part.get("rms_before") or {}, part.get("rms_after") or {}
        where = f" in {part['recording']}" if "recording" in part else ""
        rows += [
            (f"{joint}{where}", _number(value), _number(after.get(joint)), units.get(joint, "rad"))
            for joint, value in before.items()
        ]
    return rows


def detectable_sizes(bounds: tuple[Bound, ...]) -> list[DetectableSize]:
    """Detection limits grouped by effect and parameter, in the report's order of effects."""
    groups: dict[tuple[str, str], list[Bound]] = {}
    for bound in sorted(bounds, key=lambda bound: report_order(bound.effect)):
        groups.setdefault((bound.effect, bound.parameter), []).append(bound)
    return [
        DetectableSize(
            words.capital(words_of(group[0]).name),
            words.parameter_name(parameter),
            "; ".join(_range([b for b in group if b.unit == unit]) for unit in dict.fromkeys(b.unit for b in group)),
            tuple((_bare(effect, b.joint), with_unit(number(b.below), b.unit)) for b in group),
        )
        for (effect, parameter), group in groups.items()
    ]


def untestable_rows(entries: tuple[NotTestable, ...], joints: tuple[JointGap, ...]) -> list[Row]:
    """Rows with effects, joints and reason; effects with the same reason on the same joints share a row."""
    places: dict[tuple[str, str], list[NotTestable]] = {}
    for entry in sorted(entries, key=lambda entry: report_order(entry.effect)):
        places.setdefault((entry.effect, entry.why), []).append(entry)
    effects: dict[tuple[str, Row], list[str]] = {}
    for (effect, why), group in places.items():
        where = _places(effect, [entry.joint for entry in group], joints)
        effects.setdefault((why, where), []).append(words_of(group[0]).name)
    return [
        (words.capital(words.joined(names)), words.joined(list(where)), why) for (why, where), names in effects.items()
    ]


def _places(effect: str, at: list[str | None], joints: tuple[JointGap, ...]) -> Row:
    """Names of joints or pairs of joints; "all joints" if an effect is on every joint."""
    names = [joint.joint for joint in joints]
    if len(names) > 2 and set(names) <= set(at):
        return ("all joints", *(_bare(effect, joint) for joint in at if joint not in names))
    return tuple(_bare(effect, joint) for joint in at)


def _range(bounds: list[Bound]) -> str:
    """A range of sizes, such as ``0.002 to 0.01 rad (7 joints)``."""
    sizes = [bound.below for bound in bounds]
    low, high = number(min(sizes)), number(max(sizes))
    size = with_unit(low if low == high else f"{low} to {high}", bounds[0].unit)
    if len(bounds) == 1:
        return f"{size} ({words.place(bounds[0].effect, bounds[0].joint)})"
    count = sum(bound.joint is not None for bound in bounds)
    one, several = ("pair of joints", "pairs of joints") if is_between_joints(bounds[0].effect) else ("joint", "joints")
    whole = " and the whole robot" if count < len(bounds) else ""
    return f"{size} ({count} {one if count == 1 else several}{whole})"


def _bare(effect: str, joint: str | None) -> str:
    """Name of a joint, pair of joints or the whole robot, without the word joint."""
    return words.place(effect, joint).removeprefix("joints ").removeprefix("joint ")


def _number(value: object) -> str:
    return number(float(value)) if isinstance(value, int | float) else "–"
