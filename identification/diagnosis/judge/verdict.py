"""Residual without a cause, and the verdict that follows from it."""

from __future__ import annotations

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.flexible import held_out_ridge, state_features
from identification.diagnosis.fit.gap import held_out_torque, residual_after, sums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.findings import Shown
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.regimes import regime_shares
from identification.diagnosis.model.columns import Columns
from identification.diagnosis.model.session import Series
from identification.diagnosis.model.terms import ordered
from identification.diagnosis.noise.noise_floor import rms
from identification.diagnosis.result import Adjusted, Finding, Unexplained

Array = np.ndarray


def verdict(findings: tuple[Finding, ...], unexplained: Unexplained, columns: Columns) -> str:
    """The contract's verdict."""
    if not any(use.any() for use in columns.usable):
        return "not_testable"
    little = not unexplained.structured or unexplained.fraction_of_explainable < 0.1
    if not findings:
        return "no_gap" if little else "unknown"
    if little:
        return "explained"
    return "unknown" if unexplained.fraction_of_explainable > 0.5 else "partly_explained"


def unexplained(shown: Shown, judge: Judge, residual: Series, whole: Series) -> Unexplained:
    """How much of the explainable gap is left, and where it sits if it has structure.

    Args:
        shown: The effects that are shown.
        judge: Of the gap.
        residual: What the named effects leave, in the judged band.
        whole: What all of them leave, structures without a name too.
    """
    floor, problem, nameless = judge.floor, shown.problem, shown.chosen - shown.named
    flexible = tuple(w - p for w, p in zip(whole, flexible_prediction(problem, whole), strict=True))
    predicted = tuple(r - s for r, s in zip(residual, flexible, strict=True))
    moved = held_out_torque(problem, frozenset(), shown.plain.evaluate(frozenset()))
    within, after, smooth = (
        sums(problem, series) for series in (judge.narrow(residual_after(problem, moved)), residual, flexible)
    )
    once = np.ones((1, len(after.counts)))
    allowed, left, best = (float(s.loss(floor, once)[0]) for s in (within, after, smooth))
    gains = (after.squares - smooth.squares) / floor**2
    total = gains.sum(axis=1)
    error = float(np.sqrt(len(total)) * total.std()) + 1e-12
    lasting = left - best > rules.STRUCTURE_SHARE * left and total.sum() > rules.STRUCTURE_ERRORS * error
    structured = bool(nameless) or bool(lasting or left - best > rules.PLAIN_STRUCTURE * left)
    # What moves within the tolerances explain is no gap.
    explainable = allowed - min(best, left)
    fraction = float(np.clip((left - best) / explainable, 0.0, 1.0)) if explainable > 0 else 0.0
    joint, regime = None, None
    if structured:
        row = int(np.argmax(gains.sum(axis=0)))
        joint = judge.problem.session.robot.joint_names[row]
        _, regime = regime_shares(judge.problem, predicted, row)
        here = [term.effect.regime for term in ordered(nameless) if term.joint == joint]
        regime = here[0] if here else regime
    return Unexplained(fraction, structured, joint, regime)


def flexible_prediction(problem: Problem, residual: Series) -> Series:
    """Held-out prediction of the residual by a flexible regression on the state; zero where it does not help."""
    columns = problem.columns
    out = [np.zeros_like(r) for r in residual]
    for j in range(len(columns.rows)):
        x = [state_features(columns, log, k, j) for k, log in enumerate(problem.session.logs)]
        y, use = [r[:, j] for r in residual], [u[:, j] for u in columns.usable]
        predicted, error = held_out_ridge(x, y, use, problem.blocks, problem.grams.fold)
        if error < rms([v[m] for v, m in zip(y, use, strict=True)]) ** 2:
            for k, p in enumerate(predicted):
                out[k][:, j] = p
    return tuple(out)


def adjusted(problem: Problem, found: Fitted) -> tuple[Adjusted, ...]:
    """Moves of the model inside its tolerance that the data ask for: beyond two of their deviations."""
    std = np.sqrt(np.diag(found.cov))[: problem.nuisances]
    return tuple(
        Adjusted(nuisance.name, float(change), nuisance.sigma)
        for nuisance, change, deviation in zip(
            problem.columns.nuisances, found.theta[: problem.nuisances], std, strict=True
        )
        if nuisance.relative and abs(change) > 2 * deviation
    )
