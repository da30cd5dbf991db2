"""Sentences on why an effect was named or not, from the ledger of a diagnosis (the list of all claims)."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from dataclasses import dataclass

from identification.diagnosis.result import Diagnosis, EffectAt
from identification.engine.claims import Claim, Data, GateResult
from identification.words.diagnosis_words import capital, joined, placed_effect
from identification.words.geometry_words import all_findings
from identification.words.numbers_and_names import number, percent, percent_short_of_all, with_unit
from phantom_dyn.errors import UsageError

_NEAREST = 5  # number of unnamed effects in `nearest_claims`
_EQUALLY_WELL = 0.01  # noise floors; if the residuals of two sets differ by less, both explain the gap equally well

# For each gate, the reason why an effect that fails it is not named. `value` and `needed` are numbers of the result.
REASONS: dict[str, str] = {
    "possible size": "its fit ends at a size that cannot exist",
    "bodies can exist": "bodies that can exist reach only {value} of what free inertial parameters gain there",
    "more than chance": "beside what is named it gains {value}, where chance alone may give {needed}",
    "fair part of the gap": "it gains {value}, where a fair part of the gap, encoder noise and the number of its "
    "parameters ask for {needed}",
    "in enough blocks": "its gain sits in few stretches of the recording: {value} where {needed} is needed",
    "explains more than others": "the set with it scores {margin} on data that no fit has seen",
    "worth its numbers": "it explains only {value} more than a simpler law, where the method is accurate to {needed}",
    "torque is there": "no joint's measured torque is above its noise: the largest is {value} floors",
    "shown by motion": "it looks like noise that moves a joint: where the motion is far above the noise it gains "
    "{value} where {needed} is needed",
    "closes for sure": "in one of forty draws of held-out blocks it closes {value} of what it closes in all, where at "
    "least {needed} is needed",
    "shown above noise": "noise may explain it: without it no joint is left with structure or more than its noise "
    "({value} where {needed} is needed)",
    "differs from simpler": "its size differs from nothing, or from a simpler law, with a probability of {value} only, "
    "where {needed} is needed",
    "both are there": "not each of them is sure beside the other: the less certain one is more than nothing with a "
    "probability of {value} only, where {needed} is needed",
    "more than a missing part": "what it explains is the absence of a part that the model carries, but for {value} of "
    "its squared torque",
    "plausible size": "its size is {outside} outside of what a sound robot has, and that of a rival is not",
    "likelier than rivals": "its probability is {value}, and that of a rival {needed}",
    "coarser than stated": "the readings lie on a lattice of {value} stated steps, where {needed} are needed",
    "coarser than others": "its readings have {value} times the step of the other joints, where {needed} is needed",
    "rounding matters": "the rounding makes {value} of a joint's squared noise, where {needed} is needed",
    "large enough": "it is too small to matter: {value} where {needed} is needed",
    "beyond the gain": "positions do not separate it from the gain of the controller, which may be wrong by {needed}",
}

_DATA: dict[Data, str] = {"torques": "this motion", "poses": "these poses", "rests": "these rests"}
# Units of the numbers that gates compare as shares, which are shown as percentages.
_SHARES = {
    "of the gain",
    "of the squared noise",
    "of the squared residual",
    "of the squared torque",
    "of what it closes",
    "probability",
}


@dataclass(frozen=True)
class ClaimWords:
    """Text on why an effect was named or not: its name and joint, a sentence, and one line for each tested gate."""

    name: str
    sentence: str
    gates: tuple[str, ...] = ()

    def __str__(self) -> str:
        return "\n".join([self.sentence, *(f"  {line}" for line in self.gates)])


def why(diagnosis: Diagnosis, effect: str, joint: str | None = None) -> tuple[ClaimWords, ...]:
    """Texts on why an effect is named in a diagnosis or not, one for each joint.

    Args:
        diagnosis: A diagnosis with a ledger.
        effect: Name of the effect in the catalogue.
        joint: Name of the joint; None for all joints.

    Raises:
        UsageError: If the diagnosis has no such effect, no such joint, or no ledger.
    """
    effect = effect.strip().replace(" ", "_").replace("-", "_").lower()
    known = _known(diagnosis)
    names = sorted({name for name, _ in known})
    if not diagnosis.ledger and effect not in names:
        raise UsageError(
            "this diagnosis holds no ledger, as it was made by an earlier version: diagnose the recording again."
        )
    if effect not in names:
        nearest = difflib.get_close_matches(effect, names, n=1)
        hint = f"; did you mean {nearest[0]}?" if nearest else "."
        raise UsageError(
            f"{effect!r} was asked for, which is no effect that this diagnosis tried{hint} Wanted one of "
            f"{', '.join(names)}."
        )
    places = [place for place in known if place[0] == effect and (joint is None or joint == place[1])]
    if not places:
        where = [place[1] for place in known if place[0] == effect]
        joints = ", ".join(name or "the whole robot (leave --joint out)" for name in where)
        raise UsageError(f"{effect} was asked for on {joint!r}, wanted one of: {joints}.")
    return tuple(words for place in places for words in _words_on(diagnosis, *place))


def nearest_claims(diagnosis: Diagnosis) -> tuple[ClaimWords, ...]:
    """Texts on the five unnamed effects that would close most of the gap."""
    others = [claim for claim in diagnosis.ledger if claim.outcome in ("displaced", "not_claimed")]
    others.sort(key=lambda claim: -_share_alone(claim))
    return tuple(_claim_words(diagnosis, claim) for claim in others[:_NEAREST])


def _known(diagnosis: Diagnosis) -> tuple[tuple[str, str | None], ...]:
    """Effects and joints that a diagnosis mentions, first those of the ledger."""
    places = [(at.effect, at.joint) for claim in diagnosis.ledger for at in claim.effects]
    places += [(one.effect, one.joint) for one in (*diagnosis.bounds, *diagnosis.not_testable)]
    if diagnosis.geometry is not None:
        of_poses = (*diagnosis.geometry.bounds, *diagnosis.geometry.not_testable)
        places += [(one.effect, one.joint) for one in of_poses]
    return tuple(dict.fromkeys(places))


def _words_on(diagnosis: Diagnosis, effect: str, joint: str | None) -> tuple[ClaimWords, ...]:
    """Texts on one effect on one joint; several if it was claimed for single recordings."""
    claims = [
        claim for claim in diagnosis.ledger if any((at.effect, at.joint) == (effect, joint) for at in claim.effects)
    ]
    return tuple(_claim_words(diagnosis, claim) for claim in claims) or (_without_claim(diagnosis, effect, joint),)


def _without_claim(diagnosis: Diagnosis, effect: str, joint: str | None) -> ClaimWords:
    """Text on an effect that is not in the ledger."""
    name = placed_effect(EffectAt(effect, joint))
    of_poses = diagnosis.geometry
    bounds = (*diagnosis.bounds, *(of_poses.bounds if of_poses else ()))
    bounds = [one for one in bounds if (one.effect, one.joint) == (effect, joint)]
    # Poses may show only some parameters of an effect: then the bounds of these are stated.
    hidden_in_poses = of_poses.not_testable if of_poses and not bounds else ()
    for entry in (*diagnosis.not_testable, *hidden_in_poses):
        if (entry.effect, entry.joint) == (effect, joint):
            return ClaimWords(name, f"{capital(name)} was not tried, as this recording cannot show it: {entry.why}.")
    sizes = joined(
        [f"{one.parameter.replace('_', ' ')} {with_unit(number(one.below), one.unit)}" for one in bounds], " or "
    )
    return ClaimWords(
        name,
        f"{capital(name)} was tried and never claimed, and is not among the ten that came nearest. The recording would "
        f"have shown it from {sizes} on.",
    )


def _claim_words(diagnosis: Diagnosis, claim: Claim[EffectAt]) -> ClaimWords:
    """Text on one claim of the ledger."""
    name = joined([placed_effect(at) for at in claim.effects])
    if claim.judged_by == "poses" and not diagnosis.poses_alone:
        name += " (judged by the measured poses)"
    lines = tuple(gate_line(result) for result in claim.gates)
    return ClaimWords(name, _sentence(diagnosis, claim, name), lines)


def _sentence(diagnosis: Diagnosis, claim: Claim[EffectAt], name: str) -> str:
    """Why the effects of a claim, called ``name``, are named, minor, or not named."""
    failed, closes = claim.failed, _share_alone(claim)
    would = f"{capital(name)} would close {percent_short_of_all(closes)} of the gap" if closes > 0.0 else ""
    if claim.outcome == "claimed":
        alone = f", and would close {percent_short_of_all(closes)} of the gap alone" if closes > 0.0 else ""
        return f"{capital(name)} is named: it passed all {len(claim.gates)} gates that it met{alone}."
    if claim.outcome == "minor":
        return f"{capital(name)} is seen, and listed as minor: {_reason(failed)}."
    several = len(claim.effects) > 1
    start = f"{would}; {'they are' if several else 'it is'} not named because"
    if not would:
        start = f"{capital(name)} {'are' if several else 'is'} not named because"
    if claim.outcome == "displaced" and claim.instead:
        return f"{start} {_instead(claim, _rival_probability(diagnosis, claim))}."
    return f"{start} {_reason(failed)}."


def _rival_probability(diagnosis: Diagnosis, claim: Claim[EffectAt]) -> float:
    """Probability of a claim as a rival of the finding that replaced it; zero if it is not a rival."""
    findings = [one for one in all_findings(diagnosis) if one.effect_at in claim.instead]
    own = [rival.probability for one in findings for rival in one.rivals if set(rival.effects) == set(claim.effects)]
    return max(own, default=0.0)


def _instead(claim: Claim[EffectAt], probability: float) -> str:
    """Clause on the effects that displaced a claim; ``probability`` is that of the claim as their rival."""
    others, failed = joined([placed_effect(at) for at in claim.instead]), claim.failed
    several = len(claim.instead) > 1 or "parameters" in others  # ``inertial parameters`` are a plural, too
    more = claim.figures.get("floors_more", math.nan)
    if not math.isfinite(more):  # the effect that replaced it is not named either
        return f"{others} took its place in the search: {_reason(failed)}"
    if more >= _EQUALLY_WELL:
        better = f"{others} {'close' if several else 'closes'} {number(more, 2)} noise floors more"
    else:
        better = f"{others} {'explain' if several else 'explains'} as much"
    if probability > 0.0:
        by = _DATA[claim.judged_by]
        apart = f"and these two cannot be separated by {by} ({percent(probability)} for the one not named)"
        return f"{better}, {apart}"
    if failed is not None and failed.gate == "more than chance":
        return f"{better}, and beside {'these' if several else 'it'} {_gain_words(failed)}"
    return f"{better}: {_reason(failed)}"


def _gain_words(failed: GateResult) -> str:
    """Words on the gain of an effect in addition to the named ones; a negative gain is called nothing."""
    gained = "nothing is gained" if failed.value <= 0.0 else f"only {number(failed.value)} is gained"
    return f"{gained}, where chance alone may give {number(failed.needed)}"


def _reason(failed: GateResult | None) -> str:
    """Clause on the gate that a claim failed."""
    if failed is None:
        return "another set of effects was chosen"
    template = REASONS.get(failed.gate, f"it failed the gate '{failed.gate}' with {{value}} where {{needed}} is needed")
    sign = "worse" if failed.value < 0.0 else "no better than without it"
    margin = f"{number(abs(failed.value))} {sign}" if failed.value < 0.0 else sign
    return template.format(
        value=_figure(failed.value, failed.unit),
        needed=_figure(failed.needed, failed.unit),
        margin=margin,
        outside=with_unit(number(abs(failed.value)), failed.unit),
    )


def _figure(value: float, unit: str) -> str:
    """A number of a gate: shares as percentages, gains without a unit."""
    if unit == "of the gap":
        return percent_short_of_all(value)
    return percent(value) if unit in _SHARES else number(value)


def gate_line(result: GateResult) -> str:
    """Result of one gate as a line, such as ``passed  more than chance: 521, needed 20 (gain)``."""
    value, needed = (_figure(figure, result.unit) for figure in (result.value, result.needed))
    unit = f" ({result.unit})" if result.unit and result.unit != "probability" else ""
    return f"{'passed' if result.passed else 'failed'}  {result.gate}: {value}, needed {needed}{unit}"


def _share_alone(claim: Claim[EffectAt]) -> float:
    """Share of the gap that a claim closes without other effects; minus infinity if it is not known."""
    closes = claim.figures.get("closes", math.nan)
    return closes if math.isfinite(closes) else -math.inf


def claims_text(every: Iterable[ClaimWords]) -> str:
    """Texts on several claims, with blank lines between them."""
    return "\n\n".join(map(str, every))
