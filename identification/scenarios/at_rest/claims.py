"""What the gates say of the ways in which a joint may give way: the entries of the ledger that are of rests."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.result import EffectAt
from identification.engine.claims import Claim, GateResult, until_failed
from identification.gates.rivalry import likelier_than_rivals
from identification.scenarios.at_rest.giving_way import WAYS, GivingWay, Way
from phantom_dyn.array_types import Array, Float


def claims_at_rest(joint: str, found: GivingWay, repeat: float) -> tuple[Claim[EffectAt], ...]:
    """One claim for each way of giving way, or for each effect of the way that is named.

    Args:
        joint: The joint.
        found: What its rests say.
        repeat: Deviation of the samples within a rest.
    """
    named = found.ways[0].effects if found.ways else ()
    # Loads of one size, or few rests, do not say whether both together are there: nobody asked.
    asked = WAYS if found.both is not None or not found.ways else WAYS[:2]
    names = [(effect,) for effect in named] + [way for way in asked if not set(way) <= set(named)]
    return tuple(_claim(joint, found, way, repeat) for way in names)


def _claim(joint: str, found: GivingWay, effects: tuple[str, ...], repeat: float) -> Claim[EffectAt]:
    at = tuple(EffectAt(effect, joint) for effect in effects)
    if not found.ways:
        return Claim(at, (found.shown,), "not_claimed", judged_by="rests")
    first = found.ways[0]
    claimed = set(effects) <= set(first.effects)
    gates = until_failed((found.shown, *_against_rivals(found, first.effects if claimed else effects)))
    own = next((way for way in found.ways if way.effects == effects), None)
    if own is None:  # both together, which are not sure beside each other
        return Claim(at, gates, "not_claimed", judged_by="rests")
    figures = {"closes": _closes(found, own, repeat)}
    if claimed:
        return Claim(at, gates, "claimed", figures=figures, judged_by="rests")
    figures["floors_more"] = (_rms(own.left) - _rms(first.left)) / repeat
    instead = tuple(EffectAt(effect, joint) for effect in first.effects)
    return Claim(at, gates, "displaced", instead, figures, "rests")


def _against_rivals(found: GivingWay, way: tuple[str, ...]) -> tuple[GateResult, ...]:
    """What decides between ways: whether both together are there at all, and then which is the likeliest."""
    odds = {one.effects: share for one, share in zip(found.ways, found.probabilities, strict=True)}
    asked = (found.both,) if len(way) > 1 and found.both is not None else ()
    if way not in odds:
        return asked
    rival = max((share for other, share in odds.items() if other != way), default=0.0)
    return (*asked, likelier_than_rivals(odds[way], rival, leads=way == found.ways[0].effects))


def _closes(found: GivingWay, way: Way, repeat: float) -> float:
    """Share of the gap of the joint that a way closes by itself."""
    before = _rms(found.before) ** 2
    return (before - _rms(way.left) ** 2) / max(before - repeat**2, 1e-300)


def _rms(left: Float[Array, " R"]) -> float:
    return float(np.sqrt(np.mean(left**2)))
