"""State of the loop over the gates, and the fits by which it judges claims; the fit of a set is computed once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache

from identification.diagnosis.columns.session import Series
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.full_fit import FullFit, full_fit
from identification.diagnosis.fit.gap import ResidualSums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.moved_by_noise import strong_motion_search
from identification.diagnosis.search.record import EffectJoint, Record
from identification.diagnosis.search.rival_sets import RivalComparison
from identification.diagnosis.search.search import Search, with_wide_tolerances
from identification.diagnosis.search.subset_residuals import subset_residuals
from phantom_dyn.array_types import Array, Bool, Float


@dataclass(frozen=True)
class Shown:
    """Effects that are shown to the user, and their fits in the judged band.

    Attributes:
        plain: The search with plain fits in the judged band.
        chosen: The effects, structures without a name among them.
        full_fit: Fit of all their parameters at once.
        comparisons: Comparison of each named effect with its rivals. Both are fitted together with ``all_found``, so
            that no rival wins by explaining an effect that is too small to be shown.
        all_found: All effects that the search has found, with rivals in the place of those that they replaced.
    """

    plain: Search
    chosen: frozenset[Term]
    full_fit: FullFit
    comparisons: dict[Term, RivalComparison]
    all_found: frozenset[Term] = frozenset()

    @property
    def problem(self) -> Problem:
        """The plain problem."""
        return self.plain.problem

    @property
    def named(self) -> frozenset[Term]:
        """Effects of the catalogue."""
        return frozenset(term for term in self.chosen if term.named)

    @property
    def named_fit(self) -> Fitted:
        """Held-out fit of the named effects."""
        return self.plain.held_out_fit(self.named)


@dataclass(frozen=True, eq=False)
class State:
    """State of the loop over the gates.

    Attributes:
        found: Effects of the search, with rivals in the place of those that they replaced; in all comparisons this set
            is fitted.
        shown: Effects among these that have passed all gates so far.
        barred: Effects and joints that are excluded as rivals.
        displaced: Effects and joints that a rival replaced; they do not come back while it is there.
        compared: Effects and joints that failed the gate `closes_for_sure`, and for which a rival was searched.
        exchanges: Pairs of replaced effects and the rivals that replaced them.
        compared_sets: Sets whose rivals were compared, in this order.
        done: True if the last of these sets is the result.
    """

    found: frozenset[Term]
    shown: frozenset[Term]
    barred: frozenset[EffectJoint] = frozenset()
    displaced: frozenset[EffectJoint] = frozenset()
    compared: frozenset[EffectJoint] = frozenset()
    exchanges: tuple[tuple[frozenset[Term], frozenset[Term]], ...] = ()
    compared_sets: tuple[Shown, ...] = ()
    done: bool = False

    @classmethod
    def of(cls, found: frozenset[Term]) -> State:
        """The state before the first gate: all that the search has found is shown."""
        return cls(found, found)

    def with_others(self, found: frozenset[Term]) -> State:
        """The state with another set, all of it shown again: an effect that failed in the first set may pass now."""
        return replace(self, found=found, shown=found)


@dataclass(frozen=True)
class Residuals:
    """Residuals of sets of effects, each with its own noise floor.

    Attributes:
        judge_of: Noise floors of the joints with a set of effects in the model.
        over_allowed: Residual of some joints with a set of effects in the model, divided by the largest that noise and
            the error of a sound model may leave. A quotient above one may be computed too small.
        has_structure: True if the state predicts a part of the residual of some joints, or if events are a part of it.
    """

    judge_of: Callable[[frozenset[Term]], Judge]
    over_allowed: Callable[[frozenset[Term], Bool[Array, " nv"]], Float[Array, " nv"]]
    has_structure: Callable[[frozenset[Term], Bool[Array, " nv"]], bool]


@dataclass(frozen=True, eq=False)
class Bench:
    """Searches and fits by which claims are judged; the fit of a set is computed once.

    Attributes:
        search: Rivals, with fits to whitened torques.
        plain: The same with plain fits in the judged band.
        noise: Noise of each log's torque.
        residuals: Residuals of sets of effects.
    """

    search: Search
    plain: Search
    noise: Series
    residuals: Residuals

    @property
    def record(self) -> Record:
        """The record of decisions, of which the ledger is made."""
        return self.search.record

    @cached_property
    def other_conditions(self) -> tuple[Search, ...]:
        """The search under conditions that should not change the result: another band, and other tolerances."""
        return self.plain, with_wide_tolerances(self.search)

    @cached_property
    def with_strong_motion(self) -> Callable[[frozenset[Term]], tuple[Search, dict[Term, Term]]]:
        """The search at frequencies where the torque is far above the noise that a set leaves, and its terms."""
        # The function does not refer to this bench, so that the bench's memory is freed at once.
        plain, noise = self.plain, self.noise
        return lru_cache(maxsize=1)(lambda found: strong_motion_search(plain, found, found, noise))

    @cached_property
    def subset_residuals(self) -> Callable[[frozenset[Term]], Callable[[frozenset[Term]], ResidualSums]]:
        """Squared residuals in the judged band of the subsets of a set."""
        plain = self.plain
        return lru_cache(maxsize=1)(lambda found: subset_residuals(plain, found))

    @cached_property
    def fit(self) -> Callable[[frozenset[Term]], FullFit]:
        """Fit of all parameters of a set at once."""
        plain = self.plain
        return cache(lambda shown: full_fit(plain.problem.of(shown), ordered(shown), plain.held_out_fit(shown)))
