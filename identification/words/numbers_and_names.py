"""Formats numbers as text: values with standard deviation and unit, percentages, and probabilities of findings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from math import fsum

from identification.diagnosis.result import Diagnosis, Finding, JointGap, Value
from identification.engine import contract_levels
from identification.notes import Note
from phantom_dyn.effects.catalogue import known_effect

NO_BREAK = "\N{NO-BREAK SPACE}"  # keeps a number and its unit on one line


def value_words(value: Value) -> str:
    """An estimate as ``0.0510 ± 0.0006 N m``; several values are separated by commas."""
    return with_unit(", ".join(map(with_std, value.numbers, value.stds)), value.unit)


def with_unit(text: str, unit: str) -> str:
    """A number with its unit; the unit of a ratio, ``1``, is left out."""
    return text if unit in ("", "1") else f"{text} {unit}"


def with_std(value: float, std: float) -> str:
    """A number with its standard deviation, both rounded to the second digit of the deviation."""
    if not (math.isfinite(std) and std > 0 and math.isfinite(value)):
        return number(value)
    exponent = math.floor(math.log10(max(abs(value), std)))
    digits = max(0, 1 - math.floor(math.log10(std)))
    if -4 <= exponent <= 5 and digits <= 8:
        return f"{_no_minus_zero(f'{value:.{digits}f}')} ± {std:.{digits}f}"
    scale = 10.0**exponent
    digits = min(12, max(0, 1 - math.floor(math.log10(std / scale))))
    return f"({value / scale:.{digits}f} ± {std / scale:.{digits}f})e{exponent}"


def _no_minus_zero(text: str) -> str:
    """A rounded number without the sign of ``-0``."""
    return text if float(text) else text.removeprefix("-")


def number(value: float, digits: int = 3) -> str:
    """A number with ``digits`` significant digits, below a million without an exponent; a dash if it is not finite."""
    if not math.isfinite(value):
        return "–"
    text = _no_minus_zero(f"{value:.{digits}g}")
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text


def percent(share: float) -> str:
    """A share as a percentage; ``0 %`` and ``100 %`` only for exactly these shares; a dash if it is not finite."""
    if not math.isfinite(share):
        return "–"
    if 0 < abs(share) < 0.005:
        return f"under 1{NO_BREAK}%"
    if 0.995 <= share < 1:
        return f"over 99{NO_BREAK}%"
    return f"{100 * share:.0f}{NO_BREAK}%"


def percent_short_of_all(share: float) -> str:
    """A share as a percentage of at most ``over 99 %``, because no recording can prove 100 % of a gap."""
    return percent(min(share, 0.999))


def with_stated_probabilities(diagnosis: Diagnosis) -> Diagnosis:
    """A diagnosis whose findings have the probabilities that texts state, from `with_cause_outside_catalogue`.

    The probabilities in ``diagnosis.json`` are those of the comparison with effects of the catalogue and with
    structures without a name.
    """
    findings, minor = (
        tuple(with_cause_outside_catalogue(finding, diagnosis.joints) for finding in some)
        for some in (diagnosis.findings, diagnosis.minor)
    )
    return replace(diagnosis, findings=findings, minor=minor)


def with_cause_outside_catalogue(finding: Finding, joints: tuple[JointGap, ...]) -> Finding:
    """The finding with lower probabilities if the residual of its joint is larger than noise after all findings.

    A comparison among the effects of the catalogue shows which of them fits best, but not that one of them is right. If
    a share of the joint's gap remains, its unknown cause may also cause the part that the finding explains. So all
    probabilities are multiplied by the closed share of the gap. One minus their sum is the probability of a cause
    outside the catalogue.

    Args:
        finding: Finding with rivals of the catalogue; their probabilities and its own sum to at most one.
        joints: Gaps of all joints, before and after all findings.
    """
    own = [joint for joint in joints if joint.joint in (finding.joint or "").split("+")]
    closed = min(map(_closed_share, own)) if own else fsum(map(_closed_share, joints)) / len(joints)
    known = known_effect(finding.effect)
    # An effect that only adds noise, such as encoder resolution, is measured from the readings and has no rivals.
    if (known is not None and known.only_noise) or 1.0 - closed < contract_levels.LISTED:
        return finding
    rivals = tuple(replace(rival, probability=closed * rival.probability) for rival in finding.rivals)
    return replace(finding, probability=closed * finding.probability, rivals=rivals)


def _closed_share(joint: JointGap) -> float:
    """Share of a joint's gap that findings close; one if the residual is only noise."""
    is_noise = joint.rms_after <= contract_levels.FLOORS_LEFT * joint.noise_floor
    return 1.0 if is_noise or joint.closed is None else min(max(joint.closed, 0.0), 1.0)


def filled(template: str) -> Callable[[Note], str]:
    """A function that builds the sentence of a note by filling a template with the note's joint and numbers."""
    return lambda note: template.format(joint=note.joint, **note.numbers)
