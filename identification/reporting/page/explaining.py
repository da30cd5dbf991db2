"""Chooses the variable over which a residual is drawn: the variable that explains most of the residual.

The diagnosis contains the motion of driven joints; that of passive joints of a closed chain is computed.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.fit.flexible import displacement_since_reversal
from identification.diagnosis.result import Diagnosis, Finding
from identification.reporting.charts.thinning import bin_numbers, gap_starts
from identification.words.effect_words import words_of
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.effects.described import ANY_VARIABLE
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

_CLEARLY = 0.03  # a later candidate must explain more of the residual's variance by at least this share
_PRESLIDING_WIDTHS = 8.0  # displacements since reversal are drawn up to this multiple of the breakaway displacement
_MIDDLE = (0.5, 99.5)  # percentiles between which a derivative is drawn
_LEAST_PERIODS = 1.5  # positions are drawn modulo one period if the motion covers more than this number of periods


@dataclass(frozen=True)
class Variable:
    """A variable over which a residual is drawn.

    Attributes:
        name: Label of the axis, without the unit.
        unit: Unit of the variable.
        x: Samples, shape ``(N,)``; not finite where the variable has no value.
        by_direction: True if the residual has two branches, one for each direction of motion.
        reach: Largest absolute value that is drawn; None to draw all values.
    """

    name: str
    unit: str
    x: Float[Array, " N"]
    by_direction: bool = False
    reach: float | None = None


def joint_of(diagnosis: Diagnosis, joint: str | None) -> int:
    """Index of the joint whose residual shows a finding.

    It is the joint of the finding if it is driven. For a coupling, it is the one of the two joints whose residual
    decreased more; for the whole robot or a passive joint, the joint whose residual decreased most.
    """
    rows = {gap.joint: k for k, gap in enumerate(diagnosis.joints)}
    if joint in rows:
        return rows[joint]
    candidates = [rows[name] for name in (joint or "").split("+") if name in rows] or list(rows.values())
    gains = [_gain(diagnosis, k) for k in candidates]
    return candidates[int(np.argmax(gains))]


def explaining_variable(
    diagnosis: Diagnosis, motions: dict[str, JointMotion], finding: Finding, residual: Float[Array, " N"]
) -> Variable:
    """The variable of the finding's law that explains most of a residual.

    Args:
        diagnosis: The diagnosis, with its samples.
        motions: Motion of each joint by name.
        finding: The finding that explains the residual.
        residual: Residual of the joint that shows the finding, shape ``(N,)``.
    """
    names = words_of(finding).shown_over
    forward = motions[diagnosis.joints[joint_of(diagnosis, finding.joint)].joint].v > 0
    return _best([_variable(name, diagnosis, motions, finding) for name in names], residual, forward)


def strongest_variable(
    diagnosis: Diagnosis, motions: dict[str, JointMotion], joint: str, residual: Float[Array, " N"]
) -> Variable:
    """The variable that explains most of a residual of unknown cause."""
    nameless = Finding("", joint, "everywhere", {}, 0.0, (0.0, 0.0), 0.0, (), "supported")
    variables = [_variable(name, diagnosis, motions, nameless) for name in ANY_VARIABLE]
    return _best(variables, residual, motions[joint].v > 0)


def explained_share(x: Float[Array, " N"], y: Float[Array, " N"], forward: Bool[Array, " N"] | None = None) -> float:
    """Share of the variance of `y` that its means in bins of `x` explain.

    With `forward`, each direction of motion has its own bins.
    """
    finite = np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(finite) < 2 or np.var(y[finite]) == 0:
        return 0.0
    # Without clipping, a few extreme values would widen the bins, and most samples would be in one bin.
    bins = bin_numbers(np.clip(x[finite], *np.percentile(x[finite], _MIDDLE)))
    groups = np.unique(bins if forward is None else 2 * bins + forward[finite], return_inverse=True)[1]
    counts = np.bincount(groups)
    means = np.bincount(groups, y[finite]) / counts
    # The means also follow noise. The expected share of noise is subtracted.
    spread = np.sum(counts * (means - y[finite].mean()) ** 2) - (len(counts) - 1) * np.var(y[finite])
    return float(np.clip(spread / (len(groups) * np.var(y[finite])), 0.0, 1.0))


def displacement_by_recording(
    t: Float[Array, " N"], q: Float[Array, " N"], v: Float[Array, " N"]
) -> Float[Array, " N"]:
    """Displacement of a joint since its last reversal; NaN before the first reversal of a recording.

    A stop between two motions in the same direction is no reversal.
    """
    out = np.full(len(t), np.nan)
    starts = np.concatenate([[0], gap_starts(t), [len(t)]]) if len(t) else np.zeros(0, dtype=int)
    sign = np.sign(v)
    # A standstill gets the sign of the last motion before it.
    sign = sign[np.maximum.accumulate(np.where(sign != 0, np.arange(len(v)), 0))]
    for start, stop in pairwise(starts):
        turns = np.flatnonzero(sign[start + 1 : stop] != sign[start : stop - 1])
        if len(turns):
            first = start + 1 + turns[0]
            out[first:stop] = displacement_since_reversal(q[start:stop], sign[start:stop])[first - start :]
    return out


def _gain(diagnosis: Diagnosis, row: int) -> float:
    """Decrease of a joint's mean square residual, divided by its squared noise floor."""
    gap = diagnosis.joints[row]
    floor = gap.noise_floor if gap.noise_floor > 0 else 1.0
    return float(np.nan_to_num((gap.rms_before**2 - gap.rms_after**2) / floor**2))


def _best(variables: list[Variable], residual: Float[Array, " N"], forward: Bool[Array, " N"]) -> Variable:
    """The variable that explains most of a residual; an earlier one unless a later one is clearly better."""
    best, share = variables[0], -1.0
    for variable in variables:
        explained = explained_share(variable.x, residual, forward if variable.by_direction else None)
        if share < 0 or explained > share + _CLEARLY:
            best, share = variable, explained
    return best


def _variable(name: str, diagnosis: Diagnosis, motions: dict[str, JointMotion], finding: Finding) -> Variable:
    """The samples of a variable, by its name in the catalogue of effects."""
    evidence, row = diagnosis.evidence, joint_of(diagnosis, finding.joint)
    gap = diagnosis.joints[row]
    linear = gap.unit in ("N", "m")
    load = "N" if linear else "N m"  # not the gap's unit, which is that of a position if the robot was at rest
    torque, length = ("force" if linear else "torque"), ("m" if linear else "rad")
    # The friction of a passive joint depends on the passive joint's motion, but acts on the driven joint's torque.
    motion = motions.get(finding.joint or "", motions[gap.joint])
    after = f" of {finding.joint}" if finding.joint in motions and finding.joint != gap.joint else ""
    if name == "velocity":
        return Variable(f"velocity{after}", f"{length}/s", motion.v)
    if name == "acceleration":
        return Variable(f"acceleration{after}", f"{length}/s²", motion.a)
    if name == "position":
        return Variable(f"position{after}", length, motion.q, by_direction=True)
    if name == "displacement":
        width = _first_number(finding, "displacement")
        x = displacement_by_recording(evidence.t, motion.q, motion.v)
        reach = None if width is None else _PRESLIDING_WIDTHS * abs(width)
        return Variable("displacement since reversal", length, x, reach=reach)
    if name == "phase":
        return _phase(finding, motion, length)
    if name == "coupled_velocity":
        return _coupled(finding, motions, motion, length)
    if name == "time":
        return Variable("time", "s", evidence.t)
    if name == "measured":
        return Variable(f"commanded {torque}", load, evidence.tau_measured[:, row])
    if name == "modelled":
        return Variable(f"modelled {torque}", load, evidence.tau_before[:, row])
    transmitted = _transmitted(evidence, row)
    if name == "transmitted":
        return Variable(f"{torque} through the transmission", load, transmitted, by_direction=True)
    rate = _slope(evidence.t, transmitted)
    if name == "torque_rate":
        return Variable(f"rate of change of the {torque}", f"{load}/s", rate, reach=_almost_largest(rate))
    bend = _slope(evidence.t, rate)
    return Variable(f"second derivative of the {torque}", f"{load}/s²", bend, reach=_almost_largest(bend))


def _phase(finding: Finding, motion: JointMotion, length: str) -> Variable:
    """Position modulo the period of the strongest order if the motion covers several periods, otherwise position."""
    orders, sizes = _all_numbers(finding, "order") or [1.0], _all_numbers(finding, "amplitude")
    order = orders[int(np.argmax(np.abs(sizes)))] if len(sizes) == len(orders) else orders[0]
    period = 2 * np.pi / abs(order) if order else np.inf
    if length == "m" or not np.ptp(motion.q[np.isfinite(motion.q)], axis=0) > _LEAST_PERIODS * period:
        return Variable("position", length, motion.q, by_direction=True)
    folded = np.mod(motion.q, period)
    name = "angle in one turn" if order == 1 else f"angle in one of {order:g} periods of a turn"
    return Variable(name, "rad", folded, by_direction=True)


def _coupled(finding: Finding, motions: dict[str, JointMotion], motion: JointMotion, length: str) -> Variable:
    """Velocity of a coupling: first joint's velocity plus ratio times second joint's velocity."""
    pair = [name for name in (finding.joint or "").split("+") if name in motions]
    ratio = _first_number(finding, "ratio")
    if len(pair) != 2 or ratio is None:
        return Variable("velocity", f"{length}/s", motion.v)
    first, second = (motions[name].v for name in pair)
    return Variable(f"velocity of {pair[0]} {ratio:+.3g} × that of {pair[1]}", f"{length}/s", first + ratio * second)


def _transmitted(evidence: Evidence, row: int) -> Float[Array, " N"]:
    """Torque through the transmission of a joint; the modelled drive torque if the diagnosis lacks the former."""
    given = evidence.tau_transmitted
    return evidence.tau_before[:, row] if given is None else given[:, row]


def _slope(t: Float[Array, " N"], x: Float[Array, " N"]) -> Float[Array, " N"]:
    """Time derivative; NaN at the ends of recordings."""
    if len(t) < 3:
        return np.full(len(t), np.nan)
    out = np.gradient(x, t)
    starts = gap_starts(t)
    out[[0, -1, *starts, *(starts - 1)]] = np.nan
    return out


def _almost_largest(x: Float[Array, " N"]) -> float | None:
    """Absolute value that only 0.5 % of the samples exceed; None without samples."""
    finite = np.abs(x[np.isfinite(x)])
    return float(np.percentile(finite, _MIDDLE[1])) if len(finite) else None


def _first_number(finding: Finding, name: str) -> float | None:
    """First number of a finding's parameter; None without the parameter."""
    values = _all_numbers(finding, name)
    return values[0] if values else None


def _all_numbers(finding: Finding, name: str) -> list[float]:
    """Numbers of a finding's parameter; empty without the parameter."""
    value = finding.parameters.get(name)
    return [] if value is None else value.numbers


@dataclass(frozen=True)
class JointMotion:
    """Samples of position [rad or m], velocity and acceleration of one joint."""

    q: Float[Array, " N"]
    v: Float[Array, " N"]
    a: Float[Array, " N"]


def joint_motions(robot: Robot | None, diagnosis: Diagnosis) -> dict[str, JointMotion]:
    """Motion of each joint by name; with passive joints if the robot is given and a finding is on a passive joint."""
    evidence = diagnosis.evidence
    out = {
        gap.joint: JointMotion(evidence.q[:, k], evidence.v[:, k], evidence.a[:, k])
        for k, gap in enumerate(diagnosis.joints)
    }
    named = {name for finding in diagnosis.findings if finding.joint for name in finding.joint.split("+")}
    if robot is None or robot.chain is None or not named - set(out) or not len(evidence.t):
        return out
    tree = tree_motion(robot, Motion(evidence.t, evidence.q, evidence.v, evidence.a))
    for name, row in zip(robot.passive_names, robot.chain.passive, strict=True):
        out[name] = JointMotion(tree.q[:, row], tree.v[:, row], tree.a[:, row])
    return out
