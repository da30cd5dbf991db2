"""Detection limits: the smallest size of each effect that this recording shows with 95 % power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.terms import Term, untestable_effects
from identification.diagnosis.fit.gap import measured_torque, residual_sums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.moved_by_noise import noise_may_make
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
    """Detection limit of every effect and joint that is not a finding, and effects that cannot be tested at all.

    The held-out gain of an effect of size ``s`` is about ``(s sqrt(I) + z)^2`` less the price of its parameters, with
    ``I`` the information on its size where nuisances and findings are fitted, too. The limit is the size at which it
    passes the gates of a claim. What noise may make is shown above the noise, too. An effect whose limit is larger than
    the whole measured torque, or than on any sound device, is not testable.

    Args:
        operation: Operation of all recordings.
        search: Rivals, with whitened fits, and the thresholds of a claim.
        plain: The same with plain fits in the judged band.
        chosen: The findings.
        allowed: Residual of each joint up to which there is no gap, ``(nv,)``.
    """
    problem, robot = search.problem, search.problem.session.robot
    bounds: dict[tuple[str, str | None], Bound] = {}
    hopeless: dict[tuple[str, str | None], NotTestable] = {}
    found = {term.effect_joint for term in chosen}
    kept = sorted({column for term in chosen for column in term.columns})
    base = np.array([*problem.fitted_nuisances, *kept], dtype=int)
    inverse = _inverse(problem, base)
    held_out = held_out_share(problem.blocks)
    tested = set(search.terms)
    measured = residual_sums(plain.problem, measured_torque(plain.problem)).rms()
    candidates = {
        term: term.effect
        for term in problem.columns.terms
        if isinstance(term.effect, Effect)
        and term.effect_joint not in found
        # A number that several joints share has no limit of its own: those of the single joints hold.
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
        joint = term.joint if term.joint is not None else "the robot"
        if effect.seen_by == "neither":
            why = f"what is logged of {joint} does not stay beyond any limit that its motion would allow"
            hopeless[term.effect_joint] = NotTestable(*term.effect_joint, why)
            continue
        if term not in tested:
            why = f"{joint} moves too little: the effect leaves no trace in this recording"
            hopeless[term.effect_joint] = NotTestable(*term.effect_joint, why)
            continue
        probe = probes[term]
        name, direction = probe.parameter, probe.direction
        index = np.concatenate([base, term.columns])
        by_block = problem.grams.core_a.squares(index, np.tile(probe.theta[index], (len(problem.blocks), 1)))
        least = least_gain(search, frozenset([term]), chosen, energies[term])
        deviations = _detectable_deviations(search, term, by_block, least)
        size = deviations / np.sqrt(held_out * probe.information) if probe.information > 0 else np.inf
        if noise_may_make(term):
            share = _torque_share(plain.problem, allowed, term, direction)
            size = max(size, 1.0 / share if share > 0.0 else 0.0)
        by_shape = effect.seen_by == "shape"
        # A real play may leave less torque than its law, down to the share at which it still counts as a play.
        if not size < (term.lower[0] if by_shape else _largest_size(problem, energy, term, direction)):
            why = f"it would have to exceed the torque measured on {joint} to be seen in this recording"
            if by_shape:
                why = f"even the largest that was tried leaves less on {joint} than this recording shows"
            hopeless.setdefault(term.effect_joint, NotTestable(*term.effect_joint, why))
            continue
        unit = effect.probe_unit(robot, term.joint, name)
        why = None if by_shape else _beyond_sound_devices(robot, effect, term.joint, name, float(size))
        if why is not None:
            hopeless.setdefault(term.effect_joint, NotTestable(*term.effect_joint, why))
            continue
        # Where the shape is the size, the smallest detected one is the limit; of other shapes the least visible one.
        below, better = (term.shape[0], min) if by_shape else (float(size), max)
        if term.effect_joint in bounds:
            below = better(below, bounds[term.effect_joint].below)
        of_torque = None if by_shape else float(below) * _torque_share(plain.problem, measured, term, direction)
        bounds[term.effect_joint] = Bound(*term.effect_joint, name, float(below), unit, of_torque)
    left = [value for cause, value in hopeless.items() if cause not in bounds]
    tried = frozenset(term.effect_joint for term in problem.columns.terms)
    left += [NotTestable(*cause) for cause in untestable_effects(robot, operation, tried)]
    return tuple(bounds.values()), tuple(left)


def _beyond_sound_devices(robot: Robot, effect: Effect, joint: str | None, name: str, size: float) -> str | None:
    """Why an effect cannot be tested whose limit is above its plausible range; None if the limit is inside."""
    limits = [
        abs(limit)
        for one in effect.parameters(robot, joint)
        if one.name == name and one.plausible is not None
        for limit in one.plausible
    ]
    if limits and size > max(limits):
        unit = "" if effect.probe_unit(robot, joint, name) == "1" else f" {effect.probe_unit(robot, joint, name)}"
        return f"the {name} of a sound device, at most {max(limits):.3g}{unit}, is too small to be seen in this motion"
    return None


def _torque_share(problem: Problem, torques: Float[Array, " nv"], term: Term, direction: Float[Array, " k"]) -> float:
    """Torque of an effect of size one over another one of each joint, on the joint where that is most."""
    columns, out = problem.white, 0.0
    for j in _rows(problem, term):
        row = columns.rows[j]
        own = [k for k, column in enumerate(row) if column in term.column_set]
        if torques[j] == 0.0:
            continue
        parts = direction[[term.columns.index(row[k]) for k in own]]
        torque = [(x[j][:, own] @ parts)[u[:, j]] for x, u in zip(columns.values, columns.usable, strict=True)]
        out = max(out, rms(torque) / float(torques[j]))
    return out


@dataclass(frozen=True)
class _Probe:
    """An effect of size one, with the nuisances and findings fitted to its torque.

    Attributes:
        parameter: The parameter that is its size.
        direction: Coefficients of its columns, ``(k,)``.
        information: On its size, when nuisances and findings are fitted beside it.
        theta: Coefficients of all columns, ``(K,)``.
    """

    parameter: str
    direction: Float[Array, " k"]
    information: float
    theta: Float[Array, " K"]


def _probe(
    problem: Problem, operation: Operation, term: Term, effect: Effect, base: Array, inverse: Float[Array, "n n"]
) -> _Probe:
    name, direction = effect.probe(problem.session.robot, operation, term.joint)
    # Several orders of a cogging torque: one unit of the first.
    direction = np.concatenate([direction, np.zeros(len(term.columns) - len(direction))])
    information, beside = _information(problem, term, direction, base, inverse)
    theta = np.zeros(len(problem.precision))
    theta[base], theta[list(term.columns)] = beside, direction
    return _Probe(name, direction, information, theta)


def _energies(problem: Problem, theta: Float[Array, "t K"]) -> Float[Array, "t nv"]:
    """Energy on each row of several sums of columns, over the noise there."""
    out = np.zeros((len(theta), len(problem.grams.rows)))
    for j, row in enumerate(problem.grams.rows if len(theta) else ()):
        own = theta[:, row.index]
        out[:, j] = np.einsum("tk,tk->t", own @ row.core_total[0], own)
    return out


def _rows(problem: Problem, term: Term) -> list[int]:
    """Joints whose torque any column of an effect touches."""
    return sorted(frozenset[int]().union(*(problem.touched[column] for column in term.columns)))


def _detectable_deviations(search: Search, term: Term, by_block: Float[Array, " B"], least: float) -> float:
    """Size in standard deviations at which an effect is claimed with 95 % power, for a least gain before its price."""
    from scipy.special import ndtri

    needed = least + max(price(search.sizes[term]) - above_chance.PARAMETER_PRICE, 0.0)
    return float(np.sqrt(max(needed + 2.0, _least_gain_over_blocks(by_block, needed))) + ndtri(0.95))


def _least_gain_over_blocks(by_block: Float[Array, " B"], needed: float) -> float:
    """Least gain at which an effect passes the gate of blocks, see `gates.over_blocks`.

    Args:
        by_block: Information on its size in each block.
        needed: Gain that a claim needs.
    """
    whole = float(by_block.sum())
    if whole <= 0:
        return needed
    # Computed with shares, as the square of a very small information is below the smallest number.
    shares = by_block / whole
    # The variance of a gain ``u`` over blocks is ``4 u`` by noise, plus a part with ``u^2`` by its uneven distribution.
    remaining = 1.0 - over_blocks.SIGNIFICANT_ERRORS**2 * len(shares) * float(shares.var())
    from_block_to_block = 4.0 * over_blocks.SIGNIFICANT_ERRORS**2 / remaining if remaining > 0 else np.inf
    share_without_best = float(np.sort(shares)[: -over_blocks.BEST_BLOCKS].sum())
    without_the_best = needed / share_without_best if share_without_best > 0 else np.inf
    return min(from_block_to_block, without_the_best, over_blocks.LARGE_GAIN * needed)


def _inverse(problem: Problem, base: Array) -> Float[Array, "n n"]:
    return solve(problem.total_a[np.ix_(base, base)] + np.diag(problem.precision[base]), np.eye(len(base)))


def _information(
    problem: Problem, term: Term, direction: Float[Array, " k"], base: Array, inverse: Float[Array, "n n"]
) -> tuple[float, Float[Array, " n"]]:
    """Information on a term's size where nuisances and findings are fitted beside it, and their coefficients then."""
    a = problem.total_a
    own = list(term.columns)
    cross = direction @ a[own][:, base]
    beside = -inverse @ cross
    return float(direction @ a[own][:, own] @ direction + cross @ beside), beside


def _measured_energy(problem: Problem) -> Float[Array, " nv"]:
    """Energy of the measured torque of each row, over the noise there."""
    columns, out = problem.white, np.zeros(len(problem.white.rows))
    for torque, residual, use in zip(columns.model_torque, columns.residual, columns.usable, strict=True):
        out += (np.where(use, torque + residual, 0.0) ** 2).sum(axis=0) * problem.weights.per_sample
    return out


def _largest_size(problem: Problem, measured: Float[Array, " nv"], term: Term, direction: Float[Array, " k"]) -> float:
    """Size at which the effect's torque would have the energy of all measured torque on the rows that it touches."""
    own = list(term.columns)
    energy = float(direction @ problem.total_a[own][:, own] @ direction)
    return float(np.sqrt(measured[_rows(problem, term)].sum() / energy)) if energy > 0 else 0.0
