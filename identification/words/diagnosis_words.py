"""A diagnosis in plain words: the verdict, and for each finding its effect, place, certainty, rivals and next step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from identification.diagnosis.decision_rules import FLOORS_LEFT, LISTED, ORDINARY_SHARE
from identification.diagnosis.result import Adjusted, Diagnosis, EffectAt, Finding, Unexplained
from identification.words.effect_words import (
    is_between_joints,
    regime_sentence,
    regime_words,
    shortfall_words,
    size_words,
    words_of,
)
from identification.words.numbers_and_names import NO_BREAK, number, percent, value_words

UNDECIDED = 0.5  # probability below which a finding is told as undecided
_SEVERAL = 3  # joints from which all of a robot are named by their number
_TIMES = 3  # stretches that a sentence names
_MOVES = 3  # moves within tolerance that a sentence names

SURENESS = (
    (0.99, "practically certain"),
    (0.9, "very likely"),
    (0.7, "likely"),
    (0.505, "more likely than not"),
    (0.495, "as likely as not"),
)
PROPOSED = "Record the next experiment that is proposed below: it separates the causes that are left."
NO_RIVAL = "nothing else in the catalogue explains the data as well"


def in_recording(recording: str | None) -> str:
    """``in b.csv`` with a space before it; nothing for what all recordings have."""
    return "" if recording is None else f" in {recording}"


def growth_words(finding: Finding) -> str:
    """``, where it is 2.1 times what it is in the other recordings``; nothing where that is not known."""
    # Where the ratio is a parameter of the effect itself, it compares no recordings.
    own = "ratio" in words_of(finding).parameters
    ratio = None if own else finding.parameters.get("ratio")
    if finding.recording is None or ratio is None:
        return ""
    return f", where it is {value_words(ratio)} times what it is in the other recordings"


@dataclass(frozen=True)
class FindingWords:
    """One finding in whole sentences.

    Attributes:
        what: The effect, its size, its place and what it is.
        where: In which part of the motion it shows.
        how_sure: Probability and share of the gap.
        what_else: Rivals.
        what_next: What to do.
    """

    what: str
    where: str
    how_sure: str
    what_else: str
    what_next: str


def finding_words(finding: Finding, next_experiment: Mapping[str, Any] | None = None) -> FindingWords:
    """One finding in sentences.

    Args:
        finding: What was found.
        next_experiment: That of the diagnosis; it is the next step of the findings that it separates.
    """
    rivals = rivals_words(finding) or NO_RIVAL
    return FindingWords(
        what=f"The recording shows {_shown(finding)}.",
        where=regime_sentence(finding.regime),
        how_sure=f"This is {sureness(finding.probability)}; it accounts for {share_of_gap(finding)} of the gap.",
        what_else=f"{capital(rivals)}.",
        what_next=_next_step(finding, next_experiment or {}),
    )


def _shown(finding: Finding) -> str:
    """Effect, size, place and meaning, as in ``a payload of 2 kg: a mass that the model does not carry``."""
    words, size = words_of(finding), _size(finding)
    where = f" {on_place(finding.effect, finding.joint)}" if finding.joint is not None else ""
    where += in_recording(finding.recording) + growth_words(finding)
    if _is_less(finding):
        return f"{words.less}{where}, {size}"
    if size.startswith(":"):  # the size is a sentence of its own
        return f"{words.name}{where}{size}"
    head = f"{words.name} {size}".rstrip()
    return f"{head}{where}" + (f": {words.meaning}" if words.meaning != words.name else "")


def finding_name(finding: Finding) -> str:
    """Plain name of the effect; a negative size is named for what it is: less than modelled."""
    words = words_of(finding)
    return words.less if _is_less(finding) else words.name


def on_place(effect: str, joint: str | None) -> str:
    """``on joint j2``; of a coupling ``between joints j2 and j3``; on the robot as a whole for None."""
    if joint is None:
        return "on the robot as a whole"
    where = place(effect, joint)
    return f"between {where}" if is_between_joints(effect) else f"on {where}"


def _size(finding: Finding) -> str:
    if _is_less(finding):
        return shortfall_words(next(iter(finding.parameters.values())))
    return size_words(finding)


def _is_less(finding: Finding) -> bool:
    first = next(iter(finding.parameters.values()), None)
    negative = first is not None and not isinstance(first.value, list) and first.value < 0
    return negative and bool(words_of(finding).less)


def _next_step(finding: Finding, experiment: Mapping[str, Any]) -> str:
    separated = [tuple(entry) for entry in experiment.get("separates") or ()]
    if experiment.get("say") and (finding.effect, finding.joint) in separated:
        return PROPOSED
    return words_of(finding).next_step


def place(effect: str, joint: str | None) -> str:
    """``joint j2``; of a coupling ``joints j2 and j3``; the whole robot for None."""
    if joint is None:
        return "the whole robot"
    first, plus, second = joint.partition("+")
    if plus and is_between_joints(effect):
        return joints_words([first, second])
    return joints_words([joint])


def joints_words(names: list[str]) -> str:
    """``joint j2`` or ``joints j2 and j3``; names that say themselves that they are joints stand alone."""
    if all("joint" in name.lower() for name in names):
        return joined(names)
    return f"joint{'s' * (len(names) > 1)} {joined(names)}"


def effect_at(at: EffectAt) -> str:
    """An effect with its place, as in ``a payload`` or ``Coulomb friction on joint j2``."""
    name = words_of(at).name
    name += "" if at.joint is None else f" on {place(at.effect, at.joint)}"
    return name + in_recording(at.recording)


def effect_at_finding(finding: Finding) -> str:
    """A finding with its place, as in ``viscous friction on joint j1``."""
    name = finding_name(finding)
    name += "" if finding.joint is None else f" on {place(finding.effect, finding.joint)}"
    return name + in_recording(finding.recording)


def rivals_words(finding: Finding) -> str:
    """What else a finding may be, most probable first; empty for nothing."""
    parts = [
        (joined([effect_at(at) for at in rival.effects]) + " together" * (len(rival.effects) > 1), rival.probability)
        for rival in finding.rivals
    ]
    outside = 1.0 - finding.probability - sum(rival.probability for rival in finding.rivals)
    if outside >= LISTED:
        parts.append(("a cause outside the catalogue", outside))
    if not parts:
        return ""
    ranked = sorted(parts, key=lambda part: -part[1])
    return "it may instead be " + ", or ".join(f"{words} ({percent(probability)})" for words, probability in ranked)


def sureness(probability: float) -> str:
    """A probability as words and number; below a half nothing is decided."""
    words = next((words for least, words in SURENESS if probability >= least), "undecided")
    return f"{words} ({percent(probability)})"


def gap_closed(finding: Finding) -> str:
    """Share of the gap that comes back without a finding, with its interval where that says more."""
    return share_words(finding.gap_closed, finding.gap_closed_interval)


def share_words(share: float, interval: tuple[float, float]) -> str:
    """A share with its 95 % interval, as in ``83 % (80 to 86 %)``; alone where the ends say no more.

    What a correction takes away below the noise floor is no part of the gap, so that nothing is more than all of it.
    """
    own, least, most = (percent(min(part, 1.0)) for part in (share, *interval))
    if own == least == most or (most == percent(1.0) and least == percent(0.995)):
        return least
    return f"{own} ({least.removesuffix(f'{NO_BREAK}%')} to {most})"


def share_of_gap(finding: Finding) -> str:
    """Share of a finding in what all close together; without one, what comes back when it is taken out.

    An effect that only helps beside others has a negative share in the mean over all orders, which says little.
    """
    if finding.share is None:
        return gap_closed(finding)
    return (
        percent(min(finding.share, 1.0)) if finding.share >= 0.0 else f"beside the others {percent(finding.gap_closed)}"
    )


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in a sentence or two; it begins with what is wrong where a wrong recording was judged anyway."""
    return " ".join([headline(diagnosis), *reservations(diagnosis)])


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence, behind what is wrong where a wrong recording was judged anyway."""
    wrong = f"Judged although {joined(list(diagnosis.wrong))}. " if diagnosis.wrong else ""
    return wrong + _verdict_alone(diagnosis)


def _verdict_alone(diagnosis: Diagnosis) -> str:
    names = [_named(kinds, diagnosis) for kinds in grouped(diagnosis)]
    named = joined(names) if len(names) <= 4 else f"{joined(names[:3], last=', ')} and {len(names) - 3} more"
    left = left_over(diagnosis)
    if diagnosis.verdict == "explained":
        return f"The gap between robot and model is explained by {named or 'what was adjusted'}."
    if diagnosis.verdict == "partly_explained":
        return f"Part of the gap between robot and model is explained by {named}; {left}."
    if diagnosis.verdict == "unknown":
        found = f" ({named} found, but not enough)" if names else ""
        return f"There is a gap between robot and model that the catalogue does not explain{found}: {left}."
    if diagnosis.verdict == "no_gap":
        return "The model fits the robot: nothing was found beyond noise and the tolerances that the model states."
    known = [bound for bound in diagnosis.bounds if bound.of_torque is not None]
    if diagnosis.verdict == "not_testable" and known:
        least = min(known, key=lambda bound: bound.of_torque or 0.0)
        return (
            "This recording cannot show an ordinary gap: nothing was found, but even the effect that shows best, "
            f"{effect_at(EffectAt(least.effect, least.joint, words=least.words))}, would have been seen only from "
            f"{percent(least.of_torque or 0.0)} of the torque on. Record faster motion in more postures, or less noise."
        )
    if diagnosis.verdict == "not_testable":
        return "This recording cannot show a gap at all: record a motion that excites the joints, then diagnose again."
    return f"The verdict is {diagnosis.verdict.replace('_', ' ')}."


def _named(kinds: list[list[Finding]], diagnosis: Diagnosis) -> str:
    """A group with its places; what has less than half of the probability is told as undecided."""
    decided = [finding.probability >= UNDECIDED for found in kinds for finding in found]
    return group_name(kinds, diagnosis) + (
        "" if all(decided) else " (in part undecided)" if any(decided) else " (undecided)"
    )


def grouped(diagnosis: Diagnosis) -> list[list[list[Finding]]]:
    """The findings by kind: one effect on several joints together, and effects on the very same joints, too.

    Returns:
        Groups, the largest share of the gap first; of each its effects, and of each effect its findings.
    """
    joints = [gap.joint for gap in diagnosis.joints]
    by_effect: dict[tuple[str, str | None, bool], list[Finding]] = {}
    for finding in diagnosis.findings:
        # What has no joint, or two, stands for itself, and so does what is less than modelled.
        own = finding.joint is None or is_between_joints(finding.effect)
        by_effect.setdefault((finding_name(finding), finding.recording, own), []).append(finding)
    by_place: dict[object, list[list[Finding]]] = {}
    for number_of, (key, found) in enumerate(by_effect.items()):
        places = frozenset(finding.joint for finding in found)
        together = len(places) > 1 and not key[2]
        ordered = sorted(found, key=lambda one: joints.index(one.joint) if one.joint in joints else len(joints))
        by_place.setdefault((places, key[1]) if together else number_of, []).append(ordered)
    return sorted(by_place.values(), key=_share_of_group, reverse=True)


def _share_of_group(kinds: list[list[Finding]]) -> float:
    """What a group closes of the gap together, none where a share is not known; for sorting."""
    return sum(max(finding.share or 0.0, 0.0) for found in kinds for finding in found)


def group_name(kinds: list[list[Finding]], diagnosis: Diagnosis) -> str:
    """``Coulomb friction and viscous friction on all 6 joints``."""
    names = joined([finding_name(found[0]) for found in kinds])
    return names + _places(kinds[0], diagnosis) + in_recording(kinds[0][0].recording)


def _places(found: list[Finding], diagnosis: Diagnosis) -> str:
    """Where findings of one effect are, with a space before it; nothing for the whole robot."""
    if found[0].joint is None:
        return ""
    if len(found) == 1 or is_between_joints(found[0].effect):
        return " " + joined([on_place(one.effect, one.joint) for one in found])
    names = list(dict.fromkeys(str(finding.joint) for finding in found))
    if len(names) == len(diagnosis.joints) >= _SEVERAL:
        return f" on all {len(names)} joints"
    return f" on {joints_words(names)}"


def reservations(diagnosis: Diagnosis) -> list[str]:
    """What a verdict without a gap, or with all of it explained, cannot exclude."""
    if diagnosis.verdict not in ("no_gap", "explained"):
        return []
    out = _at_limits([move for move in diagnosis.adjusted if move.at_limit])
    limits_only = [gap.joint for gap in diagnosis.joints if gap.noise_floor_source == "predictors"]
    if diagnosis.verdict == "no_gap" and limits_only:
        out.append(
            "The noise is known as an upper limit only, so that a short event which does not repeat cannot be excluded."
        )
    shares = {gap.joint: gap.noise_floor / gap.rms_torque for gap in diagnosis.joints if gap.rms_torque}
    loudest = max(limits_only, key=lambda joint: shares.get(joint, 0.0), default=None)
    if loudest is not None and shares.get(loudest, 0.0) > ORDINARY_SHARE:
        out.append(
            f"On {joints_words([loudest])} {percent(shares[loudest])} of the torque counts as noise, because nothing "
            "predicts it: if its sensors are better than that, an effect hides there, and sizes are less certain than "
            "stated."
        )
    strays = (diagnosis.rollout or {}).get("strays", {})
    if diagnosis.verdict == "no_gap" and strays:
        joint = max(strays, key=lambda name: strays[name])
        out.append(
            f"In simulation {joints_words([joint])} strays {number(strays[joint], 2)} times as far as noise and the "
            "tolerances can make it, so that a torque too small and slow to be seen may act there."
        )
    creeping = [gap for gap in diagnosis.joints if gap.rms_after > FLOORS_LEFT * gap.noise_floor]
    if diagnosis.verdict == "no_gap" and creeping:
        one = max(creeping, key=lambda gap: gap.rms_after / gap.noise_floor)
        out.append(
            f"On {joints_words([one.joint])} {one.rms_after / one.noise_floor:.1f} times its noise floor is left, "
            "where joints stand, creep or turn about and friction is in doubt."
        )
    return out


def _at_limits(moves: list[Adjusted]) -> list[str]:
    """What could hide behind moves that end at their limits; of several in one sentence."""
    if len(moves) < 2:
        return [
            f"The move of {move.quantity} ends at the limit of its tolerance; {move.hides} could hide behind it."
            for move in moves
        ]
    plain = [move for move in moves if move.hides.startswith(f"a change of {move.quantity}")]
    loads = dict.fromkeys(move.hides for move in moves if move not in plain)
    hidden = [*loads, *["larger changes of these"] * bool(plain)]
    more = [f"{len(moves) - _MOVES} more (in the report)"] if len(moves) > _MOVES else []
    moved = joined([*(move.quantity for move in moves[:_MOVES]), *more])
    return [f"The moves of {moved} end at the limits of their tolerances; {joined(hidden)} could hide behind them."]


def left_over(diagnosis: Diagnosis) -> str:
    """What is left unexplained: events with their times, joints above their noise floor, and structure."""
    left, parts = diagnosis.unexplained, []
    if left.times:
        times = joined([f"{start:.2f} to {stop:.2f} s" for start, stop in left.times[:_TIMES]])
        more = f" and {len(left.times) - _TIMES} more times" if len(left.times) > _TIMES else ""
        parts.append(
            f"something acts on {place('', left.joint)} from {times}{more} that nothing in the motion predicts"
        )
    above = [gap for gap in diagnosis.joints if gap.rms_after > gap.allowed and gap.noise_floor > 0]
    strays = {} if diagnosis.verdict != "unknown" else (diagnosis.rollout or {}).get("strays", {})
    if strays and not (parts or above or left.structured):
        joint = max(strays, key=lambda name: strays[name])
        parts.append(
            "its torque shows none, but under the recorded torque the simulated motion of "
            f"{joints_words([joint])} strays {number(strays[joint], 2)} times as far as noise and the tolerances can "
            "make it, as by a torque that is small and slow"
        )
    elif left.structured or not (parts or above):
        parts.append(unexplained_phrase(left))
    elif above:
        worst = max(above, key=lambda gap: gap.rms_after / gap.noise_floor)
        floors = f"{number(worst.rms_after / worst.noise_floor, 2)} times its noise floor"
        where = joints_words([worst.joint])
        parts.append(f"on {where} {floors} is left, without structure that another effect could explain")
    return "; ".join(parts)


def unexplained_phrase(unexplained: Unexplained) -> str:
    """What is left unexplained: how much, whether it has structure, and where."""
    where = [place("", unexplained.joint) if unexplained.joint else "", regime_words(unexplained.regime)]
    at = ", ".join(part for part in where if part)
    share = percent(unexplained.fraction_of_explainable)
    if not unexplained.structured:
        return f"{share} of what could be explained is left, without structure that another effect could explain"
    return f"{share} of what could be explained is left" + (
        f", mostly at {at}" if unexplained.joint else f", {at}" * bool(at)
    )


def parameter_name(name: str) -> str:
    """``torque positive`` for ``torque_positive``; the parameters of a body keep the body's name as it is."""
    return name if "." in name else name.replace("_", " ").replace("coulomb", "Coulomb")


def joined(parts: list[str], last: str = " and ") -> str:
    """``a, b and c``."""
    return parts[0] if len(parts) == 1 else last.join([", ".join(parts[:-1]), parts[-1]]) if parts else ""


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]
