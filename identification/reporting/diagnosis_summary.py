"""The diagnosis as a few lines for a terminal: plain text, no colour, at most 100 columns."""

from __future__ import annotations

import textwrap

from identification.diagnosis.result import Diagnosis, Finding, JointGap
from identification.words import diagnosis_words as words
from identification.words.diagnosis_words import growth_words
from identification.words.numbers_and_names import NO_BREAK, cut_name, number, printable, value_words

WIDTH = 100
NAME_WIDTH = 36


def summary(diagnosis: Diagnosis) -> str:
    """Verdict, one line a finding, gap per joint, and what the user should know about the data."""
    blocks = [
        _wrapped(words.verdict_sentence(diagnosis)),
        *(_wrapped(line, "  ") for line in _finding_lines(diagnosis.findings)),
        "",
        "RMS position error of held-out rests" if diagnosis.at_rest else "RMS torque residual on held-out samples",
        *_gap_table(diagnosis.joints),
    ]
    if diagnosis.verdict in ("explained", "no_gap") and diagnosis.adjusted:
        count = len(diagnosis.adjusted)
        blocks += [
            "",
            _wrapped(f"{count} modelled {'quantity' if count == 1 else 'quantities'} moved within tolerance."),
        ]
    proposal = (diagnosis.next_experiment or {}).get("say")
    if proposal:
        blocks += ["", _wrapped(f"Next experiment: {proposal}")]
    if diagnosis.notes:
        blocks += ["", *(_wrapped(f"Note: {note}", "  ") for note in diagnosis.notes)]
    if diagnosis.data_warnings:
        blocks += ["", *(_wrapped(f"Warning: {warning}", "  ") for warning in diagnosis.data_warnings)]
    return "\n".join(blocks).replace(NO_BREAK, " ")


def _finding_lines(findings: tuple[Finding, ...]) -> list[str]:
    return [f"{k}. {_finding_line(finding)}" for k, finding in enumerate(findings, start=1)]


def _finding_line(finding: Finding) -> str:
    grown = growth_words(finding)
    values = [value for name, value in finding.parameters.items() if not (grown and name == "ratio")]
    sizes = ", ".join(value_words(value) for value in values)
    size = (f": {sizes}" if sizes and len(values) <= 2 else "") + grown
    sure = f"{words.sureness(finding.probability)}, {words.gap_closed(finding)} of the gap"
    rivals = f"; {words.rivals_words(finding.rivals)}" if finding.rivals else ""
    return f"{words.capital(words.effect_at_finding(finding))}{size}; {sure}{rivals}"


def _gap_table(joints: tuple[JointGap, ...]) -> list[str]:
    names = [cut_name(joint.joint, NAME_WIDTH) for joint in joints]
    width = max([len("joint"), *map(len, names)])
    head = f"{'joint':<{width}}  {'before':>10}  {'after':>10}  {'noise floor':>11}"
    rows = [
        f"{name:<{width}}  {number(j.rms_before):>10}  {number(j.rms_after):>10}  {number(j.noise_floor):>11}  {j.unit}"
        for name, j in zip(names, joints, strict=True)
    ]
    return [head, *rows]


def _wrapped(text: str, indent: str = "") -> str:
    hanging = indent + "   " if indent else ""
    return textwrap.fill(
        printable(text), WIDTH, initial_indent=indent, subsequent_indent=hanging, break_on_hyphens=False
    )
