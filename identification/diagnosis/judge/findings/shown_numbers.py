# pyright: reportAttributeAccessIssue=false
"""Which parameters of a finding the recordings determine, and their standard deviations under rival explanations.

Some parameters of an effect leave no torque in a recording, such as the position of a load along the axis of every
joint. The fit gives them a value with a standard deviation of metres, which must not be reported as a measurement.

The fit assumes that the model's numbers stay within their tolerances and that every finding is the true cause. Where
either is in doubt, the standard deviation includes the change of the parameter in the other case (law of total
variance).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.full_fit import FullFit
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.result import Value
from identification.diagnosis.search.search import Search, with_wide_tolerances
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.inertia import payload_body
from phantom_dyn.model.robot import Robot

# A parameter is unknown if its standard deviation exceeds this share of its plausible size and of its own value.
_UNKNOWN = 0.5


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
        if std > _UNKNOWN * abs(value):
            out["mass"] = replace(out["mass"], std=np.inf)
    return out


def _unknown_marked(value: Value, limit: float | None) -> Value:
    """A parameter, with an infinite standard deviation where that exceeds both its limit and half of its value."""
    if limit is None:
        return value
    std, sizes = (np.atleast_1d(np.asarray(part, dtype=float)) for part in (value.std, value.value))
    # The limit grows with the value, because a light link may carry a load of several times its own weight.
    marked = np.where(std > np.maximum(limit, _UNKNOWN * np.abs(sizes)), np.inf, std)
    return replace(value, std=marked.tolist() if isinstance(value.std, list) else float(marked[0]))


def _largest_known_std(session: Session, joint: str | None) -> dict[str, float]:
    """Largest standard deviation with which a parameter counts as known, by unit."""
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
    return {unit: _UNKNOWN * size for unit, size in out.items() if size > 0.0}


def _largest_value(series: list[Float[Array, " n"]]) -> float:
    """Largest absolute value of several series; zero if all are empty."""
    return max((float(np.abs(one).max()) for one in series if len(one)), default=0.0)


def reach_of(robot: Robot) -> float:
    """Reach of a robot [m]: the lengths of all links to the joint that carries a load, plus the longest once more.

    The base, which does not move, does not count: how high a robot is mounted says nothing about its loads.
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
    """The fit, with standard deviations enlarged by the change of each size under three times the tolerances.

    If no correction within the tolerances of the model ends at its limit, the stated tolerances hold. If one does, the
    model is probably wrong by more, and the standard deviation of a size does not include its share of that error.

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
    return _wider(fitted, chosen, with_wide_tolerances(plain).held_out_fit(chosen).theta - found.theta, 1.0)


def widened_by_rivals(fitted: FullFit, shown: Shown) -> FullFit:
    """The fit, with standard deviations enlarged by the change of each size where a rival replaces another finding.

    Each set of effects with rivals counts once, with its largest probability: one effect in place of two findings is a
    rival of both. Rivals that keep an effect and add another one count for the size of that effect, too.

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
        fitted = _wider(fitted, rivals, shift, probability)
    return fitted


def _wider(fitted: FullFit, kept: frozenset[Term], shift: Float[Array, " K"], probability: float) -> FullFit:
    """The fit, with the shift of the coefficients that both sets share added to their covariance."""
    cov = fitted.cov.copy()
    for slices in fitted.term_slices:
        if slices.term in kept:
            moved = shift[list(slices.term.columns[: slices.count])]
            cov[slices.coefficients, slices.coefficients] += probability * np.outer(moved, moved)
    return replace(fitted, cov=cov)
