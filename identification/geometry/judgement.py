"""Searches for the few geometry errors that explain measured poses; computes sizes, shares, rivals, detection limits.

The noise is estimated, outliers are left out, and few terms are searched for. This is repeated, because the
linearisation of the poses changes with the fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from identification.engine import contract_levels
from identification.engine.chance import squares_by_chance
from identification.engine.numerics.spans import orthogonal_part, orthonormal
from identification.engine.resampling import block_counts, interval, probabilities, share_by_likelihood
from identification.engine.search.few_columns import SetFits, few_columns, rivals_of, set_fits, until_same_set
from identification.engine.shapley import shapley_values
from identification.geometry.equations import BASE, TOOL, Equations, Estimate, PoseProblem
from identification.geometry.fit import fitted, start_of
from identification.geometry.result import Number, Place, PoseBound, PoseFinding, PoseRival, UnseenTerm
from identification.geometry.terms import ELASTIC, ZERO, PoseTerm, bounds_of
from identification.geometry.whitened import BLOCKS, Blocks, Noise, Whitened, noise_of, whitened
from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.random_streams import random_stream

CHANCE = 0.005
"""Probability that the best of all terms gains more than the price of a term by chance, if the model has no errors."""
_OUTLIER = 6.0
"""A pose with a larger residual, in units of the noise, is an outlier; by chance none of a thousand poses exceeds 5."""
_MOST_OUTLIERS = 0.05
"""Largest share of poses that may be outliers. If more have large residuals, none is left out."""


@dataclass(frozen=True)
class ExplainedPoses:
    """A fit of few terms to poses.

    Attributes:
        problem: Poses and terms.
        estimate: Fitted nuisances and chosen terms; other terms are zero.
        linearised: Equations linearised at the estimate.
        noise: Noise of the poses.
        whitened: Equations in units of the noise. Their residual is the one without any term.
        fits: Products of the columns and the residual of ``whitened``.
        price: Decrease of the sum of squares, in units of the noise variance, that a term needs.
        chosen: Indices of the chosen terms.
        kept: False for rows of outliers, ``(m,)``.
    """

    problem: PoseProblem
    estimate: Estimate
    linearised: Equations
    noise: Noise
    whitened: Whitened
    fits: SetFits
    price: float
    chosen: tuple[int, ...]
    kept: Bool[Array, " m"]


@dataclass(frozen=True)
class _PoseFit:
    """A fit about which columns are computed: estimate, equations linearised there, rows in use, and noise."""

    estimate: Estimate
    linearised: Equations
    kept: Bool[Array, " m"]
    noise: Noise


def explain_poses(problem: PoseProblem) -> ExplainedPoses:
    """The few terms that explain poses, with their fit.

    Args:
        problem: Poses and all candidate errors.
    """
    terms = problem.terms
    named = [term.unit for term in terms], [_name(term) for term in terms]
    moving = np.repeat([one.moving for one in problem.sets], 2)
    estimate, linearised = fitted(problem, start_of(problem), (), np.ones(2 * len(problem.sets)))
    block = _blocks(problem, linearised)

    def noise(at: _PoseFit) -> Noise:
        return noise_of(at.linearised, *named, moving, at.kept)

    def equations_at(at: _PoseFit) -> tuple[Whitened, SetFits, float]:
        in_noise_units = whitened(at.linearised, at.estimate.values, at.noise, block, at.kept, named)
        fits = set_fits(in_noise_units.columns, in_noise_units.residual, bounds_of(terms), in_noise_units.independent)
        return in_noise_units, fits, squares_by_chance(in_noise_units.rank, at.noise.degrees_of_freedom, CHANCE)

    def search(at: _PoseFit, earlier_searches: int) -> tuple[_PoseFit, tuple[int, ...]]:
        at = replace(at, noise=noise(at))
        if earlier_searches == 1:  # before, errors of the geometry would count as outliers
            at = replace(at, kept=_without_outliers(at.linearised, at.noise, at.kept))
            at = replace(at, noise=noise(at))
        return at, few_columns(*equations_at(at)[1:])

    def recompute(at: _PoseFit, chosen: tuple[int, ...]) -> _PoseFit:
        values = np.zeros(len(terms))
        values[list(chosen)] = at.estimate.values[list(chosen)]
        start = replace(at.estimate, values=values)
        estimate, linearised = fitted(problem, start, chosen, at.noise.weights, at.kept)
        return replace(at, estimate=estimate, linearised=linearised)

    every = np.ones(len(linearised.residual), dtype=bool)
    start = _PoseFit(estimate, linearised, every, noise_of(linearised, *named, moving, every))
    at, chosen = until_same_set(start, search, recompute)
    at = replace(at, noise=noise(at))
    return ExplainedPoses(problem, at.estimate, at.linearised, at.noise, *equations_at(at), chosen, at.kept)


def _name(term: PoseTerm) -> str:
    """Name of a term that no other term has."""
    return f"{term.joint}.{term.effect}.{term.parameter}"


def _blocks(problem: PoseProblem, linearised: Equations) -> Int[Array, " m"]:
    """Block of each row: equal parts of a recording, the same for all frames of the recording."""
    of_pose = np.concatenate(
        [BLOCKS * one.recording + np.arange(len(one.t)) * BLOCKS // len(one.t) for one in problem.sets]
    )
    return of_pose[linearised.pose]


def _without_outliers(linearised: Equations, noise: Noise, kept: Bool[Array, " m"]) -> Bool[Array, " m"]:
    """True for rows of poses that are no outliers; ``kept`` itself if too many poses have large residuals."""
    sigma = np.array([_robust_deviation(linearised, series) for series in range(len(noise.sigma))])
    size = np.abs(linearised.residual) / sigma[linearised.series]
    far = np.unique(linearised.pose[size > _OUTLIER])
    if len(far) > _MOST_OUTLIERS * len(np.unique(linearised.pose)):
        return kept
    return kept & ~np.isin(linearised.pose, far)


def _robust_deviation(linearised: Equations, series: int) -> float:
    """Standard deviation of the residual of a series, from the median of its size, which few outliers hardly change."""
    values = np.abs(linearised.residual[linearised.series == series])
    return max(1.4826 * float(np.median(values)), 1e-300) if len(values) else 1.0


_NEAR = 15.0  # rivals with a larger increase of the sum of squares (likelihood below a thousandth) are left out
_POWER = 1.6448536269514722  # 95 % quantile of the normal distribution
_LEAST_GAP = 1e-3  # a gap counts as at least this share of the loss before all findings, so that shares are finite
_ROUNDING = 1e-9  # a smaller load of a joint, relative to the largest load, is a rounding error
COMPENSATED = "passive joints of its loop take it up, so that it moves no measured frame"

Group = tuple[int, ...]
"""Indices of the terms of one effect on one joint."""


@dataclass(frozen=True)
class Gap:
    """Held-out losses of each block before and after all findings."""

    blocks: Blocks
    before: Float[Array, " B"]
    after: Float[Array, " B"]

    def closed(self, losses: Float[Array, " B"], weights: Float[Array, "R B"]) -> Float[Array, " R"]:
        """Share of the gap that a set of terms closes.

        Args:
            losses: Held-out loss of each block with these terms.
            weights: Weight of each block, one row for each replicate.
        """
        rows = weights @ self.blocks.rows
        before, after = (weights @ x / rows for x in (self.before, losses))
        after_all = weights @ self.after / rows
        # Losses are in units of the noise variance: without a gap a loss is 1. The gap ends at 1, or at the loss after
        # all findings if this is lower, or if the loss before is below 1 already.
        end = np.where(before > 1.0, np.minimum(1.0, after_all), after_all)
        return (before - after) / np.maximum(before - end, _LEAST_GAP * before)

    def share_closed(self, losses: Float[Array, " B"]) -> float:
        """Share of the gap that a set of terms closes on all blocks, each counted once."""
        return float(self.closed(losses, np.ones((1, len(losses))))[0])


def drawn_blocks(gap: Gap) -> Float[Array, "R B"]:
    """How often each block is drawn in each bootstrap replicate; all findings use the same draws."""
    return block_counts(len(gap.after), random_stream("bootstrap of the gap in poses"))


def by_effect_joint(terms: Sequence[PoseTerm], indices: Iterable[int]) -> dict[tuple[str, str | None], Group]:
    """Indices of terms, grouped by effect and joint."""
    groups: dict[tuple[str, str | None], Group] = {}
    for k in indices:
        groups[terms[k].effect_joint] = (*groups.get(terms[k].effect_joint, ()), k)
    return groups


def gap_of(explained: ExplainedPoses, blocks: Blocks) -> Gap:
    """Held-out losses before and after all findings."""
    return Gap(blocks, blocks.losses(()), blocks.losses(explained.chosen))


def findings_of(explained: ExplainedPoses, gap: Gap) -> tuple[PoseFinding, ...]:
    """The findings, that with the largest share of the gap first."""
    groups = tuple(by_effect_joint(explained.problem.terms, explained.chosen).values())
    shares = _shares(gap, groups)
    std = _deviations(explained)
    out = [_finding(explained, gap, group, groups, shares[group], std) for group in groups]
    return tuple(sorted(out, key=lambda finding: -finding.share))


def _deviations(explained: ExplainedPoses) -> dict[int, float]:
    """Standard deviation of each chosen term, if all of them are fitted together."""
    at = list(explained.chosen)
    if not at:
        return {}
    inverse = np.linalg.inv(explained.fits.products[np.ix_(at, at)])
    return dict(zip(at, np.sqrt(np.diag(inverse)).tolist(), strict=True))


def _finding(
    explained: ExplainedPoses, gap: Gap, group: Group, groups: Sequence[Group], share: float, std: dict[int, float]
) -> PoseFinding:
    """The finding of one group of terms: sizes, share of the gap, probability and rivals."""
    terms, values = explained.problem.terms, explained.estimate.values
    without = gap.blocks.losses([k for other in groups if other != group for k in other])
    drawn = drawn_blocks(gap)
    low, high = interval(gap.closed(gap.after, drawn) - gap.closed(without, drawn))
    probability, rivals = _rivals(explained, gap.blocks, group)
    return PoseFinding(
        effect=terms[group[0]].effect,
        joint=terms[group[0]].joint,
        parameters={terms[k].parameter: Number(float(values[k]), std[k], terms[k].unit) for k in group},
        share=share,
        gap_closed=gap.share_closed(gap.after) - gap.share_closed(without),
        gap_closed_interval=(float(low), float(high)),
        probability=probability,
        rivals=rivals,
        floors=float(np.sum(without - gap.after) / np.sum(gap.blocks.rows)),
    )


def _shares(gap: Gap, groups: Sequence[Group]) -> dict[Group, float]:
    """Share of the gap that each group closes (Shapley value)."""

    @cache
    def closed(inside: frozenset[Group]) -> float:
        return gap.share_closed(gap.blocks.losses([k for group in groups if group in inside for k in group]))

    return shapley_values(tuple(groups), closed)


def _rivals(explained: ExplainedPoses, blocks: Blocks, group: Group) -> tuple[float, tuple[PoseRival, ...]]:
    """Probability of a finding, and its rivals: sets of terms that explain the poses nearly as well in its place."""
    fits, chosen = explained.fits, explained.chosen
    rest = tuple(k for k in chosen if k not in group)
    near = [group, *rivals_of(fits, chosen, group, _NEAR)]
    losses = np.array([blocks.losses((*rest, *trial)) for trial in near]).T
    own, *others = probabilities(losses, (np.zeros(len(near)),), lead=share_by_likelihood).tolist()
    by_places: dict[tuple[Place, ...], float] = {}
    for trial, probability in zip(near[1:], others, strict=True):
        places = _places([explained.problem.terms[k] for k in trial])
        by_places[places] = by_places.get(places, 0.0) + probability
    listed = [(places, share) for places, share in by_places.items() if share >= contract_levels.LISTED]
    total = own + sum(share for _, share in listed)
    rivals = tuple(PoseRival(places, share / total) for places, share in sorted(listed, key=lambda item: -item[1]))
    return (own / total if total > 0 else 1.0), rivals


def _places(terms: Sequence[PoseTerm]) -> tuple[Place, ...]:
    """The terms, grouped by effect and joint."""
    groups = by_effect_joint(terms, range(len(terms)))
    return tuple(Place(*at, tuple(terms[k].parameter for k in group)) for at, group in groups.items())


def pose_bounds(
    explained: ExplainedPoses, findings: Sequence[PoseFinding]
) -> tuple[tuple[PoseBound, ...], tuple[UnseenTerm, ...]]:
    """Detection limits of all terms that are no findings, and terms that these poses cannot show.

    Args:
        explained: Fit of the findings to the poses.
        findings: All findings. Their rivals have no detection limit, because a rival of any size may be the true cause.
    """
    places = [place for finding in findings for rival in finding.rivals for place in rival.places]
    rivals = {(place.effect, place.joint, name) for place in places for name in place.parameters}
    columns, terms = explained.whitened.columns, explained.problem.terms
    own = orthogonal_part(columns, orthonormal(columns[:, list(explained.chosen)], 1e-9))
    wanted = np.sqrt(explained.price) + _POWER
    bounds, unseen = [], [_unseen(term, COMPENSATED) for term in explained.problem.compensated]
    for k, term in enumerate(terms):
        if k in explained.chosen:
            continue
        size, whole = float(np.linalg.norm(own[:, k])), float(np.linalg.norm(columns[:, k]))
        if not explained.whitened.independent[k] or (term.effect == ELASTIC and not _is_loaded(explained, term)):
            unseen.append(_unseen(term, _why_unseen(explained, k)))
        elif size < 1e-4 * whole:
            unseen.append(_unseen(term, "on these poses it is the same as what was found"))
        elif (term.effect, term.joint, term.parameter) in rivals:
            unseen.append(_unseen(term, "these poses do not separate it from what was found"))
        elif wanted / size > term.largest:
            unseen.append(_unseen(term, f"less than {wanted / size:.2g} {term.unit} would not show in these poses"))
        else:
            bounds.append(PoseBound(term.effect, term.joint, term.parameter, float(wanted / size), term.unit))
    return tuple(bounds), tuple(unseen)


def _unseen(term: PoseTerm, why: str) -> UnseenTerm:
    """A term that the poses cannot show."""
    return UnseenTerm(term.effect, term.joint, term.parameter, why)


def _why_unseen(explained: ExplainedPoses, k: int) -> str:
    """Reason why poses cannot show a term: it moves no frame, or a change of nuisances has the same effect."""
    linearised, term = explained.linearised, explained.problem.terms[k]
    scale = (explained.kept * explained.noise.weights[linearised.series])[:, None]
    column = linearised.columns[:, [k]] * scale
    size = float(np.linalg.norm(column))
    if size == 0.0 or (term.effect == ELASTIC and not _is_loaded(explained, term)):
        if term.effect == ELASTIC:
            return "its load is zero in all poses"
        return "it moves no measured frame"
    for kinds, words in (
        ((BASE,), "it is the same as another pose of the robot in the axes of what measured"),
        ((TOOL,), "it is the same as another pose of the target on its frame"),
        ((BASE, TOOL), "it is the same as other poses of the robot and of the target together"),
    ):
        columns = linearised.nuisance[:, [kind.kind in kinds for kind in linearised.kinds]] * scale
        if np.linalg.norm(orthogonal_part(column, orthonormal(columns, 1e-9))) < 1e-4 * size:
            return words
    if term.effect == ZERO and not _moves(explained, term):
        return "its joint does not move, so that this is the same as other poses of robot, target and clock together"
    return "it is the same as other poses of the robot and of the target and a delay together"


def _is_loaded(explained: ExplainedPoses, term: PoseTerm) -> bool:
    """True if the load of a term's joint is more than a rounding error of the other joints' loads."""
    loads = np.concatenate([np.abs(one.load) for one in explained.problem.sets])
    return bool(loads[:, term.row].max() > _ROUNDING * max(float(loads.max()), 1e-300))


def _moves(explained: ExplainedPoses, term: PoseTerm) -> bool:
    """True if the joint of a term has different positions in the poses of some set."""
    return any(np.ptp(one.q[:, term.row]) > 0 for one in explained.problem.sets)
