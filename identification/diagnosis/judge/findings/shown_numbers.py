# pyright: reportAttributeAccessIssue=false
"""Marks parameters that the recordings do not determine, and enlarges standard deviations for what the fit assumes.

Some parameters do not influence the torque, such as the position of a load along parallel joint axes. Their fitted
value, with a standard deviation of metres, must not be reported as a measurement.

The fit assumes that the numbers of the model are within their tolerances, and that each finding is the true cause. If
an assumption is doubtful, the parameters are fitted without it, too, and the change of each parameter is included in
its standard deviation (law of total variance).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.full_fit import FullFit
from identification.diagnosis.judge.findings.gate_state import ShownEffects
from identification.diagnosis.result import Value
from identification.diagnosis.search.search import Search, with_wide_tolerances
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.inertia import payload_body
from phantom_dyn.model.robot import Robot

# A parameter is unknown if its standard deviation exceeds this share of its plausible size and this share of its value.
_LARGEST_KNOWN_SHARE = 0.5


def with_unknown_marked(values: Mapping[str, Value], session: Session, joint: str | None) -> dict[str, Value]:
    """The parameters, with an infinite standard deviation for those that the recordings do not determine.

    Args:
        values: Parameters of a finding.
        session: Robot and recordings.
        joint: Joint of the finding; None if the finding concerns the whole robot.
    """
    limits = _largest_known_std(session, joint)
    out = {name: _unknown_marked(value, limits.get(value.unit)) for name, value in values.items()}
    if {"mass", "moment_x"} <= out.keys():
        value, std = (float(np.ravel(part)[0]) for part in (out["mass"].value, out["mass"].std))
        if std > _LARGEST_KNOWN_SHARE * abs(value):
            out["mass"] = replace(out["mass"], std=np.inf)
    return out


def _unknown_marked(value: Value, limit: float | None) -> Value:
    """A parameter with infinite standard deviations in place of those above both the limit and half of the value."""
    if limit is None:
        return value
    std, sizes = (np.atleast_1d(np.asarray(part, dtype=float)) for part in (value.std, value.value))
    # The limit grows with the value, because a light link may carry a load of several times its own weight.
    marked = np.where(std > np.maximum(limit, _LARGEST_KNOWN_SHARE * np.abs(sizes)), np.inf, std)
    return replace(value, std=marked.tolist() if isinstance(value.std, list) else float(marked[0]))


def _largest_known_std(session: Session, joint: str | None) -> dict[str, float]:
    """Limits of `_unknown_marked` by unit: half of the plausible size of a parameter with that unit."""
    robot = session.robot
    reach, mass = reach_of(robot), float(sum(inertia.mass for inertia in robot.model.inertias[1:]))
    out = {"m": reach, "kg m": mass * reach, "kg": mass, "kg m^2": mass * reach**2, "rad": np.pi, "1": 2.0}
    rows = [robot.joint_names.index(one) for one in (joint or "").split("+") if one in robot.joint_names]
    if rows:
        torque = max(_largest_value([log.tau[:, row] for log in session.logs]) for row in rows)
        speed = max(_largest_value([log.motion.v[:, row] for log in session.logs]) for row in rows)
        # The first pair has the units of revolute joints, the second those of prismatic ones.
        for force, damping in (("N m", "N m s/rad"), ("N", "N s/m")):
            out |= {force: torque, damping: torque / max(speed, 1e-9)}
    return {unit: _LARGEST_KNOWN_SHARE * size for unit, size in out.items() if size > 0.0}


def _largest_value(series: list[Float[Array, " n"]]) -> float:
    """Largest absolute value of several series; zero if all are empty."""
    return max((float(np.abs(one).max()) for one in series if len(one)), default=0.0)


def reach_of(robot: Robot) -> float:
    """Reach of a robot [m]: length of the chain to the joint that carries a load, plus the size of one more link.

    That size is the longest link, or twice the largest distance of a centre of mass from its joint. The distance from
    the base to the first joint does not count, because the height at which a robot is mounted says nothing about loads.
    """
    model, joint = robot.model, payload_body(robot)
    lengths = {
        one: float(np.linalg.norm(model.jointPlacements[one].translation))
        for one in range(1, model.njoints)
        if model.parents[one] > 0
    }
    reach = sum(lengths.get(one, 0.0) for one in model.supports[joint])
    lever = max((float(np.linalg.norm(inertia.lever)) for inertia in model.inertias[1:]), default=0.0)
    return reach + max([*lengths.values(), 2.0 * lever])


def widened_by_tolerances(fitted: FullFit, plain: Search, chosen: frozenset[Term]) -> FullFit:
    """The fit, with standard deviations enlarged by the change of each size if the tolerances are three times as wide.

    This is done only if a change of the model within its tolerances is at its limit: the model is then probably wrong
    by more, which also affects the sizes.

    Args:
        fitted: Fit of all parameters.
        plain: Fits in the frequency band of the diagnosis.
        chosen: The effects of the fit.
    """
    problem = plain.problem.of(chosen)
    found = plain.held_out_fit(chosen)
    nuisances = slice(0, problem.nuisance_count)
    if not np.any(np.abs(found.theta[nuisances]) >= rules.AT_LIMIT * problem.upper[nuisances]):
        return fitted
    return _widened_by_shift(fitted, chosen, with_wide_tolerances(plain).held_out_fit(chosen).theta - found.theta, 1.0)


def widened_by_rivals(fitted: FullFit, shown: ShownEffects) -> FullFit:
    """The fit, with standard deviations enlarged by the change of each size if a rival replaces another finding.

    Each set with rivals counts once, with its largest probability: a set in which one effect replaces two findings is a
    rival set of both. Sets that keep the finding and add an effect count for its size, too.

    Args:
        fitted: Fit of all parameters.
        shown: The reported findings, with the sets of effects that contain their rivals.
    """
    sets: dict[frozenset[Term], float] = {}
    for comparison in shown.comparisons.values():
        for rivals, probability in comparison.rival_sets:
            sets[rivals] = max(probability, sets.get(rivals, 0.0))
    for rivals, probability in sets.items():
        shift = shown.plain.held_out_fit(rivals).theta - shown.plain.held_out_fit(shown.all_found).theta
        fitted = _widened_by_shift(fitted, rivals, shift, probability)
    return fitted


def _widened_by_shift(fitted: FullFit, kept: frozenset[Term], shift: Float[Array, " K"], probability: float) -> FullFit:
    """The fit, with a probable shift of the coefficients added to their covariance.

    Args:
        fitted: Fit of all parameters.
        kept: Effects whose covariance is enlarged, if they are in the fit.
        shift: Shift of the coefficients of all columns, ``(K,)``.
        probability: Probability of the shift, by which its square is multiplied.
    """
    cov = fitted.cov.copy()
    for slices in fitted.term_slices:
        if slices.term in kept:
            moved = shift[list(slices.term.columns[: slices.count])]
            cov[slices.coefficients, slices.coefficients] += probability * np.outer(moved, moved)
    return replace(fitted, cov=cov)
