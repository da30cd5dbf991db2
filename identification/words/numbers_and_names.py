"""Numbers and names as text: values with their deviation and unit, percentages, names that fit a terminal."""

from __future__ import annotations

import math
from dataclasses import replace
from math import fsum

from identification.diagnosis.result import Diagnosis, Finding, JointGap, Value
from identification.engine import contract_levels
from phantom_dyn.effects.catalogue import known_effect
from phantom_dyn.errors import printable

NO_BREAK = "\N{NO-BREAK SPACE}"  # a number never parts from its unit at the end of a line


def value_words(value: Value) -> str:
    """An estimate as ``0.0510 ± 0.0006 N m``; entries of a list are separated by commas."""
    values = value.value if isinstance(value.value, list) else [value.value]
    stds = value.std if isinstance(value.std, list) else [value.std] * len(values)
    numbers = ", ".join(with_std(v, s) for v, s in zip(values, stds, strict=True))
    return with_unit(numbers, value.unit)


def with_unit(text: str, unit: str) -> str:
    """A number with its unit; ``1``, the unit of a ratio, is not written."""
    return text if unit in ("", "1") else f"{text} {unit}"


def with_std(value: float, std: float) -> str:
    """A number with its standard deviation, both to the second digit of the latter."""
    if not (math.isfinite(std) and std > 0 and math.isfinite(value)):
        return number(value)
    largest = max(abs(value), std)
    exponent = math.floor(math.log10(largest))
    digits = max(0, 1 - math.floor(math.log10(std)))
    if -4 <= exponent <= 5 and digits <= 8:
        return f"{_no_minus_zero(f'{value:.{digits}f}')} ± {std:.{digits}f}"
    scale = 10.0**exponent
    digits = min(12, max(0, 1 - math.floor(math.log10(std / scale))))
    return f"({value / scale:.{digits}f} ± {std / scale:.{digits}f})e{exponent}"


def _no_minus_zero(text: str) -> str:
    """A rounded number; zero has no sign."""
    return text if float(text) else text.removeprefix("-")


def number(value: float, digits: int = 3) -> str:
    """Significant digits, below a million without an exponent; a dash where there is no number."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text


def percent(share: float) -> str:
    """A share as a percentage, never rounded to none, less than none or all; a dash where there is no number."""
    if not math.isfinite(share):
        return "–"
    if 0 < abs(share) < 0.005:
        return f"under 1{NO_BREAK}%"
    if 0.995 <= share < 1:
        return f"over 99{NO_BREAK}%"
    return f"{100 * share:.0f}{NO_BREAK}%"


def percent_short_of_all(share: float) -> str:
    """A share that no recording shows to be all: of a gap, or the probability of a cause; ``over 99 %`` is the most."""
    return percent(min(share, 0.999))


def cut_name(name: str, width: int) -> str:
    """A name for a column of a terminal: printable, and cut where it is longer than ``width``."""
    name = printable(name)
    return name if len(name) <= width else f"{name[: width - 1]}…"


def with_stated_probabilities(diagnosis: Diagnosis) -> Diagnosis:
    """A diagnosis with the probabilities that texts state, see `beside_what_is_left`.

    Its file keeps those of the comparison among the effects of the catalogue, which sum to one.
    """
    findings, minor = (
        tuple(beside_what_is_left(finding, diagnosis.joints) for finding in some)
        for some in (diagnosis.findings, diagnosis.minor)
    )
    return replace(diagnosis, findings=findings, minor=minor)


def beside_what_is_left(finding: Finding, joints: tuple[JointGap, ...]) -> Finding:
    """The same finding with lower probabilities where its joint is left with more than noise.

    A comparison among the effects of the catalogue says which of them is best, and not that one of them is right. Where
    the best ones leave a share of the joint's gap, whatever makes that share may have made what they explain. So what
    is missing to one is the probability of a cause outside the catalogue.

    Args:
        finding: With rivals of the catalogue; their probabilities and its own sum to one.
        joints: Gaps of all joints, before and after all findings.
    """
    own = [joint for joint in joints if joint.joint in (finding.joint or "").split("+")]
    named = min(map(_named, own)) if own else fsum(map(_named, joints)) / len(joints)
    known = known_effect(finding.effect)
    # What is noise alone is read off the readings, and compared with nothing.
    if (known is not None and known.only_noise) or 1.0 - named < contract_levels.LISTED:
        return finding
    rivals = tuple(replace(rival, probability=named * rival.probability) for rival in finding.rivals)
    return replace(finding, probability=named * finding.probability, rivals=rivals)


def _named(joint: JointGap) -> float:
    """Share of a joint's gap that findings close; one where no more than noise is left."""
    quiet = joint.rms_after <= contract_levels.FLOORS_LEFT * joint.noise_floor
    return 1.0 if quiet or joint.closed is None else min(max(joint.closed, 0.0), 1.0)
