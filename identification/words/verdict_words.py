"""Sentences on the verdict: causes that explain the gap, the part that remains, and causes that are not ruled out."""

from __future__ import annotations

from itertools import product

from identification.diagnosis.decision_rules import ORDINARY_SHARE
from identification.diagnosis.judge.verdict import may_hide_gap, ordinary_effects_may_hide, torques_may_be_noise
from identification.diagnosis.result import (
    Adjusted,
    Diagnosis,
    EffectAt,
    Finding,
    JointGap,
    Unexplained,
)
from identification.engine import contract_levels
from identification.notes import Code, Note
from identification.words.diagnosis_words import (
    UNDECIDED,
    capital,
    finding_name,
    in_recording,
    joined,
    joints_words,
    on_place,
    place,
    placed_effect,
)
from identification.words.effect_words import is_between_joints, is_shared, regime_words
from identification.words.numbers_and_names import number, percent, percent_short_of_all

_HEADLINE_LETTERS = 128  # largest number of letters of a headline: two lines on 1200 pixels, five on 400
_HEADLINE_CAUSES = 4  # largest number of causes that a headline names
_MANY_JOINTS = 3  # from this number of joints on, ``all 6 joints`` replaces their names
_MOST_TIMES = 3  # largest number of stretches of time that a sentence names
_MOST_CHANGES = 3  # largest number of changes within tolerance that a sentence names
_LEAST_MENTIONED = 0.1  # smaller shares of the gap that changes within tolerance close are not mentioned


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in a sentence or two, preceded by certain faults if the recording was judged in spite of them."""
    return " ".join([headline(diagnosis), *reservations(diagnosis)])


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence, preceded by certain faults if the recording was judged in spite of them."""
    wrong = f"Judged although {joined(list(diagnosis.wrong))}. " if diagnosis.wrong else ""
    return wrong + _verdict_alone(diagnosis)


def short_headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence of at most about 130 letters, which names as many causes as fit."""
    wrong = "Judged although the recording is wrong. " if diagnosis.wrong else ""
    return wrong + _short_verdict(diagnosis, _HEADLINE_LETTERS - len(wrong))


def _short_verdict(diagnosis: Diagnosis, letters: int) -> str:
    """The verdict in at most ``letters`` letters: with as many causes and their joints as fit, or without joints."""
    begins = {
        "explained": "The gap between robot and model is explained by",
        "partly_explained": "Part of the gap between robot and model is explained by",
        "unknown": "The catalogue does not explain the gap between robot and model; found, but not enough:",
    }
    if diagnosis.verdict == "unknown" and not diagnosis.findings:
        return "There is a gap between robot and model that the catalogue does not explain."
    if diagnosis.verdict == "explained" and not diagnosis.findings:
        return "The gap between robot and model is explained by what was adjusted."
    if diagnosis.verdict in begins:
        groups = grouped(diagnosis)
        placed = [_named(kinds, diagnosis) for kinds in groups]
        bare = list(dict.fromkeys(finding_name(found[0]) for kinds in groups for found in kinds))
        for names, count in product((placed, bare), range(_HEADLINE_CAUSES, 0, -1)):
            more = f" and {len(names) - count} more" if count < len(names) else ""
            named = joined(names[:count], last=", " if more else " and ") + more
            said = f"{begins[diagnosis.verdict]} {named}."
            # One cause with its joints and the number of the others says less than several causes without joints.
            says_little = names is placed and count == 1 and more
            if len(said) <= letters and not says_little:
                return said
        return f"{begins[diagnosis.verdict]} {len(diagnosis.findings)} causes."
    if diagnosis.verdict == "no_gap":
        return _verdict_alone(diagnosis)
    if diagnosis.verdict == "not_testable" and (_undecided_joints(diagnosis) or _joints_of_unknown_noise(diagnosis)):
        return "This recording does not show whether there is a gap."
    if diagnosis.verdict == "not_testable":
        return f"This recording cannot show {'an ordinary' if diagnosis.bounds else 'a'} gap: nothing was found."
    return f"The verdict is {diagnosis.verdict.replace('_', ' ')}."


def _verdict_alone(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence, without faults of the recording."""
    names = [_named(kinds, diagnosis) for kinds in grouped(diagnosis)]
    named = joined(names) if len(names) <= 4 else f"{joined(names[:3], last=', ')} and {len(names) - 3} more"
    residual_words = residual_phrase(diagnosis)
    if diagnosis.verdict == "explained":
        return f"The gap between robot and model is explained by {named or 'what was adjusted'}."
    if diagnosis.verdict == "partly_explained":
        return f"Part of the gap between robot and model is explained by {named}; {residual_words}."
    if diagnosis.verdict == "unknown":
        found = f" ({named} found, but not enough)" if names else ""
        return f"There is a gap between robot and model that the catalogue does not explain{found}: {residual_words}."
    if diagnosis.verdict == "no_gap":
        beyond = "noise, what drives and slow joints may leave," if _joints_above_noise(diagnosis) else "noise"
        return f"The model fits the robot: nothing was found beyond {beyond} and the tolerances that the model states."
    if diagnosis.verdict == "not_testable":
        return _not_testable(diagnosis)
    return f"The verdict is {diagnosis.verdict.replace('_', ' ')}."


def _not_testable(diagnosis: Diagnosis) -> str:
    """Why the recording cannot show a gap, and what to record."""
    if torques_may_be_noise(diagnosis.joints):
        return (
            "This recording cannot show a gap at all: on every joint the noise is as large as the torque. Check that "
            "the positions and the torques stand in the right columns, or record with less noise."
        )
    if open_joints := _undecided_joints(diagnosis):
        one = max(open_joints, key=_residual_share)
        return (
            f"This recording does not show whether there is a gap: on {joints_words([one.joint])} "
            f"{percent(_residual_share(one))} of the torque is left. Noise may make it, or friction where the joint "
            "stands, creeps or turns about, but a gap may as well. Record motion that stands less and turns about "
            "faster."
        )
    if unknown := _joints_of_unknown_noise(diagnosis):
        least_known = max(unknown, key=_largest_noise_share)
        return (
            "This recording does not show whether there is a gap: the noise of "
            f"{joints_words([gap.joint for gap in unknown])} is not known, as there are too few samples, the sampling "
            "rate is too low to see noise above so fast a motion, the readings were filtered, or the noise grows "
            "towards the frequencies of the motion. "
            f"Up to {percent(_largest_noise_share(least_known))} of the torque may be noise or a gap. "
            "Record for longer, at a higher rate, and readings as the sensors give them, or repeat the motion."
        )
    if known := [bound for bound in diagnosis.bounds if bound.of_torque is not None]:
        least = min(known, key=lambda bound: bound.of_torque or 0.0)
        return (
            "This recording cannot show an ordinary gap: nothing was found, but even the effect that shows best, "
            f"{placed_effect(EffectAt(least.effect, least.joint, words=least.words))}, would have been seen only from "
            f"{percent(least.of_torque or 0.0)} of the torque on. Record faster motion in more postures, or less noise."
        )
    return (
        "This recording cannot show a gap at all, as no joint moves, or each pauses so often that the filters mix "
        "every move with a standstill: record a motion without pauses, or at a higher rate, then diagnose again."
    )


def _named(kinds: list[list[Finding]], diagnosis: Diagnosis) -> str:
    """A group with its places; findings with a probability below one half are called undecided."""
    decided = [finding.probability >= UNDECIDED for found in kinds for finding in found]
    name = group_name(kinds, diagnosis)
    if all(decided):
        return name
    return f"{name} ({'in part undecided' if any(decided) else 'undecided'})"


def grouped(diagnosis: Diagnosis) -> list[list[list[Finding]]]:
    """Findings in groups: one effect on several joints, together with other effects on exactly the same joints.

    Returns:
        Groups, beginning with the largest share of the gap. A group is a list of effects, each a list of findings.
    """
    joints = [gap.joint for gap in diagnosis.joints]
    by_effect: dict[tuple[str, str | None, bool], list[Finding]] = {}
    for finding in diagnosis.findings:
        # Findings on no joint or on several joints are not grouped. A finding below the modelled value has another
        # name, so that it is not grouped with those above.
        several = is_between_joints(finding.effect) or (is_shared(finding.effect) and "+" in (finding.joint or ""))
        alone = finding.joint is None or several
        by_effect.setdefault((finding_name(finding), finding.recording, alone), []).append(finding)
    by_place: dict[object, list[list[Finding]]] = {}
    for count, ((_, recording, alone), found) in enumerate(by_effect.items()):
        places = frozenset(finding.joint for finding in found)
        ordered = sorted(found, key=lambda one: joints.index(one.joint) if one.joint in joints else len(joints))
        # Effects on the same joints, two or more, share a group. Every other effect has a group of its own.
        key = count if alone or len(places) == 1 else (places, recording)
        by_place.setdefault(key, []).append(ordered)

    def share(kinds: list[list[Finding]]) -> float:
        return sum(max(finding.share or 0.0, 0.0) for found in kinds for finding in found)

    return sorted(by_place.values(), key=share, reverse=True)


def group_name(kinds: list[list[Finding]], diagnosis: Diagnosis) -> str:
    """``Coulomb friction and viscous friction on all 6 joints``."""
    names = joined([finding_name(found[0]) for found in kinds])
    return names + _places(kinds[0], diagnosis) + in_recording(kinds[0][0].recording)


def _places(found: list[Finding], diagnosis: Diagnosis) -> str:
    """Places of findings of one effect, preceded by a space; empty for the whole robot."""
    if found[0].joint is None:
        return ""
    if len(found) == 1 or is_between_joints(found[0].effect):
        return " " + joined([on_place(one.effect, one.joint) for one in found])
    names = list(dict.fromkeys(str(finding.joint) for finding in found))
    if len(names) == len(diagnosis.joints) >= _MANY_JOINTS:
        return f" on all {len(names)} joints"
    return f" on {joints_words(names)}"


def reservations(diagnosis: Diagnosis) -> list[str]:
    """Sentences on causes that ``no_gap`` and ``explained`` do not rule out, and on changes within tolerances."""
    closed = closed_by_tolerances(diagnosis)
    by_tolerances = (
        [] if closed is None else [f"Changes within the tolerances close {percent_short_of_all(closed)} of the gap."]
    )
    limits = _at_limits([change for change in diagnosis.adjusted if change.at_limit])
    if diagnosis.verdict not in ("no_gap", "explained"):
        return [*by_tolerances, *limits] if by_tolerances else []
    out = [*_not_judged(diagnosis), *by_tolerances, *limits]
    limits_only = [gap.joint for gap in diagnosis.joints if not gap.noise_is_known]
    if diagnosis.verdict == "no_gap" and limits_only:
        out.append(
            "The noise is known as an upper limit only, so that a short event which does not repeat cannot be excluded."
        )
    shares = {gap.joint: gap.noise_floor / gap.rms_torque for gap in diagnosis.joints if gap.rms_torque}
    noisiest = max(limits_only, key=lambda joint: shares.get(joint, 0.0), default=None)
    if noisiest is not None and shares.get(noisiest, 0.0) > ORDINARY_SHARE:
        out.append(
            f"On {joints_words([noisiest])} {percent(shares[noisiest])} of the torque counts as noise, because nothing "
            "predicts it: if its sensors are better than that, an effect hides there, and sizes are less certain than "
            "stated."
        )
    strays = (diagnosis.rollout or {}).get("strays", {})
    if diagnosis.verdict == "no_gap" and strays:
        joint = max(strays, key=lambda name: strays[name])
        out.append(
            f"In simulation {joints_words([joint])} strays {number(strays[joint])} times as far as noise and the "
            "tolerances can make it, so that a torque too small and slow to be seen may act there."
        )
    if diagnosis.verdict == "no_gap" and _joints_above_noise(diagnosis):
        one = max(_joints_above_noise(diagnosis), key=_residual_share)
        out.append(
            f"On {joints_words([one.joint])} {one.rms_after / one.noise_floor:.1f} times its noise floor is left, "
            f"{percent(_residual_share(one))} of its torque: the drive may make it, or friction where the joint "
            "stands, creeps or turns about."
        )
    return out


def _joints_above_noise(diagnosis: Diagnosis) -> list[JointGap]:
    """Joints whose residual exceeds the noise floor; drives or friction may cause this with a right model."""
    noisy = [gap for gap in diagnosis.joints if not gap.only_given_fits]
    return [gap for gap in noisy if gap.rms_after > contract_levels.FLOORS_LEFT * gap.noise_floor]


def _not_judged(diagnosis: Diagnosis) -> list[str]:
    """Sentences on joints without a usable sample, which the verdict does not include."""
    out: list[str] = []
    gaps = [gap for gap in diagnosis.joints if not gap.hold_out_samples]
    # At rest no torque of any joint is known.
    unknown = [gap.joint for gap in gaps if gap.rms_torque is None and not diagnosis.at_rest]
    still = [gap.joint for gap in gaps if gap.joint not in unknown]
    if unknown:
        are, torques = ("is", "its torque is") if len(unknown) == 1 else ("are", "their torques are")
        out.append(f"{capital(joints_words(unknown))} {are} not judged: {torques} not known.")
    if still:
        they_move = "is not judged: it moves" if len(still) == 1 else "are not judged: they move"
        out.append(f"{capital(joints_words(still))} {they_move} too little, or too briefly between two standstills.")
    return out


def _undecided_joints(diagnosis: Diagnosis) -> list[JointGap]:
    """Joints with a large residual that may be noise, friction or a gap."""
    return [gap for gap in diagnosis.joints if may_hide_gap(gap) and gap.noise_is_known]


def _joints_of_unknown_noise(diagnosis: Diagnosis) -> list[JointGap]:
    """Joints whose unknown noise is the only reason why the verdict is not ``no_gap``; else empty."""
    if torques_may_be_noise(diagnosis.joints) or ordinary_effects_may_hide(diagnosis.bounds):
        return []
    return [gap for gap in diagnosis.joints if gap.hold_out_samples and not gap.noise_is_known and gap.rms_torque]


def _largest_noise_share(gap: JointGap) -> float:
    """The largest residual of a joint that may be noise, as a share of its torque."""
    return gap.allowed / gap.rms_torque if gap.rms_torque else 0.0


def _residual_share(gap: JointGap) -> float:
    """RMS residual of a joint as a share of its torque; zero if the torque is not known."""
    return gap.rms_after / gap.rms_torque if gap.rms_torque else 0.0


def closed_by_tolerances(diagnosis: Diagnosis) -> float | None:
    """Share of the gap that is closed by changes within the tolerances and by no finding; None if it is negligible.

    An error whose size is within a tolerance, such as that of a controller's gain, is not a finding. The share of the
    gap that it closes is therefore not part of the share of any finding.
    """
    shares = [finding.share for finding in (*diagnosis.findings, *diagnosis.minor)]
    known = [share for share in shares if share is not None]
    if diagnosis.gap.closed is None or len(known) < len(shares):
        return None
    by_tolerances = diagnosis.gap.closed - sum(known)
    return by_tolerances if by_tolerances > _LEAST_MENTIONED else None


def _at_limits(changes: list[Adjusted]) -> list[str]:
    """Sentences on larger errors that changes at their limits could hide."""
    if len(changes) < 2:
        return [
            f"The change of {change.quantity} ends at the limit of its tolerance; "
            f"{hidden_words(change)} could hide behind it."
            for change in changes
        ]
    plain = [change for change in changes if change.hides is not None and change.hides.kind == "change"]
    hidden = list(dict.fromkeys(hidden_words(change) for change in changes if change not in plain))
    if plain:
        hidden.append("larger changes of these")
    names = [change.quantity for change in changes[:_MOST_CHANGES]]
    if len(changes) > _MOST_CHANGES:
        names.append(f"{len(changes) - _MOST_CHANGES} more (in the report)")
    return [
        f"The changes of {joined(names)} end at the limits of their tolerances; {joined(hidden)} could hide behind "
        "them."
    ]


def hidden_words(change: Adjusted) -> str:
    """Larger error that a change at the limit of its tolerance could hide, in words; empty if it is not known."""
    if change.hides is None:
        return ""
    if change.hides.kind == "payload":
        return f"a payload of up to {change.hides.size:.2g} kg"
    return f"a change of {change.quantity} of more than {100 * change.hides.size:.0f} %"


def residual_phrase(diagnosis: Diagnosis) -> str:
    """Phrase on the unexplained residual: events with their times, joints above their noise floor, and structure."""
    unexplained, parts = diagnosis.unexplained, []
    if unexplained.times:
        times = joined([f"{start:.2f} to {stop:.2f} s" for start, stop in unexplained.times[:_MOST_TIMES]])
        more = f" and {len(unexplained.times) - _MOST_TIMES} more times" if len(unexplained.times) > _MOST_TIMES else ""
        # A residual with structure is named with its joint below; events may be on other joints.
        where = "" if unexplained.structured else f" on {place('', unexplained.joint)}"
        parts.append(f"something acts{where} from {times}{more} that nothing in the motion predicts")
    above = [gap for gap in diagnosis.joints if gap.rms_after > gap.allowed and gap.noise_floor > 0]
    above = [gap for gap in above if not gap.only_given_fits] or above
    if unexplained.structured:
        parts.append(unexplained_phrase(unexplained))
    elif above:
        worst = max(above, key=lambda gap: gap.rms_after / gap.noise_floor)
        floors = f"{number(worst.rms_after / worst.noise_floor, 2)} times its noise floor"
        where = joints_words([worst.joint])
        parts.append(f"on {where} {floors} is left, without structure that another effect could explain")
    elif not parts:
        parts.append(_stray_phrase(diagnosis) or _implausible_size_phrase(diagnosis) or unexplained_phrase(unexplained))
    return "; ".join(parts)


def _stray_phrase(diagnosis: Diagnosis) -> str:
    """Phrase on a gap that only the simulated motion shows, if the verdict is ``unknown``; else empty."""
    strays = (diagnosis.rollout or {}).get("strays", {})
    if diagnosis.verdict != "unknown" or not strays:
        return ""
    joint = max(strays, key=lambda name: strays[name])
    return (
        "its torque shows none, but under the recorded torque the simulated motion of "
        f"{joints_words([joint])} strays {number(strays[joint])} times as far as noise and the tolerances can "
        "make it, as by a torque that is small and slow"
    )


def _implausible_size_phrase(diagnosis: Diagnosis) -> str:
    """Names of findings whose size no sound robot has; empty if there are none."""
    notes = [note for note in diagnosis.notes if isinstance(note, Note)]
    places = {(note.numbers["effect"], note.joint) for note in notes if note.code is Code.IMPLAUSIBLE_SIZE}
    implausible = [one for one in diagnosis.findings if (one.effect, one.joint) in places]
    odd = [placed_effect(EffectAt(one.effect, one.joint)) for one in implausible]
    odd += [f"the friction on {note.joint}" for note in notes if note.code is Code.FRICTION_DRIVES]
    if not odd:
        return ""
    return f"{joined(odd)} {'has' if len(odd) == 1 else 'have'} a size that no sound robot has, see the notes"


def unexplained_phrase(unexplained: Unexplained) -> str:
    """Phrase on the size of the unexplained residual, whether it has structure, and where it is."""
    size = f"{percent(unexplained.fraction_of_explainable)} of what the motion predicts is left"
    regime = regime_words(unexplained.regime)
    if not unexplained.structured:
        return f"{size}, without structure that another effect could explain"
    mostly = f"mostly at {place('', unexplained.joint)}" if unexplained.joint else ""
    return ", ".join(part for part in (size, mostly, regime) if part)
