"""What the gates say of everything that may be wrong with a geometry: the entries of the ledger that are of poses.

The search adds and exchanges single numbers; here each cause, the numbers of one place, is asked by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.engine.claims import NEVER_CLAIMED, Claim, GateResult, Outcome, could_stand_for, until_failed
from identification.gates.above_chance import more_than_chance
from identification.gates.least_size import large_enough
from identification.gates.possible import possible_size
from identification.geometry.explained import ExplainedPoses
from identification.geometry.judged import Gap, Group, groups_of
from identification.geometry.result import PoseFinding

# An effect and its joint.
At = tuple[str, str | None]


def size_of(finding: PoseFinding) -> GateResult:
    """Whether a cause is large enough to be a finding; what is not is listed as minor."""
    return large_enough(finding.share, float(np.sqrt(max(finding.floors, 0.0))))


def claims_of(explained: ExplainedPoses, gap: Gap, found: Sequence[PoseFinding]) -> tuple[Claim[At], ...]:
    """What is claimed, then the nearest of what is not.

    Args:
        explained: The fit.
        gap: Of the poses.
        found: All that was found, minor or not.
    """
    groups = {explained.problem.terms[group[0]].place: group for group in groups_of(explained)}
    claims = [_claimed(explained, gap, groups[finding.effect, finding.joint], finding) for finding in found]
    places: dict[At, list[int]] = {}
    for k in explained.fits.seen:
        places.setdefault(explained.problem.terms[k].place, []).append(k)
    near = [_nearest(explained, at, terms, groups) for at, terms in places.items() if at not in groups]
    near = sorted(near, key=lambda one: -one.most)[:NEVER_CLAIMED]
    return (*claims, *(_not_claimed(explained, gap, one, groups) for one in near))


@dataclass(frozen=True)
class _Nearness:
    """The term of a place that comes nearest to being claimed, its gain beside all, and its gain instead of a cause.

    ``of_other`` is what that cause gains in its place.
    """

    at: At
    term: int
    beside: float = -np.inf
    instead_of: float = -np.inf
    other: At | None = None
    of_other: float = 0.0

    @property
    def most(self) -> float:
        return max(self.beside, self.instead_of)


def _nearest(explained: ExplainedPoses, at: At, terms: Sequence[int], groups: dict[At, Group]) -> _Nearness:
    fits, chosen = explained.fits, explained.chosen
    every = []
    for k in terms:
        # What is a combination of those that were found adds nothing to them.
        apart = fits.values((*chosen, k)) is not None
        beside = fits.squares(chosen) - fits.squares((*chosen, k)) if apart else 0.0
        every.append(_Nearness(at, k, beside))
        for other, group in groups.items():
            rest = tuple(one for one in chosen if one not in group)
            left = fits.squares(rest)
            if np.isfinite(left):
                gains = (left - fits.squares(some) for some in ((*rest, k), chosen))
                every.append(_Nearness(at, k, beside, next(gains), other, next(gains)))
    return max(every, key=lambda one: one.most)


def _claimed(explained: ExplainedPoses, gap: Gap, group: Group, finding: PoseFinding) -> Claim[At]:
    fits, chosen = explained.fits, explained.chosen
    # Each number of a cause has to earn its place: the least of them is what the search has asked for.
    least = min(fits.squares([k for k in chosen if k != term]) for term in group) - fits.squares(chosen)
    large = size_of(finding)
    gates = until_failed((more_than_chance(least, explained.price), large))
    outcome: Outcome = "claimed" if large.passed else "minor"
    return Claim(((finding.effect, finding.joint),), gates, outcome, (), {"closes": _closes(gap, group)}, "poses")


def _not_claimed(explained: ExplainedPoses, gap: Gap, near: _Nearness, groups: dict[At, Group]) -> Claim[At]:
    if not np.isfinite(near.beside):
        gates: tuple[GateResult, ...] = (possible_size(1),)
    else:
        gates = (more_than_chance(near.beside, explained.price),)
    figures, instead = {"closes": _closes(gap, (near.term,))}, ()
    if near.other is not None and could_stand_for(near.instead_of, explained.price, near.beside, near.of_other):
        instead = (near.other,)
        rest = tuple(k for k in explained.chosen if k not in groups[near.other])
        rows = float(gap.blocks.rows.sum())
        swapped, after = (float(x.sum()) / rows for x in (gap.blocks.losses((*rest, near.term)), gap.after))
        figures["floors_more"] = float(np.sqrt(swapped) - np.sqrt(after))
    return Claim((near.at,), gates, "displaced" if instead else "not_claimed", instead, figures, "poses")


def _closes(gap: Gap, terms: Sequence[int]) -> float:
    """Share of the gap that some terms close alone."""
    return float(gap.closed(gap.blocks.losses(terms), np.ones((1, len(gap.after))))[0])
