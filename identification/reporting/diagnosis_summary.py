"""Writes the summary of a diagnosis for a terminal: plain text without colour, at most 100 columns wide."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from identification.diagnosis.result import Diagnosis, Finding, JointGap, Value
from identification.engine import contract_levels
from identification.notes import Remark
from identification.words import diagnosis_words as words
from identification.words.diagnosis_words import ratio_words
from identification.words.geometry_words import geometry_sentences
from identification.words.law_words import law_line
from identification.words.note_words import sentences as note_sentences
from identification.words.numbers_and_names import (
    NO_BREAK,
    number,
    percent_short_of_all,
    value_words,
)
from identification.words.verdict_words import closed_by_tolerances, verdict_sentence
from phantom_dyn.errors import printable, shortened

WIDTH = 100
NOTES = 5
"""Largest number of notes and warnings; the report has all of them."""
MOST_FINDINGS = 20
"""Largest number of findings; the report has all of them."""
NAME_WIDTH = 36
"""Largest number of letters of a joint's name."""
MOST_SIZES = 4
"""Largest number of parameters of a finding that are listed; the report has all of them."""
_DIFFERS = 2.0  # a parameter counts as different from zero above this number of standard deviations


def summary(diagnosis: Diagnosis) -> str:
    """The summary: verdict, gap, findings with their sizes, a table of joints, and the most important notes."""
    poses = [] if diagnosis.geometry is None else [_wrapped(" ".join(geometry_sentences(diagnosis.geometry)))]
    diagnosis = diagnosis.with_torque_verdict
    blocks = poses if diagnosis.poses_alone else [*_torque_blocks(diagnosis), *([""] if poses else []), *poses]
    proposed = next_experiment_lines(diagnosis)
    if proposed:
        blocks += ["", *proposed]
    notes = _notes(diagnosis)
    if notes:
        blocks += ["", *(_wrapped(note, "  ") for note in notes[:NOTES])]
    if len(notes) > NOTES:
        blocks.append(f"  {len(notes) - NOTES} more in the report.")
    return "\n".join(blocks).replace(NO_BREAK, " ")


def next_experiment_lines(diagnosis: Diagnosis) -> list[str]:
    """Lines on the motion to record next; empty if the diagnosis proposes none."""
    proposal = (diagnosis.next_experiment or {}).get("say")
    return [_wrapped(f"Next experiment: {proposal}")] if proposal else []


def note_lines(notes: Sequence[Remark]) -> list[str]:
    """Lines of notes."""
    return [_wrapped(f"Note: {sentence}", "  ") for sentence in note_sentences(notes)]


def written_lines(written: Sequence[Path], out: Path | None) -> list[str]:
    """Lines that name the written files: one line for all files in the folder, one for each other file.

    Args:
        written: Paths of the files.
        out: Output folder of the run; None without one.
    """
    inside = [path.name for path in written if path.parent == out]
    lines = [f"wrote {path}" for path in written if path.parent != out]
    return [*([_wrapped(f"wrote {out}: {', '.join(inside)}", hanging="  ")] if inside else []), *lines]


def _torque_blocks(diagnosis: Diagnosis) -> list[str]:
    """Paragraphs on the torques: verdict, gap, findings, and the table of joints."""
    return [
        _wrapped(verdict_sentence(diagnosis)),
        *(_wrapped(line) for line in _gap_line(diagnosis)),
        *(_wrapped(line, "  ") for line in _finding_lines(diagnosis.findings)),
        *_law_lines(diagnosis),
        "",
        "RMS position error of held-out rests" if diagnosis.at_rest else "RMS torque residual on held-out samples",
        *_gap_table(diagnosis.joints),
        *_worse_in_tolerance(diagnosis.joints),
        *_may_be_noise(diagnosis),
    ]


def _law_lines(diagnosis: Diagnosis) -> list[str]:
    """Lines on the law of the residual; empty for an explained gap, whose small residual is only in the report."""
    line = "" if diagnosis.verdict == "explained" else law_line(diagnosis.unexplained)
    return [_wrapped(line)] if line else []


def _gap_line(diagnosis: Diagnosis) -> list[str]:
    """Share of the gap that is closed, and the residuals of the joint that contributes most; empty without a gap."""
    gap = diagnosis.gap
    if gap.closed is None or not diagnosis.findings:
        return []
    share = percent_short_of_all(gap.closed) if gap.interval is None else words.share_words(gap.closed, gap.interval)
    by_tolerances = closed_by_tolerances(diagnosis)
    by = "" if by_tolerances is None else f" ({percent_short_of_all(gap.closed - by_tolerances)} by the findings)"
    joint = max(diagnosis.joints, key=_closed_squares)
    where = ("" if len(diagnosis.joints) == 1 else "most on ") + words.joints_words([joint.joint])
    return [
        f"{words.capital(share)} of the gap is closed{by}, {where}: {number(joint.without_findings)} -> "
        f"{number(joint.rms_after)} {joint.unit} (noise floor {number(joint.noise_floor)})."
    ]


def _closed_squares(joint: JointGap) -> float:
    """Decrease of a joint's mean square residual by the findings, divided by its squared noise floor."""
    if joint.noise_floor <= 0.0:
        return 0.0
    return (joint.without_findings**2 - joint.rms_after**2) / joint.noise_floor**2


def _notes(diagnosis: Diagnosis) -> list[str]:
    """Sentences on data and findings. Warnings come first, as the result may depend on them."""
    out = [f"Warning: {warning}" for warning in note_sentences(diagnosis.data_warnings)]
    if diagnosis.minor:
        names = words.joined([words.placed_finding(finding) for finding in diagnosis.minor])
        out.append(f"Also visible, too small to matter: {names}.")
    if diagnosis.verdict in ("explained", "no_gap") and diagnosis.adjusted:
        count = len(diagnosis.adjusted)
        out.append(f"{count} modelled {'quantity' if count == 1 else 'quantities'} moved within tolerance.")
    return [*out, *(f"Note: {note}" for note in note_sentences(diagnosis.notes))]


def _finding_lines(findings: tuple[Finding, ...]) -> list[str]:
    lines = [f"{k}. {_finding_line(finding)}" for k, finding in enumerate(findings[:MOST_FINDINGS], start=1)]
    more = len(findings) - len(lines)
    return [*lines, f"{more} more in the report and in diagnosis.json (--out DIR)."] if more else lines


def _finding_line(finding: Finding) -> str:
    grown = ratio_words(finding)
    known = words.shown_parameters(finding)
    values = {name: value for name, value in known.items() if not (grown and name == "ratio")}
    not_shown = words.not_shown_words(finding)
    size = (f": {_sizes(values)}" if values else "") + grown + (f" ({not_shown})" if not_shown else "")
    sure = f"{words.certainty_words(finding.probability)}, {words.share_of_gap_words(finding)}"
    rivals = words.rivals_words(finding)
    return "; ".join([words.capital(words.placed_finding(finding)) + size, sure, *([rivals] if rivals else [])])


def _sizes(values: Mapping[str, Value]) -> str:
    """Parameters with their standard deviations; with their names if there are several.

    Of many parameters, those that differ most significantly from zero are shown, in their given order.
    """
    if len(values) == 1:
        return value_words(next(iter(values.values())))
    shown = values
    if len(values) > MOST_SIZES:
        ranked = sorted(values.items(), key=_certainty, reverse=True)
        chosen = {name for name, value in ranked[:MOST_SIZES] if _certainty((name, value)) > _DIFFERS}
        shown = {name: value for name, value in values.items() if name in chosen}
    sizes = [f"{words.parameter_name(name)} {value_words(value)}" for name, value in shown.items()]
    more = len(values) - len(shown)
    if more:
        sizes.append(f"{more} more in the report" if shown else f"{more} sizes in the report")
    return ", ".join(sizes)


def _certainty(size: tuple[str, Value]) -> float:
    """Number of standard deviations by which a parameter differs from zero; the largest number for a list."""
    value = size[1]
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        deviations = np.nan_to_num(np.abs(np.atleast_1d(value.value)) / np.atleast_1d(value.std), posinf=np.inf)
    return float(np.max(deviations, initial=0.0))


def _gap_table(joints: tuple[JointGap, ...]) -> list[str]:
    """Table of residuals and noise floors, one line per joint."""
    names = [shortened(joint.joint, NAME_WIDTH) for joint in joints]
    width = max([len("joint"), *map(len, names)])
    within = any(joint.rms_within_tolerance is not None for joint in joints)
    heads = ("given", *(("in tolerance",) if within else ()), "corrected", "noise floor")
    rows = []
    for name, joint in zip(names, joints, strict=True):
        in_tolerance = (joint.tolerated,) if within else ()
        figures = (joint.rms_before, *in_tolerance, joint.rms_after, joint.noise_floor)
        cells = "  ".join(f"{number(value) if joint.hold_out_samples else 'not judged':>12}" for value in figures)
        rows.append(f"{name:<{width}}  {cells}  {joint.unit}")
    return [f"{'joint':<{width}}  " + "  ".join(f"{head:>12}" for head in heads), *rows]


def _worse_in_tolerance(joints: tuple[JointGap, ...]) -> list[str]:
    """Explains why joints have a larger residual after changes within tolerances; empty if no joint has."""
    worse = [joint.joint for joint in joints if joint.worse_adjusted]
    if not worse:
        return []
    return [
        _wrapped(
            f"In tolerance {words.joints_words(worse)} {'is' if len(worse) == 1 else 'are'} worse than given: changes "
            "within the tolerances are fitted to all joints at once, and compensate what is missing on others."
        )
    ]


def _may_be_noise(diagnosis: Diagnosis) -> list[str]:
    """Explains why joints with a residual of several noise floors may have no gap; empty without such joints.

    A joint whose residual has structure is left out, because noise has no structure.
    """
    joints = [joint for joint in diagnosis.joints if joint.joint != diagnosis.unexplained.joint]
    doubtful = [joint for joint in joints if _explained_by_noise(joint)]
    if not doubtful:
        return []
    widest = max(doubtful, key=lambda joint: joint.rms_after / joint.noise_floor)
    names = words.joints_words([joint.joint for joint in doubtful])
    where = f" on {widest.joint}" if len(doubtful) > 1 else ""
    return [
        _wrapped(
            f"What is left on {names} may be no gap: noise and the errors of a sound model reach up to "
            f"{number(widest.allowed)} {widest.unit}{where}."
        )
    ]


def _explained_by_noise(joint: JointGap) -> bool:
    """True if a joint counts as explained, or without a gap, only because its noise may be as large as its limit."""
    within_limit = contract_levels.FLOORS_LEFT * joint.noise_floor < joint.rms_after <= joint.allowed
    return bool(within_limit and (joint.closed is None or joint.closed < 1.0 - contract_levels.GAP_LEFT))


def _wrapped(text: str, indent: str = "", hanging: str | None = None) -> str:
    """Text broken at the width of the terminal, with indents of the first line and of further lines."""
    if hanging is None:
        hanging = indent + "   " if indent else ""
    return textwrap.fill(
        printable(text), WIDTH, initial_indent=indent, subsequent_indent=hanging, break_on_hyphens=False
    )
