"""Chosen effects as findings: parameters, share of the gap that each closes, and rivals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.gap import Sums, held_out_torque, residual_after, sums
from identification.diagnosis.fit.joint_fit import JointFit, joint_fit
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.findings.missing_parts import missing_part_notes, named_as_part, part_instead
from identification.diagnosis.judge.findings.parameters import finding_loadings, finding_parameters
from identification.diagnosis.judge.judged_band import Judge, gap_is_there, visible
from identification.diagnosis.judge.moved_by_noise import shown_by_motion
from identification.diagnosis.judge.shares import drawn_blocks, gap_of, shares_of
from identification.diagnosis.model.session import Series
from identification.diagnosis.model.terms import Term, ordered
from identification.diagnosis.result import Finding
from identification.diagnosis.search.rival_sets import (
    NONE_BARRED,
    Place,
    Standing,
    stand,
    with_wide_tolerances,
)
from identification.diagnosis.search.search import Search, possible, with_term
from identification.diagnosis.search.special_cases import implausible, places_of, simpler
from identification.diagnosis.search.squares_left import squares_left
from identification.diagnosis.search.stepwise import forward
from identification.diagnosis.search.swaps import replaced
from identification.notes import Code, Note, Said
from phantom_dyn.array_types import Float
from phantom_dyn.effects.effect import Effect
from phantom_dyn.model.robot import Robot

Array = np.ndarray

# Sets that are looked at where each says that another effect should lead; then the one with the least doubt is shown.
_MOST_LEADERS = 8


@dataclass(frozen=True)
class Shown:
    """Effects that are shown to the user, and their fits in the judged band.

    Attributes:
        plain: The search with plain fits in the judged band.
        chosen: The effects, structures without a name among them.
        joint_fit: Fit of all their numbers at once.
        standings: Of each named one, beside all that the search has found, what nobody would see included: a rival must
            not win by making up for that.
    """

    plain: Search
    chosen: frozenset[Term]
    joint_fit: JointFit
    standings: dict[Term, Standing]

    @property
    def problem(self) -> Problem:
        """The plain problem."""
        return self.plain.problem

    @property
    def named(self) -> frozenset[Term]:
        """Effects of the catalogue."""
        return frozenset(term for term in self.chosen if term.named)

    @property
    def found(self) -> Fitted:
        """Held-out fit of the named effects."""
        return self.plain.evaluate(self.named)


def shown_effects(
    search: Search,
    plain: Search,
    chosen: frozenset[Term],
    present_of: Callable[[frozenset[Term]], frozenset[Term]],
    barred: frozenset[Place] = NONE_BARRED,
) -> Shown:
    """Chosen effects that are visible in the judged band and differ from nothing there; none where there is no gap.

    Where a rival has to lead in the place of one of them, it takes that place. What was outdone once does not come
    back: where each of several sets says that another one should lead, that one is shown whose findings are outdone
    least, and a finding and the rival that outdoes it share what both have.

    Args:
        search: Rivals, with fits to white noise.
        plain: The same with plain fits in the judged band.
        chosen: What the search has found.
        present_of: Those of a set that are present, see `present_effects`.
        barred: Effects and joints that are no rivals.
    """
    outdone: set[Place] = set()
    shown: list[Shown] = []
    again, retried = (plain, with_wide_tolerances(search)), False
    while True:
        present = present_of(chosen)
        kept, settled, fitted, simple = distinct(search, plain, present, chosen)
        barred = barred | simple
        uncertain = frozenset(term for term in present & settled if term.named and term not in kept)
        instead = frozenset() if retried else _instead_of(plain, uncertain, kept, barred)
        if instead:
            retried = True
            chosen, barred = (settled - uncertain) | instead, barred | {term.place for term in uncertain}
            continue
        standings = {term: stand(search, settled, term, barred, again) for term in ordered(kept) if term.named}
        shown.append(Shown(plain.of(kept), kept, fitted, standings))
        ways = [standing.instead for standing in standings.values() if standing.instead is not None]
        if not ways:
            return shown[-1]
        instead = _together(settled, ways, outdone)
        if instead == settled or len(shown) == _MOST_LEADERS:
            least = min(shown, key=lambda one: max(map(_outdone, one.standings.values()), default=0.0))
            return replace(least, standings={term: _evened(one) for term, one in least.standings.items()})
        outdone.update(term.place for term in settled - instead)
        chosen = instead


def _instead_of(
    plain: Search, uncertain: frozenset[Term], kept: frozenset[Term], barred: frozenset[Place]
) -> frozenset[Term]:
    """Effects that explain what is left where others turn out to be no more than nothing; none if nothing does."""
    if not uncertain:
        return frozenset()
    gone = barred | {term.place for term in uncertain}
    others = replace(plain, terms=tuple(term for term in plain.terms if term.place not in gone))
    return forward(others, kept, lambda _: None) - kept


def _together(chosen: frozenset[Term], ways: list[frozenset[Term]], outdone: set[Place]) -> frozenset[Term]:
    """A set with all changes that lead to others of which each concerns other joints, and brings back nothing outdone.

    Two changes on one joint are not made at once: the second one is looked at again beside the first.
    """
    out, moved = chosen, set[str | None]()
    for way in ways:
        joints = {term.joint for term in chosen ^ way}
        alone = joints.isdisjoint(moved) and None not in moved and (None not in joints or not moved)
        if alone and outdone.isdisjoint(term.place for term in way - chosen):
            out, moved = (out - (chosen - way)) | (way - chosen), moved | joints
    return out


def present_effects(plain: Search, chosen: frozenset[Term], noise: Series) -> frozenset[Term]:
    """Effects that show in the judged band, and show there by motion; none where there is no gap."""
    present = chosen if gap_is_there(plain.problem, noise) else frozenset()
    present = shown_by_motion(plain, present, noise)
    return visible(squares_left(plain, present), present)


def _outdone(standing: Standing) -> float:
    """How much more probable than a finding the rival is that has to lead in its place."""
    return standing.rivals[0].probability - standing.probability if standing.instead is not None else 0.0


def _evened(standing: Standing) -> Standing:
    """The same with equal shares of a finding and of the rivals that outdo it."""
    if _outdone(standing) <= 0.0:
        return standing
    shares = [standing.probability]
    for rival in standing.rivals:
        if rival.probability > np.mean(shares):
            shares.append(rival.probability)
    even, above = float(np.mean(shares)), len(shares) - 1
    rivals = (
        *(replace(rival, probability=even) for rival in standing.rivals[:above]),
        *standing.rivals[above:],
    )
    return Standing(even, rivals)


def distinct(
    search: Search, plain: Search, kept: frozenset[Term], chosen: frozenset[Term]
) -> tuple[frozenset[Term], frozenset[Term], JointFit, frozenset[Place]]:
    """Effects that differ from anything simpler in a joint fit of all, and that fit.

    The search holds all but the coefficients, and weighs noise otherwise: what gains there may be nothing in the fit
    that states its size. One by one, those that differ least certainly from nothing are left out. Where a law ends on
    a special case of itself, or differs from it in neither fit, that takes its place; so does a missing part of the
    model in the place of inertial parameters that it explains.

    Args:
        search: Rivals, with fits to white noise.
        plain: The same with plain fits in the judged band.
        kept: Effects that are to be shown.
        chosen: All that the search has found.

    Returns:
        What is left of both sets, the fit of the first, and the laws that were no more than a simpler one.
    """
    robot, barred = plain.problem.session.robot, NONE_BARRED
    while True:
        fitted = joint_fit(plain.problem.of(kept), ordered(kept), plain.evaluate(kept))
        found = {term: simpler(robot, term, fitted) for term in ordered(kept) if term.named}
        white = search.evaluate(chosen)
        hardly = {
            t: case for t, case in found.items() if case is not None and _is_simpler(robot, t, case, chosen, white)
        }
        if not hardly:
            swap = part_instead(plain, kept, fitted)
            if swap is None:
                return kept, chosen, fitted, barred
            rich, payload = swap
            kept, chosen = (replaced(some, rich, frozenset([payload])) for some in (kept, chosen))
            barred = barred | {rich.place} | named_as_part(search, chosen, payload)
            continue
        least = min(hardly, key=lambda term: hardly[term][0])
        names = hardly[least][1]
        kept = kept - {least}
        if not names:
            continue
        barred = barred | {least.place}
        instead = [one for one in plain.terms if one.effect.name in names and one.joint == least.joint]
        chosen = replaced(chosen, least, frozenset(instead))
        for one in instead:
            kept = with_term(kept, one) if possible(kept, one) else kept


def _is_simpler(
    robot: Robot, term: Term, case: tuple[float, tuple[str, ...]], chosen: frozenset[Term], white: Fitted
) -> bool:
    """True if an effect is the special case that a fit hardly tells from it, by what another fit says as well."""
    certain, names = case
    if not names or certain == 0.0 or term not in chosen:
        return True
    return places_of(robot, term, white) != (term.place,)


def remarks(shown: Shown) -> tuple[Said, ...]:
    """Notes on what the sizes of findings say of the robot, and on each size that no sound robot has."""
    robot, out = shown.problem.session.robot, list[Said]()
    for term in ordered(shown.named):
        effect, own = term.effect, shown.joint_fit.coefficients(term)
        assert isinstance(effect, Effect)
        if effect.inertial == "free":
            out += missing_part_notes(shown.problem, term, own)
            continue
        remark = effect.remark(robot, term.joint, effect.from_coefficients(robot, term.joint, own, term.shape))
        out += [remark] if remark else []
        fault = implausible(robot, term, own)
        if fault is not None:
            parameter, value = fault
            low, high = parameter.plausible or (-np.inf, np.inf)
            numbers = {"effect": effect.name, "parameter": parameter.name, "value": float(value)}
            numbers |= {"unit": parameter.unit, "because": parameter.plausible_because}
            limits = {"least": low if np.isfinite(low) else None, "most": high if np.isfinite(high) else None}
            out.append(Note(Code.IMPLAUSIBLE_SIZE, term.joint, {**numbers, **limits}))
    return tuple(out)


@dataclass(frozen=True)
class Claim:
    """A finding, the torque of the corrected model without it, and whether it is too small to matter."""

    finding: Finding
    without: Series
    minor: bool = False


def findings_without(shown: Shown, judge: Judge, within: Sums) -> tuple[Claim, ...]:
    """Each named effect with its share, its gap closed and rivals, and the torque of the other named ones without it.

    Args:
        shown: The effects that are shown.
        judge: Of the gap.
        within: What the best moves within the tolerances leave.
    """
    plain, chosen, fitted = shown.plain, shown.chosen, shown.joint_fit
    robot = plain.problem.session.robot
    problem, floor, found = plain.problem, judge.floor, plain.evaluate(chosen)
    after = sums(problem, judge.narrow(residual_after(problem, held_out_torque(problem, chosen, found))))
    drawn = drawn_blocks(within)
    once = np.ones((1, len(within.counts)))
    shares = shares_of(judge, plain, shown.named)
    out = []
    for term in ordered(chosen):
        if not term.named:
            continue
        others = frozenset(other for other in chosen if other.named and other is not term)
        without = plain.evaluate(chosen - {term})
        torque = held_out_torque(problem, chosen - {term}, without)
        lost = sums(problem, judge.narrow(residual_after(problem, torque)))

        def closed(weights: Float[Array, "R B"], lost: Sums = lost) -> Float[Array, " R"]:
            gap = gap_of(judge, within, after, weights)
            return (lost.loss(floor, weights) - after.loss(floor, weights)) / gap

        standing = shown.standings[term]
        low, high = np.percentile(closed(drawn), [2.5, 97.5])
        finding = Finding(
            effect=term.effect.name,
            joint=term.joint,
            regime=term.effect.regime,
            parameters=finding_parameters(robot, term, fitted),
            gap_closed=float(closed(once)[0]),
            gap_closed_interval=(float(low), float(high)),
            probability=standing.probability,
            rivals=standing.rivals,
            verdict="one_of" if standing.rivals else "supported",
            loadings=finding_loadings(robot, term, fitted),
            share=shares[term],
        )
        more = np.sqrt(np.maximum(lost.rms() ** 2 - after.rms() ** 2, 0.0))
        minor = finding.gap_closed < rules.MINOR_SHARE and bool(np.all(more < rules.MINOR_FLOORS * floor))
        if others != chosen - {term}:
            torque = held_out_torque(problem, others, plain.evaluate(others))
        out.append(Claim(finding, torque, minor))
    return tuple(out)
