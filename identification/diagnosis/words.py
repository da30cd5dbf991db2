"""A diagnosis in plain words: the verdict, and for each finding what, where, how sure, what else, what next."""

from __future__ import annotations

import math
from dataclasses import dataclass

from identification.diagnosis.effect_words import effect_words, regime_words
from identification.diagnosis.result import Diagnosis, EffectAt, Finding, Rival, Unexplained, Value

SURENESS = ((0.99, "practically certain"), (0.9, "very likely"), (0.7, "likely"), (0.5, "more likely than not"))
NO_BREAK = "\N{NO-BREAK SPACE}"  # a number never parts from its unit at the end of a line
NO_RIVAL = "nothing else in the catalogue explains the data as well"


@dataclass(frozen=True)
class FindingWords:
    """One finding, each part a phrase without a full stop; `what_next` is a sentence."""

    what: str
    meaning: str
    where: str
    how_sure: str
    gap_closed: str
    what_else: str
    what_next: str


def finding_words(finding: Finding) -> FindingWords:
    """The parts of one finding in words."""
    return FindingWords(
        what=finding_name(finding),
        meaning=effect_words(finding.effect).meaning,
        where=", ".join(part for part in (place(finding.effect, finding.joint), regime_words(finding.regime)) if part),
        how_sure=sureness(finding.probability),
        gap_closed=gap_closed(finding),
        what_else=rivals_words(finding.rivals),
        what_next=effect_words(finding.effect).next_step,
    )


def finding_sentence(finding: Finding) -> str:
    """One finding as a single sentence."""
    words = finding_words(finding)
    return (
        f"{capital(words.what)}, {words.where}: {words.how_sure}, accounts for {words.gap_closed} of the gap; "
        f"{words.what_else}; next: {words.what_next[0].lower()}{words.what_next[1:]}"
    )


def finding_name(finding: Finding) -> str:
    """Plain name of the effect; a negative size is named for what it is: less than modelled."""
    words = effect_words(finding.effect)
    first = next(iter(finding.parameters.values()), None)
    negative = first is not None and not isinstance(first.value, list) and first.value < 0
    return words.less if negative and words.less else words.name


def place(effect: str, joint: str | None) -> str:
    """``joint j2``; of a coupling ``joints j2 and j3``; the whole robot for None."""
    if joint is None:
        return "the whole robot"
    first, plus, second = joint.partition("+")
    if effect == "joint_coupling" and plus:
        return f"joints {first} and {second}"
    return f"joint {joint}"


def effect_at(at: EffectAt) -> str:
    """An effect with its place, as in ``a payload`` or ``Coulomb friction on joint j2``."""
    name = effect_words(at.effect).name
    return name if at.joint is None else f"{name} on {place(at.effect, at.joint)}"


def effect_at_finding(finding: Finding) -> str:
    """A finding with its place, as in ``viscous friction on joint j1``."""
    name = finding_name(finding)
    return name if finding.joint is None else f"{name} on {place(finding.effect, finding.joint)}"


def rivals_words(rivals: tuple[Rival, ...]) -> str:
    """What else a finding may be, most probable first."""
    if not rivals:
        return NO_RIVAL
    ranked = sorted(rivals, key=lambda rival: -rival.probability)
    return "it may instead be " + "; or ".join(
        f"{joined([effect_at(at) for at in rival.effects])}{' together' if len(rival.effects) > 1 else ''} "
        f"({percent(rival.probability)})"
        for rival in ranked
    )


def sureness(probability: float) -> str:
    """A probability as words and number."""
    words = next((words for least, words in SURENESS if probability >= least), "one of several candidates")
    return f"{words} ({percent(probability)})"


def gap_closed(finding: Finding) -> str:
    """Share of the gap that a finding accounts for, with its interval."""
    low, high = finding.gap_closed_interval
    return f"{percent(finding.gap_closed)} ({percent(low).removesuffix(f'{NO_BREAK}%')} to {percent(high)})"


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    names = [effect_at_finding(finding) for finding in diagnosis.findings]
    named = joined(names) if len(names) <= 4 else f"{joined(names[:3], last=', ')} and {len(names) - 3} more"
    rest = diagnosis.unexplained
    if diagnosis.verdict == "explained":
        return f"The gap between robot and model is explained by {named or 'what was adjusted'}."
    if diagnosis.verdict == "partly_explained":
        return f"Part of the gap between robot and model is explained by {named}; {rest_phrase(rest)}."
    if diagnosis.verdict == "unknown":
        found = f" ({named} found, but not enough)" if names else ""
        return (
            f"There is a gap between robot and model that the catalogue does not explain{found}: {rest_phrase(rest)}."
        )
    if diagnosis.verdict == "no_gap":
        return "The model fits the robot: nothing was found beyond noise and the tolerances that the model states."
    if diagnosis.verdict == "not_testable":
        return "This recording cannot show a gap at all: record a motion that excites the joints, then diagnose again."
    return f"The verdict is {diagnosis.verdict.replace('_', ' ')}."


def rest_phrase(rest: Unexplained) -> str:
    """What is left unexplained: how much, whether it has structure, and where."""
    where = [place("", rest.joint) if rest.joint else "", regime_words(rest.regime)]
    at = ", ".join(part for part in where if part)
    share = percent(rest.fraction_of_explainable)
    if not rest.structured:
        return f"{share} of what could be explained is left, without structure that another effect could explain"
    return f"{share} of what could be explained is left" + (f", mostly at {at}" if rest.joint else f", {at}" * bool(at))


def value_words(value: Value) -> str:
    """An estimate as ``0.0510 ± 0.0006 N m``; entries of a list are parted by commas."""
    values = value.value if isinstance(value.value, list) else [value.value]
    stds = value.std if isinstance(value.std, list) else [value.std] * len(values)
    numbers = ", ".join(with_std(v, s) for v, s in zip(values, stds, strict=True))
    return with_unit(numbers, value.unit)


def with_unit(text: str, unit: str) -> str:
    """A number with its unit; ``1``, the unit of a ratio, is not written."""
    return text if unit in ("", "1") else f"{text} {unit}"


def parameter_name(name: str) -> str:
    """``torque positive`` for ``torque_positive``; the parameters of a body keep the body's name as it is."""
    return name if "." in name else name.replace("_", " ")


def with_std(value: float, std: float) -> str:
    """A number with its standard deviation, both to the second digit of the latter."""
    if not (math.isfinite(std) and std > 0 and math.isfinite(value)):
        return number(value)
    largest = max(abs(value), std)
    exponent = math.floor(math.log10(largest))
    digits = max(0, 1 - math.floor(math.log10(std)))
    if -4 <= exponent <= 5 and digits <= 8:
        return f"{value:.{digits}f} ± {std:.{digits}f}"
    scale = 10.0**exponent
    digits = min(12, max(0, 1 - math.floor(math.log10(std / scale))))
    return f"({value / scale:.{digits}f} ± {std / scale:.{digits}f})e{exponent}"


def number(value: float) -> str:
    """Three significant digits; a dash where there is no number."""
    return f"{value:.3g}" if math.isfinite(value) else "–"


def percent(share: float) -> str:
    """A share as a percentage, never rounded to none or all; a dash where there is no number."""
    if not math.isfinite(share):
        return "–"
    if 0 < share < 0.005:
        return f"under 1{NO_BREAK}%"
    if 0.995 <= share < 1:
        return f"over 99{NO_BREAK}%"
    return f"{100 * share:.0f}{NO_BREAK}%"


def joined(parts: list[str], last: str = " and ") -> str:
    """``a, b and c``."""
    return parts[0] if len(parts) == 1 else last.join([", ".join(parts[:-1]), parts[-1]]) if parts else ""


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]
