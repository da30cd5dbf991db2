"""Data of the loop over the judge's gates (`shown.py`): its state, and the searches and fits that gates use."""

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
from identification.diagnosis.judge.judged_band import JudgedBand
from identification.diagnosis.judge.strong_motion import strong_motion_search
from identification.diagnosis.search.record import EffectJoint, Record
from identification.diagnosis.search.rival_sets import RivalComparison
from identification.diagnosis.search.search import Search, with_wide_tolerances
from identification.diagnosis.search.subset_residuals import subset_residuals
from phantom_dyn.array_types import Array, Bool, Float


@dataclass(frozen=True)
class ShownEffects:
    """Effects that are shown to the user, and their fits in the judged band.

    Attributes:
        plain: The search with plain fits in the judged band.
        chosen: The shown effects, including structures without a name (they match no effect of the catalogue).
        full_fit: Fit of all parameters of these effects at once.
        comparisons: Comparison of each named effect with its rivals, in fits with all other effects of ``all_found``:
            no rival then wins by explaining an effect that is too small to be shown.
        all_found: All effects that the search has found, after replacements of effects by rivals.
    """

    plain: Search
    chosen: frozenset[Term]
    full_fit: FullFit
    comparisons: dict[Term, RivalComparison]
    all_found: frozenset[Term] = frozenset()

    @property
    def problem(self) -> Problem:
        """Recordings, columns and blocks of the plain fits."""
        return self.plain.problem

    @property
    def named(self) -> frozenset[Term]:
        """The shown effects that are in the catalogue."""
        return frozenset(term for term in self.chosen if term.named)

    @property
    def named_fit(self) -> Fitted:
        """Held-out fit of the named effects."""
        return self.plain.held_out_fit(self.named)


@dataclass(frozen=True, eq=False)
class LoopState:
    """State of the loop over the gates.

    Attributes:
        found: Effects of the search, after replacements of effects by rivals; the set that is compared with rivals.
        shown: Those effects of ``found`` that have passed all gates so far.
        barred: Effects and joints that are excluded as rivals.
        displaced: Effects and joints that were replaced by a rival, and may not return while the rival is in the set.
        compared: Effects and joints that failed the gate `closes_for_sure`, and for which a rival was searched.
        exchanges: Pairs of replaced effects and the rivals that replaced them.
        compared_sets: Sets whose effects were compared with rivals, in the order of the comparisons.
        done: True if the last of ``compared_sets`` is the result.
    """

    found: frozenset[Term]
    shown: frozenset[Term]
    barred: frozenset[EffectJoint] = frozenset()
    displaced: frozenset[EffectJoint] = frozenset()
    compared: frozenset[EffectJoint] = frozenset()
    exchanges: tuple[tuple[frozenset[Term], frozenset[Term]], ...] = ()
    compared_sets: tuple[ShownEffects, ...] = ()
    done: bool = False

    @classmethod
    def of(cls, found: frozenset[Term]) -> LoopState:
        """The state before the first gate, in which all found effects are shown."""
        return cls(found, found)

    def with_others(self, found: frozenset[Term]) -> LoopState:
        """The state with another set of effects, all shown: an effect that failed in the old set may pass now."""
        return replace(self, found=found, shown=found)


@dataclass(frozen=True)
class Residuals:
    """Functions of a set of effects, which describe the residual with this set in the model.

    Attributes:
        judged_band_of: Noise floors of the joints; they depend on the set.
        over_allowed: Residual of the given joints, divided by the largest residual of a sound model with noise; zero
            for other joints. A value above one is only a lower limit of the exact one.
        has_structure: True if the state of the robot predicts a part of the residual of the given joints, or if the
            residual contains events.
    """

    judged_band_of: Callable[[frozenset[Term]], JudgedBand]
    over_allowed: Callable[[frozenset[Term], Bool[Array, " nv"]], Float[Array, " nv"]]
    has_structure: Callable[[frozenset[Term], Bool[Array, " nv"]], bool]


@dataclass(frozen=True, eq=False)
class GateContext:
    """Searches and fits that the gates use; each fit is computed once.

    Attributes:
        search: Rivals, with fits to whitened torques.
        plain: The same with plain fits in the judged band.
        noise: Noise of each log's torque.
        residuals: Functions that describe the residual with a set of effects.
    """

    search: Search
    plain: Search
    noise: Series
    residuals: Residuals

    @property
    def record(self) -> Record:
        """The record of decisions, from which the ledger is made."""
        return self.search.record

    @cached_property
    def other_conditions(self) -> tuple[Search, ...]:
        """The search under conditions that should not change the result: in the judged band, with wide tolerances."""
        return self.plain, with_wide_tolerances(self.search)

    @cached_property
    def with_strong_motion(self) -> Callable[[frozenset[Term]], tuple[Search, dict[Term, Term]]]:
        """Function of a set of effects that returns the result of `strong_motion_search` for this set."""
        # The function does not refer to this object, so that its memory is freed without a garbage collection.
        plain, noise = self.plain, self.noise
        return lru_cache(maxsize=1)(lambda found: strong_motion_search(plain, found, found, noise))

    @cached_property
    def subset_residuals(self) -> Callable[[frozenset[Term]], Callable[[frozenset[Term]], ResidualSums]]:
        """Function of a set of effects that returns its `subset_residuals` in the judged band."""
        plain = self.plain
        return lru_cache(maxsize=1)(lambda found: subset_residuals(plain, found))

    @cached_property
    def fit(self) -> Callable[[frozenset[Term]], FullFit]:
        """Function of a set of effects that returns the fit of all its parameters at once."""
        plain = self.plain
        return cache(lambda shown: full_fit(plain.problem.of(shown), ordered(shown), plain.held_out_fit(shown)))
