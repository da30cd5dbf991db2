"""Prepares the first screen of the report: bars of each joint's gap before and after, and groups of findings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.judge.verdict import may_hide_gap
from identification.diagnosis.result import Diagnosis, Finding, JointGap, Value
from identification.reporting.charts.chart import AFTER, Panel, chart
from identification.reporting.charts.chart_marks import Curve
from identification.words import diagnosis_words as words
from identification.words.numbers_and_names import NO_BREAK, number, percent_short_of_all, value_words, with_unit
from identification.words.verdict_words import group_name, grouped

MOST_BARS = 8
"""Largest number of joints on the first screen; of more joints, those with the largest gap are shown."""
_MOST_SIZES = 4
"""Parameters of a finding are shown on the first screen only if the finding has at most this number of them."""


@dataclass(frozen=True)
class Bar:
    """Residuals of one joint before and after correction, and its noise floor, as widths of bars [%] and as text.

    Widths are proportional to the residual divided by the joint's noise floor, so that the mark of the noise floor is
    at the same position for all joints.
    """

    joint: str
    before: float
    after: float
    floor: float
    text: str


@dataclass(frozen=True)
class Group:
    """One finding, findings of one effect on several joints, or findings of several effects on the same joints.

    Attributes:
        findings: All findings of the group.
        name: Names of the effects and of their joints.
        size: For a single finding, its parameters; for several findings of one effect with one parameter each, the
            range of that parameter; otherwise empty.
        share: Share of the gap that the group closes, as text; empty if unknown.
        width: The share as the width of a bar [%].
        sure: Certainty of the least certain finding, in words.
    """

    findings: tuple[Finding, ...]
    name: str
    size: str
    share: str
    width: float
    sure: str


def gap_bars_of(diagnosis: Diagnosis) -> tuple[list[Bar], int]:
    """Bars of at most eight joints, in the robot's order, and the number of joints that are left out."""
    gaps = diagnosis.joints
    sizes = np.array([_over_floor(gap, gap.without_findings) for gap in gaps])
    shown_rows = sorted(np.argsort(-sizes, kind="stable")[:MOST_BARS].tolist())
    largest = max([1.0, *(_over_floor(gap, size) for gap in gaps for size in (gap.without_findings, gap.rms_after))])
    return [_bar(gaps[k], largest) for k in shown_rows], len(gaps) - len(shown_rows)


def _over_floor(gap: JointGap, size: float) -> float:
    """A residual divided by the joint's noise floor; zero if the ratio is not finite."""
    ratio = size / gap.noise_floor if gap.noise_floor else 0.0
    return ratio if np.isfinite(ratio) else 0.0


def _bar(gap: JointGap, largest: float) -> Bar:
    """The bar of one joint; ``largest`` is the ratio of residual to noise floor with a width of 100 %."""
    sizes = (gap.without_findings, gap.rms_after, gap.noise_floor)
    before, after, floor = (100 * _over_floor(gap, size) / largest for size in sizes)
    text = f"{number(gap.without_findings)} → {with_unit(number(gap.rms_after), gap.unit)}".replace(" ", NO_BREAK)
    status = None if gap.closed is None else f"{percent_short_of_all(gap.closed)} closed"
    # No gap: the residual of the given model, or that of the model adjusted within its tolerances, is allowed.
    if gap.only_given_fits or (status is None and gap.tolerated <= gap.allowed):
        status = "may be a gap" if may_hide_gap(gap) else "no gap"
        if gap.only_given_fits:
            text = with_unit(number(gap.rms_before), gap.unit).replace(" ", NO_BREAK)
    if not gap.hold_out_samples:
        text, status = "not judged", None
    return Bar(gap.joint, before, after, floor, ", ".join(filter(None, (text, status))))


def groups_of(diagnosis: Diagnosis) -> list[Group]:
    """The findings in the groups that `grouped` forms."""
    return [_group(kinds, diagnosis) for kinds in grouped(diagnosis)]


def _group(kinds: list[list[Finding]], diagnosis: Diagnosis) -> Group:
    findings = tuple(finding for found in kinds for finding in found)
    # If a single finding has no share, its share is the part of the gap that it closes.
    shares = [one.gap_closed if one.share is None and len(diagnosis.findings) == 1 else one.share for one in findings]
    known = [share for share in shares if share is not None]
    # Corrections below the noise floor can make the sum exceed the gap.
    share = min(sum(known), 1.0) if len(known) == len(shares) else None
    return Group(
        findings,
        words.capital(group_name(kinds, diagnosis)),
        _size(findings) if len(kinds) == 1 else "",
        # A Shapley value can be negative if other findings explain the same residual better.
        "" if share is None or share < 0.0 else percent_short_of_all(share),
        0.0 if share is None else 100 * max(share, 0.0),
        words.certainty_words(min(finding.probability for finding in findings)),
    )


def _size(findings: tuple[Finding, ...]) -> str:
    """Parameters of findings of one effect as text, as `Group.size`."""
    if len(findings) == 1:
        parameters = words.shown_parameters(findings[0])
        if len(parameters) > _MOST_SIZES:
            return ""
        return ", ".join(
            _unbroken(value) if len(parameters) == 1 else f"{words.parameter_name(name)} {_unbroken(value)}"
            for name, value in parameters.items()
        )
    values = [value for one in findings if len(one.parameters) == 1 for value in one.parameters.values()]
    sizes = [float(value.value) for value in values if not isinstance(value.value, list)]
    units = {value.unit for value in values}
    if len(sizes) < len(findings) or len(units) > 1:
        return ""
    low, high = number(min(sizes)), number(max(sizes))
    return with_unit(low if low == high else f"{low} to {high}", units.pop())


def _unbroken(value: Value) -> str:
    """A value with standard deviation and unit as text that does not break across lines."""
    return value_words(value).replace(" ", NO_BREAK).replace(f",{NO_BREAK}", ", ")


def share_curve(diagnosis: Diagnosis) -> str:
    """Draws the share of the gap that the n largest findings close together over n; empty for less than two findings.

    Shares are Shapley values, so the curve ends at the share that all findings close together.
    """
    shares = [finding.share for finding in diagnosis.findings]
    known = [share for share in shares if share is not None and np.isfinite(share)]
    if len(known) < 2 or len(known) < len(shares):
        return ""
    ranked = np.sort(known)[::-1]
    # Corrections below the noise floor can make the sum exceed the gap.
    together = 100 * np.minimum(np.concatenate([[0.0], np.cumsum(ranked)]), 1.0)
    curve = Curve(np.arange(len(together)), together, AFTER, 1.5, marked=True)
    panel = Panel("gap closed [%]", (curve,), rule=100.0, least=(0.0,))
    title = "Share of the gap that is closed against the number of effects added"
    return chart((panel,), "number of effects, the largest first", (5.7, 2.6), title)
