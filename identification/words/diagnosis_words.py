"""Sentences on a finding: its effect, place, certainty, rivals and next step. The verdict is in `verdict_words`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from identification.diagnosis.result import EffectAt, Finding, Value
from identification.engine import contract_levels
from identification.geometry.terms import TOOL_POSE
from identification.words.effect_words import (
    is_between_joints,
    is_shared,
    regime_sentence,
    shortfall_words,
    size_words,
    words_of,
)
from identification.words.numbers_and_names import NO_BREAK, percent, percent_short_of_all, value_words

if TYPE_CHECKING:
    from identification.geometry.result import PoseFinding

UNDECIDED = 0.5  # probability below which a finding is called undecided

CERTAINTY = (
    (0.99, "practically certain"),
    (0.9, "very likely"),
    (0.7, "likely"),
    (0.505, "more likely than not"),
    (0.495, "as likely as not"),
)
PROPOSED = "Record the next experiment that is proposed below: it separates the causes that are left."
_ON_AVERAGE = " on average"
_MOST_NAMED_PARAMETERS = 4  # largest number of parameters that a sentence lists by name
NO_RIVAL = "nothing else in the catalogue explains the data as well"


def in_recording(recording: str | None) -> str:
    """`` in b.csv`` for an effect of one recording; empty for an effect of all recordings."""
    return "" if recording is None else f" in {recording}"


def ratio_words(finding: Finding) -> str:
    """``, where it is 2.1 times what it is in the other recordings``; empty if the ratio is not known."""
    # Some effects have a parameter ``ratio`` of their own, which does not compare recordings.
    own = "ratio" in words_of(finding).parameters
    ratio = None if own else finding.parameters.get("ratio")
    if finding.recording is None or ratio is None:
        return ""
    return f", where it is {value_words(ratio)} times what it is in the other recordings"


@dataclass(frozen=True)
class FindingWords:
    """One finding in whole sentences.

    Attributes:
        what: The effect, its size, its place and its meaning.
        where: The part of the motion in which it shows.
        how_sure: Probability and share of the gap.
        what_else: Rivals.
        what_next: Advice.
    """

    what: str
    where: str
    how_sure: str
    what_else: str
    what_next: str


def finding_words(finding: Finding, next_experiment: Mapping[str, Any] | None = None) -> FindingWords:
    """One finding in sentences.

    Args:
        finding: The finding.
        next_experiment: Proposed experiment of the diagnosis. It is the advice for findings that it separates.
    """
    rivals = rivals_words(finding) or NO_RIVAL
    return FindingWords(
        what=f"The recording shows {_shown(finding)}.",
        where=regime_sentence(finding.regime),
        how_sure=f"This is {certainty_words(finding.probability)}; it accounts for {share_of_gap_words(finding)}.",
        what_else=f"{capital(rivals)}.",
        what_next=_next_step(finding, next_experiment or {}),
    )


def _shown(finding: Finding) -> str:
    """Effect, size, place and meaning, as in ``a payload of 2 kg: a mass that the model does not carry``."""
    words, size = words_of(finding), _size(finding)
    where = f" {on_place(finding.effect, finding.joint)}" if finding.joint is not None else ""
    where += in_recording(finding.recording) + ratio_words(finding)
    if _is_less(finding):
        return f"{words.less}{where}, {size}"
    if size.startswith(":"):  # the size is a clause of its own
        return f"{words.name}{where}{size}"
    head = f"{words.name} {size}".rstrip()
    return f"{head}{where}" + (f": {words.meaning}" if words.meaning != words.name else "")


def finding_name(finding: Finding) -> str:
    """Plain name of the effect; for a negative size a name that says ``less`` than modelled."""
    words = words_of(finding)
    return words.less if _is_less(finding) else words.name


def on_place(effect: str, joint: str | None) -> str:
    """``on joint j2``; for a coupling ``between joints j2 and j3``; for None ``on the robot as a whole``."""
    if joint is None:
        return "on the robot as a whole"
    where = place(effect, joint)
    return f"between {where}" if is_between_joints(effect) else f"on {where}"


def _size(finding: Finding) -> str:
    """Size of a finding in words, such as ``of 2 kg``, or ``by 2 kg`` below the modelled value."""
    if _is_less(finding):
        return shortfall_words(next(iter(finding.parameters.values())))
    return size_words(finding)


def _is_less(finding: Finding) -> bool:
    """True for a negative size of an effect that has words for less than the modelled value."""
    first = next(iter(finding.parameters.values()), None)
    negative = first is not None and not isinstance(first.value, list) and first.value < 0
    return negative and bool(words_of(finding).less)


def _next_step(finding: Finding, experiment: Mapping[str, Any]) -> str:
    """The proposed experiment if it separates the finding from a rival, else the advice of the effect."""
    separated = [tuple(entry) for entry in experiment.get("separates") or ()]
    if experiment.get("say") and (finding.effect, finding.joint) in separated:
        return PROPOSED
    return words_of(finding).next_step


def place(effect: str, joint: str | None) -> str:
    """``joint j2``, ``joints j2 and j3`` for a coupling, ``the whole robot`` for None, ``frame f`` for a target."""
    if joint is None:
        return "the whole robot"
    if effect == TOOL_POSE:
        return f"frame {joint}"
    return joints_words(joint.split("+") if is_between_joints(effect) or is_shared(effect) else [joint])


def joints_words(names: list[str]) -> str:
    """``joint j2`` or ``joints j2 and j3``; if every name contains the word joint, only the names."""
    if all("joint" in name.lower() for name in names):
        return joined(names)
    return f"{'joint' if len(names) == 1 else 'joints'} {joined(names)}"


def placed_effect(at: EffectAt) -> str:
    """An effect with its place, as in ``a payload`` or ``Coulomb friction on joint j2``."""
    return _with_place(words_of(at).name, at)


def placed_finding(finding: Finding) -> str:
    """A finding with its place, as in ``viscous friction on joint j1``."""
    return _with_place(finding_name(finding), finding)


def _with_place(name: str, at: EffectAt | Finding) -> str:
    """The name of an effect, followed by its joint and its recording."""
    where = "" if at.joint is None else f" on {place(at.effect, at.joint)}"
    return name + where + in_recording(at.recording)


def rivals_words(finding: Finding) -> str:
    """Alternatives to a finding, most probable first; empty if there are none."""
    parts: list[tuple[str, float]] = []
    for rival in finding.rivals:
        together = " together" if len(rival.effects) > 1 else ""
        parts.append((joined([placed_effect(at) for at in rival.effects]) + together, rival.probability))
    outside = 1.0 - finding.probability - sum(rival.probability for rival in finding.rivals)
    if outside >= contract_levels.LISTED:
        parts.append(("a cause outside the catalogue", outside))
    if not parts:
        return ""
    ranked = sorted(parts, key=lambda part: -part[1])
    return "it may instead be " + ", or ".join(f"{words} ({percent(probability)})" for words, probability in ranked)


def certainty_words(probability: float) -> str:
    """A probability in words and as a number; below one half it is called undecided."""
    words = next((words for least, words in CERTAINTY if probability >= least), "undecided")
    return f"{words} ({percent_short_of_all(probability)})"


def share_words(share: float, interval: tuple[float, float]) -> str:
    """A share with its 95 % interval, as ``83 % (80 to 86 %)``; without the interval if its ends are printed alike.

    Shares are limited to 100 %: a residual below the noise floor closes no further part of the gap.
    """
    own, least, most = (percent_short_of_all(part) for part in (share, *interval))
    if own == least == most:
        return own
    if own == most == percent_short_of_all(1.0):
        return f"{own} (at least {least})"
    return f"{own} ({least.removesuffix(f'{NO_BREAK}%')} to {most})"


def finding_share(finding: Finding | PoseFinding) -> str:
    """Share of the gap that a finding closes, averaged over all orders in which findings are added (Shapley value).

    If it is not known, the words state the share of the gap that the finding closes if it is added last. The average
    may be negative although that share is not.
    """
    if finding.share is None:
        return share_words(finding.gap_closed, finding.gap_closed_interval)
    if finding.share >= 0.0:
        return percent_short_of_all(finding.share)
    if finding.gap_closed < 0.0:  # noise on held-out data can make this share negative
        return "no measurable part"
    return f"none{_ON_AVERAGE}, {percent_short_of_all(finding.gap_closed)} if added last"


def share_of_gap_words(finding: Finding | PoseFinding, whole: str = "the gap") -> str:
    """``71 % of the gap``; with a negative share ``none of the gap on average, 2 % if added last``."""
    share, on_average, remainder = finding_share(finding).partition(_ON_AVERAGE)
    return f"{share} of {whole}{on_average}{remainder}"


def shown_parameters(finding: Finding) -> dict[str, Value]:
    """Parameters of a finding that the recordings show."""
    return {name: value for name, value in finding.parameters.items() if value.shown}


def not_shown_words(finding: Finding) -> str:
    """``this motion does not show center y`` for parameters that the recordings do not show; empty if all are shown."""
    names = [parameter_name(name) for name, value in finding.parameters.items() if not value.shown]
    if not names:
        return ""
    if len(names) > _MOST_NAMED_PARAMETERS:
        return f"this motion does not show {len(names)} of its numbers"
    return f"this motion does not show {joined(names, ' or ')}"


def parameter_name(name: str) -> str:
    """``torque positive`` for ``torque_positive``; parameters of a body keep the body's name as it is."""
    return name if "." in name else name.replace("_", " ").replace("coulomb", "Coulomb")


def joined(parts: list[str], last: str = " and ") -> str:
    """The parts in one phrase, as ``a, b and c``."""
    return last.join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else "".join(parts)


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]
