"""What the gates say of the ways in which a joint may give way: the entries of the ledger that are of rests."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.result import EffectAt
from identification.engine.claims import Claim, GateResult, until_failed
from identification.gates.rivalry import likelier_than_rivals
from identification.scenarios.at_rest.giving_way import WAYS, GivingWay, Way

Array = np.ndarray


def claims_at_rest(joint: str, found: GivingWay, repeat: float) -> tuple[Claim[EffectAt], ...]:
    """One claim for each way of giving way, or for each effect of the way that is named.

    Args:
        joint: The joint.
        found: What its rests say.
        repeat: Deviation of the samples within a rest.
    """
    named = found.ways[0].effects if found.ways else ()
    names = [(effect,) for effect in named] + [way for way in WAYS if not set(way) <= set(named)]
    return tuple(_claim(joint, found, way, repeat) for way in names)


def _claim(joint: str, found: GivingWay, effects: tuple[str, ...], repeat: float) -> Claim[EffectAt]:
    at = tuple(EffectAt(effect, joint) for effect in effects)
    if not found.ways:
        return Claim(at, (found.shown,), "not_claimed", judged_by="rests")
    claimed = set(effects) <= set(found.ways[0].effects)
    gates = until_failed((found.shown, *_against_rivals(found, effects, claimed=claimed)))
    instead = () if claimed else tuple(EffectAt(effect, joint) for effect in found.ways[0].effects)
    known = found.ways[0] if claimed else next((way for way in found.ways if way.effects == effects), None)
    figures = {} if known is None else {"closes": _closes(found, known, repeat)}
    return Claim(at, gates, "claimed" if claimed else "displaced", instead, figures, "rests")


def _against_rivals(found: GivingWay, effects: tuple[str, ...], *, claimed: bool) -> tuple[GateResult, ...]:
    """What decides between ways: whether both together are there at all, and then which is the likeliest."""
    odds = {way.effects: share for way, share in zip(found.ways, found.probabilities, strict=True)}
    first = found.ways[0].effects
    whole = first if claimed else effects
    asked = (found.both,) if len(whole) > 1 and found.both is not None else ()
    if whole not in odds:
        return asked
    rival = max((share for way, share in odds.items() if way != whole), default=0.0)
    return (*asked, likelier_than_rivals(odds[whole], rival, leads=claimed))


def _closes(found: GivingWay, way: Way, repeat: float) -> float:
    before, after = (float(np.mean(left**2)) for left in (found.before, way.left))
    return (before - after) / max(before - repeat**2, 1e-300)
