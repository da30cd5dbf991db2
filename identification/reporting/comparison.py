"""Compares diagnoses of one robot: verdicts, shares of the gap closed, and sizes of findings with their intervals."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from statistics import NormalDist

from identification.diagnosis.decision_rules import SIZES_DIFFER
from identification.diagnosis.result import Diagnosis, EffectAt, Finding, Gap, Value
from identification.reporting.stored.diagnosis_reader import FILE
from identification.words.diagnosis_words import (
    capital,
    joined,
    parameter_name,
    placed_effect,
    placed_finding,
    share_words,
)
from identification.words.geometry_words import all_findings
from identification.words.numbers_and_names import NO_BREAK, number, percent, percent_short_of_all, with_unit
from phantom_dyn.errors import ParameterError, printable, shortened

WIDTH = 100  # columns of the terminal
_NAME_WIDTH = 24  # columns for the name of a diagnosis or joint
INTERVAL = NormalDist().inv_cdf(0.975)
"""Half the width of a 95 % interval, in standard deviations."""


@dataclass(frozen=True)
class ComparedSize:
    """One parameter of a finding in every diagnosis.

    Attributes:
        parameter: Name of the parameter.
        values: One value per diagnosis, in their order; None if a diagnosis lacks the finding.
        changed: True if two values differ significantly; None if fewer than two can be compared.
    """

    parameter: str
    values: tuple[Value | None, ...]
    changed: bool | None


@dataclass(frozen=True)
class ComparedFinding:
    """One finding in every diagnosis.

    Attributes:
        at: Effect, joint, and the recording in which it acts.
        findings: One finding per diagnosis, in their order; None if a diagnosis lacks the finding.
        missing: For each diagnosis without the finding, its statement on the effect; empty for the others.
        sizes: The compared parameters.
    """

    at: EffectAt
    findings: tuple[Finding | None, ...]
    missing: tuple[str, ...]
    sizes: tuple[ComparedSize, ...]

    @property
    def changed(self) -> bool:
        """True if a diagnosis lacks the finding, or if one of the finding's parameters differs significantly."""
        return any(self.missing) or any(size.changed for size in self.sizes)


@dataclass(frozen=True)
class Comparison:
    """Comparison of several diagnoses; ``print`` shows the changes.

    Attributes:
        names: Names of the diagnoses, in the given order.
        diagnoses: The diagnoses.
        findings: All findings of all diagnoses, those that changed first.
    """

    names: tuple[str, ...]
    diagnoses: tuple[Diagnosis, ...]
    findings: tuple[ComparedFinding, ...]

    @property
    def changed(self) -> tuple[ComparedFinding, ...]:
        """Findings that a diagnosis lacks, or whose parameters differ significantly."""
        return tuple(finding for finding in self.findings if finding.changed)

    def __str__(self) -> str:
        return comparison_text(self)

    def __repr__(self) -> str:
        verdicts = " -> ".join(diagnosis.verdict for diagnosis in self.diagnoses)
        return f"Comparison of {joined(list(self.names))}: {verdicts}\n{_count_words(self)}"


def compare(diagnoses: Sequence[Diagnosis], names: Sequence[str]) -> Comparison:
    """Compares diagnoses.

    A parameter counts as changed if its difference between two diagnoses is significant at 5 %, with a Bonferroni
    correction over all compared parameters and pairs. Errors are taken as independent; if diagnoses share a recording,
    fewer changes are found.

    Args:
        diagnoses: Two or more diagnoses of the same joints.
        names: Name of each diagnosis.

    Raises:
        ParameterError: If there are fewer than two diagnoses, or if their joints differ.
    """
    if len(diagnoses) < 2:
        raise ParameterError(f"{len(diagnoses)} diagnosis was given, wanted two or more to compare.")
    _require_same_joints(diagnoses, names)
    diagnoses = [replace(one, findings=all_findings(one)) for one in diagnoses]
    places = dict.fromkeys(finding.effect_at for diagnosis in diagnoses for finding in diagnosis.findings)
    table = {
        at: tuple(
            next((finding for finding in diagnosis.findings if finding.effect_at == at), None)
            for diagnosis in diagnoses
        )
        for at in places
    }
    pairs = [pair for found in table.values() for values in _sizes(found).values() for pair in _pairs(values)]
    comparisons = max(1, sum(len(one.numbers) for one, _ in pairs))
    limit = NormalDist().inv_cdf(1 - (1 - SIZES_DIFFER) / (2 * comparisons))
    rows = [
        ComparedFinding(
            at,
            found,
            tuple(
                "" if one else _statement_without_finding(diagnosis, at)
                for one, diagnosis in zip(found, diagnoses, strict=True)
            ),
            tuple(ComparedSize(name, values, _differ(name, values, limit)) for name, values in _sizes(found).items()),
        )
        for at, found in table.items()
    ]
    return Comparison(tuple(names), tuple(diagnoses), tuple(sorted(rows, key=lambda row: not row.changed)))


def distinct_names(paths: Sequence[str | Path]) -> list[str]:
    """Shortest distinct names of files: the last folder or file name if possible, otherwise the path.

    A ``diagnosis.json`` at the end of a path is left out if possible.
    """
    folders = [str(Path(path).parent) if Path(path).name == FILE else str(path) for path in paths]
    for names in ([Path(folder).name for folder in folders], folders):
        if all(names) and len(set(names)) == len(names):
            return names
    return [str(path) for path in paths]


def comparison_text(found: Comparison) -> str:
    """The text of a comparison for a terminal: verdicts and gap, changed and unchanged findings, and residuals."""
    lines = list(first_lines(found))
    for head, rows in (
        ("Changed, with 95 % intervals:", found.changed),
        ("The same within the intervals:", tuple(row for row in found.findings if not row.changed)),
    ):
        if rows:
            lines += ["", head, *(line for row in rows for line in _row_lines(row))]
    if found.diagnoses[0].joints:
        lines += ["", "RMS residual on held-out samples: given model -> corrected model", *_joint_table(found)]
    runs = [diagnosis.run for diagnosis in found.diagnoses if diagnosis.run]
    if len(set(runs)) < len(runs):
        lines += ["", "At least two of these files are of the very same run."]
    return "\n".join(_wrapped(line) for line in lines).replace(NO_BREAK, " ")


def first_lines(found: Comparison) -> tuple[str, ...]:
    """Sentences on the verdicts, the gap, and the number of findings that changed."""
    verdicts = [diagnosis.verdict.replace("_", " ") for diagnosis in found.diagnoses]
    same = len(set(verdicts)) == 1
    return (
        f"The verdict is the same: {verdicts[0]}." if same else f"The verdict changed: {' -> '.join(verdicts)}.",
        f"Gap closed: {' -> '.join(_gap_words(diagnosis.gap) for diagnosis in found.diagnoses)}.",
        _count_words(found),
    )


def _require_same_joints(diagnoses: Sequence[Diagnosis], names: Sequence[str]) -> None:
    joints = [tuple(gap.joint for gap in diagnosis.joints) for diagnosis in diagnoses]
    for name, own in zip(names, joints, strict=True):
        if own != joints[0]:
            raise ParameterError(
                f"{names[0]} is of the joints {', '.join(joints[0])} and {name} of {', '.join(own)}: give diagnoses "
                "of one robot."
            )


def _sizes(found: Sequence[Finding | None]) -> dict[str, tuple[Value | None, ...]]:
    """Values of each parameter of a finding, in the order of the diagnoses."""
    names = dict.fromkeys(name for finding in found if finding for name in finding.parameters)
    return {name: tuple(finding.parameters.get(name) if finding else None for finding in found) for name in names}


def _pairs(values: Sequence[Value | None]) -> list[tuple[Value, Value]]:
    """Pairs of values that can be compared: both with known standard deviations, and equally many numbers."""
    usable = [value for value in values if value is not None and all(map(math.isfinite, value.stds))]
    return [pair for pair in combinations(usable, 2) if len(pair[0].numbers) == len(pair[1].numbers)]


def _differ(name: str, values: Sequence[Value | None], limit: float) -> bool | None:
    """True if two values differ by more than ``limit`` standard deviations; None if none can be compared."""
    pairs = _pairs(values)
    if not pairs:
        return None
    return any(
        abs(_difference(name, x, y)) > limit * math.hypot(s, r)
        for one, other in pairs
        for x, y, s, r in zip(one.numbers, other.numbers, one.stds, other.stds, strict=True)
    )


def _difference(name: str, x: float, y: float) -> float:
    """Difference of two values; of phases [rad] modulo 2 pi, between -pi and pi."""
    return math.remainder(y - x, 2 * math.pi) if name == "phase" else y - x


def _statement_without_finding(diagnosis: Diagnosis, at: EffectAt) -> str:
    """Statement of a diagnosis on an effect that is none of its findings."""
    if any(finding.effect_at == at for finding in diagnosis.minor):
        return "seen, but too small to matter"
    for finding in diagnosis.findings:
        for rival in finding.rivals:
            if at in rival.effects:
                return f"a rival of {placed_finding(finding)} ({percent(rival.probability)})"
    if any((entry.effect, entry.joint) == (at.effect, at.joint) for entry in diagnosis.not_testable):
        return "not testable there"
    for bound in diagnosis.bounds:
        if (bound.effect, bound.joint) == (at.effect, at.joint):
            least = with_unit(number(bound.below), bound.unit)
            return f"not found (a {parameter_name(bound.parameter)} of {least} would have shown)"
    return "not found"


def _row_lines(row: ComparedFinding) -> list[str]:
    """Lines on one finding: one per parameter; without parameters, one that states which diagnoses have the finding."""
    name = capital(placed_effect(row.at))
    out = []
    for size in row.sizes:
        pairs = zip(size.values, row.missing, strict=True)
        cells = [value_with_interval(value) or statement or "not found" for value, statement in pairs]
        verdict = {True: ", changed", False: ", the same", None: ""}[size.changed]
        out.append(f"  {name}, {parameter_name(size.parameter)}: {' -> '.join(cells)}{verdict}")
    if not row.sizes:
        pairs = zip(row.findings, row.missing, strict=True)
        cells = ["found" if finding else statement for finding, statement in pairs]
        out.append(f"  {name}: {' -> '.join(cells)}")
    return out


def value_with_interval(value: Value | None) -> str:
    """A value with its 95 % interval, as in ``0.251 (0.250 to 0.252) N m``; empty for None."""
    if value is None:
        return ""
    parts = []
    for x, std in zip(value.numbers, value.stds, strict=True):
        half = INTERVAL * std
        known = math.isfinite(half) and half > 0
        digits = max(0, 1 - math.floor(math.log10(half))) if known else 0
        plain = known and digits <= 8 and abs(x) < 1e6
        parts.append(f"{x:.{digits}f} ({x - half:.{digits}f} to {x + half:.{digits}f})" if plain else number(x))
    return with_unit(", ".join(parts), value.unit)


def _gap_words(gap: Gap) -> str:
    if gap.closed is None:
        return "no gap"
    return percent_short_of_all(gap.closed) if gap.interval is None else share_words(gap.closed, gap.interval)


def _count_words(found: Comparison) -> str:
    if not found.findings:
        return "None of them has a finding."
    count = len(found.changed)
    return f"{count if count else 'None'} of {len(found.findings)} findings changed."


def _joint_table(found: Comparison) -> list[str]:
    """Table of residuals: one line per joint, one column per diagnosis."""
    names = [shortened(name, _NAME_WIDTH) for name in found.names]
    joints = [shortened(gap.joint, _NAME_WIDTH) for gap in found.diagnoses[0].joints]
    width = max(len("joint"), *map(len, joints))
    columns = [max(len(name), 20) for name in names]
    lines = [f"{'joint':<{width}}" + "".join(f"  {name:>{w}}" for name, w in zip(names, columns, strict=True))]
    for k, joint in enumerate(joints):
        gaps = [diagnosis.joints[k] for diagnosis in found.diagnoses]
        cells = [f"{number(gap.rms_before)} -> {number(gap.rms_after)}" for gap in gaps]
        row = "".join(f"  {cell:>{w}}" for cell, w in zip(cells, columns, strict=True))
        lines.append(f"{joint:<{width}}{row}  {gaps[0].unit}")
    return lines


def _wrapped(line: str) -> str:
    """A line broken at the width of the terminal; further lines are indented more."""
    indent = line[: len(line) - len(line.lstrip())]
    text = printable(line)
    if len(text) <= WIDTH:
        return text
    return textwrap.fill(text, WIDTH, subsequent_indent=f"{indent}    ", break_on_hyphens=False)
