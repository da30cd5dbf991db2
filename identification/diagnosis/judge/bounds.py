"""Detection limits: the smallest size at which each effect would be found in this recording with 95 % probability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.terms import Term, untestable_effects
from identification.diagnosis.fit.gap import measured_torque, residual_sums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.strong_motion import noise_may_imitate
from identification.diagnosis.noise.noise_floor import rms
from identification.diagnosis.result import Bound, NotTestable
from identification.diagnosis.search.claims import least_gain
from identification.diagnosis.search.containment import contains
from identification.diagnosis.search.search import Search, price
from identification.engine.numerics.bounded import solve
from identification.engine.products.blocks import held_out_share
from identification.gates import above_chance, over_blocks
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.robot import Robot


def detection_limits(
    operation: Operation, search: Search, plain: Search, chosen: frozenset[Term], allowed: Float[Array, " nv"]
) -> tuple[tuple[Bound, ...], tuple[NotTestable, ...]]:
    """Detection limit of each effect on each joint, except for findings, and the effects that cannot be tested.

    The held-out gain of an effect of size ``s`` is about ``(s sqrt(I) + z)^2`` minus the price of its parameters.
    ``I`` is the Fisher information on ``s`` if nuisances and findings are fitted too, and ``z`` a standard normal
    variable. The limit is the size at which this gain passes the gates of a claim. The torque of an effect that noise
    may imitate also has to exceed the noise. An effect is not testable if its limit exceeds the whole measured torque,
    or the largest size on a sound device.

    Args:
        operation: Operation of all recordings.
        search: Rivals, with whitened fits, and the thresholds of a claim.
        plain: The same with plain fits in the judged band.
        chosen: The findings.
        allowed: Largest residual of each joint that may be noise, root mean square, ``(nv,)``.

    Returns:
        The limits, and the effects that cannot be tested, with reasons.
    """
    problem, robot = search.problem, search.problem.session.robot
    bounds: dict[tuple[str, str | None], Bound] = {}
    untestable: dict[tuple[str, str | None], NotTestable] = {}
    found = {term.effect_joint for term in chosen}
    columns_of_findings = sorted({column for term in chosen for column in term.columns})
    base = np.array([*problem.fitted_nuisances, *columns_of_findings], dtype=int)
    inverse = _inverse(problem, base)
    tested, held_out = set(search.terms), held_out_share(problem.blocks)
    measured = residual_sums(plain.problem, measured_torque(plain.problem)).rms()
    candidates = {
        term: term.effect
        for term in problem.columns.terms
        if isinstance(term.effect, Effect)
        and term.effect_joint not in found
        # An effect with one parameter for several joints gets no limit: the limits of the single joints apply.
        and term.joint in term.effect.places(robot)
        and not any(contains(other, term) for other in chosen)
    }
    probes = {
        term: _probe(problem, operation, term, effect, base, inverse)
        for term, effect in candidates.items()
        if term in tested and effect.seen_by != "neither"
    }
    energies = dict(zip(probes, _energies(problem, np.array([probe.theta for probe in probes.values()])), strict=True))
    energy = _measured_energy(problem)
    for term, effect in candidates.items():
        cause, joint = term.effect_joint, term.joint if term.joint is not None else "the robot"
        if term not in probes:
            why = f"{joint} moves too little: the effect leaves no trace in this recording"
            if effect.seen_by == "neither":
                why = f"what is logged of {joint} does not stay beyond any limit that its motion would allow"
            untestable[cause] = NotTestable(*cause, why)
            continue
        probe = probes[term]
        name, direction, by_shape = probe.parameter, probe.direction, effect.seen_by == "shape"
        index = np.concatenate([base, term.columns])
        by_block = problem.grams.core_a.squares(index, np.tile(probe.theta[index], (len(problem.blocks), 1)))
        least = least_gain(search, frozenset([term]), chosen, energies[term])
        deviations = _detectable_deviations(search, term, by_block, least)
        size = deviations / np.sqrt(held_out * probe.information) if probe.information > 0 else np.inf
        if noise_may_imitate(term):
            share = _torque_share(plain.problem, allowed, term, direction)
            size = max(size, 1.0 / share if share > 0.0 else 0.0)
        why = None
        if by_shape:
            # The size of a play is the shape of its law, and ``size`` is the least visible coefficient. A real play may
            # make less torque than its law, so even the lower bound of the coefficient has to be visible.
            if not size < term.lower[0]:
                why = f"even the largest that was tried leaves less on {joint} than this recording shows"
        elif size < _largest_size(problem, energy, term, direction):
            why = _beyond_sound_devices(robot, effect, term.joint, name, float(size))
        else:
            why = f"it would have to exceed the torque measured on {joint} to be seen in this recording"
        if why is not None:
            untestable.setdefault(cause, NotTestable(*cause, why))
            continue
        # Each shape of an effect has a limit. If the shape is the size, the smallest one counts. Otherwise the largest
        # limit counts, because it holds for every shape.
        below, smaller_or_larger = (term.shape[0], min) if by_shape else (float(size), max)
        if cause in bounds:
            below = smaller_or_larger(below, bounds[cause].below)
        of_torque = None if by_shape else float(below) * _torque_share(plain.problem, measured, term, direction)
        bounds[cause] = Bound(*cause, name, float(below), effect.probe_unit(robot, term.joint, name), of_torque)
    tried = frozenset(term.effect_joint for term in problem.columns.terms)
    without_columns = (NotTestable(*cause) for cause in untestable_effects(robot, operation, tried))
    return tuple(bounds.values()), (
        *(reason for cause, reason in untestable.items() if cause not in bounds),
        *without_columns,
    )


def _beyond_sound_devices(robot: Robot, effect: Effect, joint: str | None, name: str, size: float) -> str | None:
    """Reason why an effect cannot be tested if ``size`` exceeds its plausible range; None if it does not."""
    limits = [
        abs(limit)
        for one in effect.parameters(robot, joint)
        if one.name == name and one.plausible is not None
        for limit in one.plausible
    ]
    most, unit = max(limits, default=np.inf), effect.probe_unit(robot, joint, name)
    if not size > most:
        return None
    stated = f"{most:.3g}" if unit == "1" else f"{most:.3g} {unit}"
    return f"the {name} of a sound device, at most {stated}, is too small to be seen in this motion"


def _torque_share(problem: Problem, torques: Float[Array, " nv"], term: Term, direction: Float[Array, " k"]) -> float:
    """Torque of an effect of size one divided by a given torque, on the joint with the largest ratio.

    Args:
        problem: Columns in the judged band.
        torques: Given torque of each joint, root mean square, ``(nv,)``; joints with zero are left out.
        term: The effect.
        direction: Coefficients of its columns at size one, ``(k,)``.
    """
    columns, ratios = problem.white, [0.0]
    for j in _touched_rows(problem, term):
        if torques[j] == 0.0:
            continue
        indices = columns.rows[j]
        own = [k for k, column in enumerate(indices) if column in term.column_set]
        coefficients = direction[[term.columns.index(indices[k]) for k in own]]
        torque = [
            (values[j][:, own] @ coefficients)[usable[:, j]]
            for values, usable in zip(columns.values, columns.usable, strict=True)
        ]
        ratios.append(rms(torque) / float(torques[j]))
    return max(ratios)


@dataclass(frozen=True)
class _Probe:
    """An effect of size one, and the part of its torque that nuisances and findings cannot explain.

    Attributes:
        parameter: Name of the parameter that is the size of the effect.
        direction: Coefficients of the columns of the effect, ``(k,)``.
        information: Fisher information on the size if nuisances and findings are fitted too.
        theta: Coefficients of all columns, ``(K,)``: ``direction`` for the effect, and for nuisances and findings those
            that compensate its torque best.
    """

    parameter: str
    direction: Float[Array, " k"]
    information: float
    theta: Float[Array, " K"]


def _probe(
    problem: Problem, operation: Operation, term: Term, effect: Effect, base: Array, inverse: Float[Array, "n n"]
) -> _Probe:
    """The probe of an effect; ``base`` and ``inverse`` are those of `_information`."""
    name, direction = effect.probe(problem.session.robot, operation, term.joint)
    # Of several orders of a cogging torque, the first has size one and the others zero.
    direction = np.concatenate([direction, np.zeros(len(term.columns) - len(direction))])
    information, others = _information(problem, term, direction, base, inverse)
    theta = np.zeros(len(problem.precision))
    theta[base], theta[list(term.columns)] = others, direction
    return _Probe(name, direction, information, theta)


def _energies(problem: Problem, theta: Float[Array, "t K"]) -> Float[Array, "t nv"]:
    """Sum of squares, in units of the noise, of the torque of each row of coefficients on each joint, ``(t, nv)``."""
    out = np.zeros((len(theta), len(problem.grams.rows)))
    for j, row in enumerate(problem.grams.rows if len(theta) else ()):
        own = theta[:, row.index]
        out[:, j] = np.einsum("tk,tk->t", own @ row.core_total[0], own)
    return out


def _touched_rows(problem: Problem, term: Term) -> list[int]:
    """Indices of the joints on which an effect makes a torque."""
    return sorted(frozenset[int]().union(*(problem.rows_of_column[column] for column in term.columns)))


def _detectable_deviations(search: Search, term: Term, by_block: Float[Array, " B"], least: float) -> float:
    """Size, in standard deviations of its estimate, at which an effect is claimed with 95 % probability.

    Args:
        search: Thresholds and prices of a claim.
        term: The effect.
        by_block: Information on the size of the effect in each block, ``(B,)``.
        least: Gain that a claim needs, without the price of further parameters.
    """
    from scipy.special import ndtri

    needed = least + max(price(search.counts[term]) - above_chance.PARAMETER_PRICE, 0.0)
    return float(np.sqrt(max(needed + 2.0, _least_gain_over_blocks(by_block, needed))) + ndtri(0.95))


def _least_gain_over_blocks(by_block: Float[Array, " B"], needed: float) -> float:
    """Least gain at which an effect passes the gate `in_enough_blocks`, which has three alternative tests.

    Args:
        by_block: Information on the size of the effect in each block, ``(B,)``.
        needed: Gain that a claim needs.
    """
    whole = float(by_block.sum())
    if whole <= 0:
        return needed
    # Shares are used because the square of a very small information would be rounded to zero.
    shares = by_block / whole
    # The sum over blocks of a gain ``u`` has the variance ``4 u`` by noise. An uneven distribution of the gain over
    # blocks adds a part proportional to ``u^2``.
    remaining = 1.0 - over_blocks.SIGNIFICANT_ERRORS**2 * len(shares) * float(shares.var())
    significant = 4.0 * over_blocks.SIGNIFICANT_ERRORS**2 / remaining if remaining > 0 else np.inf
    share_without_best = float(np.sort(shares)[: -over_blocks.BEST_BLOCKS].sum())
    without_best = needed / share_without_best if share_without_best > 0 else np.inf
    return min(significant, without_best, over_blocks.LARGE_GAIN * needed)


def _inverse(problem: Problem, base: Array) -> Float[Array, "n n"]:
    """Covariance of the coefficients of the columns ``base`` in a fit of these columns alone, ``(n, n)``."""
    return solve(problem.total_a[np.ix_(base, base)] + np.diag(problem.precision[base]), np.eye(len(base)))


def _information(
    problem: Problem, term: Term, direction: Float[Array, " k"], base: Array, inverse: Float[Array, "n n"]
) -> tuple[float, Float[Array, " n"]]:
    """Fisher information on the size of an effect, and the coefficients of other columns that compensate it best.

    Args:
        problem: Products of columns.
        term: The effect.
        direction: Coefficients of the columns of the effect at size one.
        base: Columns of nuisances and findings, which are fitted too.
        inverse: Covariance of their coefficients.

    Returns:
        The information, and the coefficients of the columns ``base`` at size one.
    """
    a = problem.total_a
    own = list(term.columns)
    cross = direction @ a[own][:, base]
    others = -inverse @ cross
    return float(direction @ a[own][:, own] @ direction + cross @ others), others


def _measured_energy(problem: Problem) -> Float[Array, " nv"]:
    """Sum of squares of each joint's measured torque, in units of the noise; infinite on joints without a drive."""
    columns, out = problem.white, np.zeros(len(problem.white.rows))
    for torque, residual, use in zip(columns.model_torque, columns.residual, columns.usable, strict=True):
        out += (np.where(use, torque + residual, 0.0) ** 2).sum(axis=0) * problem.weights.per_sample
    return np.where([actuator.actuated for actuator in problem.session.robot.actuators], out, np.inf)


def _largest_size(problem: Problem, measured: Float[Array, " nv"], term: Term, direction: Float[Array, " k"]) -> float:
    """Size at which an effect's torque has as large a sum of squares as the measured torque of the same joints."""
    own = list(term.columns)
    energy = float(direction @ problem.total_a[own][:, own] @ direction)
    return float(np.sqrt(measured[_touched_rows(problem, term)].sum() / energy)) if energy > 0 else 0.0
