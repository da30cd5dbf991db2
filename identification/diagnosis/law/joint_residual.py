"""Residual after all findings on one joint, with the inputs on which it may depend.

A law is a formula that predicts this residual from inputs, such as positions, torques or the time. The judged band has
the low frequencies in which the residual is judged. The fit of the diagnosis lacks the law, so its changes within the
tolerances and its sizes of findings are biased. So every fit of a law also fits these nuisances again, by their columns
on the joint of the law. Their prior includes what the torques of the other joints say about them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from identification.data.log import Band, Log
from identification.data.signals import narrowed
from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.flexible import displacement_since_reversal
from identification.diagnosis.fit.gap import held_out_torque, residual_after, sample_weights
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.input_names import frequency_of, input_of, is_frequency
from identification.diagnosis.judge.findings.gate_state import ShownEffects
from identification.engine.numerics.bounded import solve
from identification.engine.products.block_products import NuisancePrior
from identification.engine.products.blocks import Block
from identification.engine.resampling import REPLICATES, block_counts
from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.rows import branch_rows
from phantom_dyn.model.robot import Robot
from phantom_dyn.random_streams import random_stream

_PER_PERIOD = 5.0  # samples per period of the judged band's edge: more are redundant
_MOST_SAMPLES = 8000  # largest number of samples of all recordings: more cost time and memory, and add little
_OTHERS = 5  # number of nearest other joints of the branch whose motion may be an input
_MOST_POWER = 0.98  # share of an input's power within the frequencies at which a response is stated
_SAME_TORQUE = 0.99  # if its correlation with the transmitted torque is higher, the drive torque is no separate input


@dataclass(frozen=True)
class ResidualLog:
    """One recording: the residual of one joint, and the inputs on which it may depend.

    Attributes:
        t: Time since its start at the full rate [s], ``(N,)``.
        inputs: Series by name at the full rate, ``(N,)`` each.
        band: Filter of the recording.
        cutoff_hz: Edge of the judged band.
        valid: False for samples in the band that depend on missing or excluded samples, ``(m,)``.
        kept: Slice of the samples in the band that are kept: every n-th, as more are redundant.
        residual: Measured minus modelled torque of these samples in the judged band, by fits to other blocks, ``(n,)``.
        weight: Weight of each of these samples, ``(n,)``.
        nuisances: Columns of the tolerance parameters and findings that are fitted again with a law, ``(n, F)``.
    """

    t: Float[Array, " N"]
    inputs: Mapping[str, Float[Array, " N"]]
    band: Band
    cutoff_hz: float
    valid: Bool[Array, " m"]
    kept: slice
    residual: Float[Array, " n"]
    weight: Float[Array, " n"]
    nuisances: Float[Array, "n F"]

    def in_band(self, x: Float[Array, "N ..."]) -> Float[Array, "n ..."]:
        """Kept samples in the judged band of a series at the full rate."""
        return narrowed(self.band(x), self.valid, self.band, self.cutoff_hz)[self.kept]

    @property
    def dt(self) -> float:
        """Time between two samples at the full rate [s]."""
        return float(self.t[1] - self.t[0])

    def unfiltered(self, x: Float[Array, "N ..."]) -> Float[Array, "n ..."]:
        """Kept samples of a series, unfiltered."""
        return x[self.band.samples(len(x))][self.kept]


@dataclass(frozen=True)
class JointResidual:
    """Residual of one joint in all recordings.

    Attributes:
        joint: Name of the joint.
        unit: Unit of its torque.
        others: Other joints whose motion is among the inputs.
        logs: The recordings.
        blocks: Block of each kept sample, -1 for samples that share noise with the block before, ``(n,)``.
        folds: Fold of each block, -1 for blocks that no fit may see, ``(B,)``.
        floor: Noise floor of the joint.
        prior: Prior on the coefficients of the nuisances: their changes from the fit of the diagnosis, with a precision
            in squares of the torque.
        lower, upper: Bounds of these coefficients, ``(F,)``.
    """

    joint: str
    unit: str
    others: tuple[str, ...]
    logs: tuple[ResidualLog, ...]
    blocks: Int[Array, " n"]
    folds: Int[Array, " B"]
    floor: float
    prior: NuisancePrior
    lower: Float[Array, " F"]
    upper: Float[Array, " F"]

    @property
    def y(self) -> Float[Array, " n"]:
        """Residual of all kept samples."""
        return np.concatenate([log.residual for log in self.logs])

    @property
    def weight(self) -> Float[Array, " n"]:
        """Weight of each kept sample, zero outside of the blocks."""
        return np.concatenate([log.weight for log in self.logs]) * (self.blocks >= 0)

    @property
    def nuisances(self) -> Float[Array, "n F"]:
        """Columns of the tolerance parameters and findings that are fitted again with a law, at all kept samples."""
        return np.concatenate([log.nuisances for log in self.logs])

    @property
    def judged(self) -> Int[Array, " b"]:
        """Blocks of held-out recordings if there are any, else all blocks: each is held out once."""
        outside = np.flatnonzero(self.folds < 0)
        return outside if len(outside) else np.arange(len(self.folds))

    def block_weights(self, stream: str) -> Float[Array, "R B"]:
        """Weight of each block in the fit to all blocks that fits may use, then in each bootstrap replicate.

        Args:
            stream: Name of the random stream.
        """
        seen = self.folds >= 0
        out = np.zeros((REPLICATES + 1, len(seen)))
        out[0, seen] = 1.0
        out[1:, seen] = block_counts(int(seen.sum()), random_stream(stream))
        return out

    def series(self, name: str) -> Float[Array, " n"]:
        """An input at all kept samples."""
        return np.concatenate([log.unfiltered(log.inputs[name]) for log in self.logs])

    def ranges(self, names: tuple[str, ...]) -> dict[str, tuple[float, float]]:
        """Smallest and largest value of some inputs in used samples; for a frequency, those at which it has power."""
        used = self.weight > 0
        out = {}
        for name in names:
            values = self.frequencies(input_of(name)) if is_frequency(name) else self.series(name)[used]
            out[name] = (float(values.min()), float(values.max()))
        return out

    def frequencies(self, name: str) -> Float[Array, " 2"]:
        """Lowest and highest frequency at which an input has power, in the longest recording [Hz]."""
        log = max(self.logs, key=lambda one: len(one.t))
        power = np.abs(np.fft.rfft(log.inputs[name] - log.inputs[name].mean())) ** 2
        hz = np.fft.rfftfreq(len(log.t), log.dt)
        power[hz > log.cutoff_hz] = 0.0
        share = np.cumsum(power) / max(power.sum(), 1e-300)
        ends = np.searchsorted(share, [0.5 - 0.5 * _MOST_POWER, 0.5 + 0.5 * _MOST_POWER])
        return hz[np.minimum(ends, len(hz) - 1)]

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of all inputs."""
        return tuple(self.logs[0].inputs)

    @property
    def frequency_inputs(self) -> tuple[str, ...]:
        """Inputs that may have a gain and phase over frequency to the residual; of the joint's motion the velocity."""
        own = [f"{kind}.{self.joint}" for kind in ("v", "tl", "tau")]
        return tuple(name for name in own if name in self.inputs)

    def named(self, names: frozenset[str] | set[str]) -> tuple[str, ...]:
        """Those names that are inputs or frequencies of inputs, in the order of the inputs."""
        both = (one for name in self.inputs for one in (name, frequency_of(name)))
        return tuple(name for name in both if name in names)


def joint_residual(shown: ShownEffects, joint: str, floors: Float[Array, " nv"]) -> JointResidual:
    """Residual of the named effects on a joint, on blocks held out of their fits.

    Args:
        shown: The effects that are shown.
        joint: Name of the joint.
        floors: Noise floor of each joint.
    """
    problem = shown.problem
    session, columns, robot = problem.session, problem.columns, problem.session.robot
    row = robot.joint_names.index(joint)
    torque = held_out_torque(problem, shown.named, shown.named_fit)
    residual = session.in_judged_band(residual_after(problem, torque))
    nuisances, prior, (lower, upper) = _nuisances(shown, row, floors, residual)
    near = sorted((k for k in branch_rows(robot, joint) if k != row), key=lambda k: abs(k - row))[:_OTHERS]
    logs, numbers = [], []
    thin = sum(len(log.samples) for log in session.logs) // _MOST_SAMPLES + 1
    for k, log in enumerate(session.logs):
        step = max(thin, int(log.band.output_rate_hz / (_PER_PERIOD * session.cutoff_hz)))
        kept = slice(0, None, step)
        logs.append(
            ResidualLog(
                log.motion.t - log.motion.t[0],
                inputs_of(robot, log, columns.operations[k], row, near),
                log.band,
                session.cutoff_hz,
                log.valid_in_band,
                kept,
                residual[k][kept, row],
                sample_weights(problem, k)[kept, row],
                nuisances[k][kept],
            )
        )
        numbers.append(_block_numbers(session.blocks, k, len(log.samples))[kept])
    return JointResidual(
        joint=joint,
        unit=robot.torque_units[row],
        others=tuple(robot.joint_names[k] for k in near),
        logs=_with_separate_inputs(logs, joint),
        blocks=np.concatenate(numbers),
        folds=session.folds,
        floor=float(floors[row]),
        prior=prior,
        lower=lower,
        upper=upper,
    )


def inputs_of(robot: Robot, log: Log, operation: Operation, row: int, near: list[int]) -> dict[str, Array]:
    """Series of every input at the full rate, by name.

    Torques of a joint without a drive are no inputs: there the modelled torque is the residual itself.

    Args:
        robot: The robot, for the names of its joints.
        log: One recording.
        operation: Its motion with the model's torque.
        row: Index of the joint with the residual.
        near: Indices of other joints whose motion may be an input.
    """
    motion, name = log.motion, robot.joint_names
    own, driven = name[row], [actuator.actuated for actuator in robot.actuators]
    out = {
        f"q.{own}": motion.q[:, row],
        f"v.{own}": motion.v[:, row],
        f"a.{own}": motion.a[:, row],
        f"dx.{own}": displacement_since_reversal(motion.q[:, row], motion.v[:, row]),
    }
    if driven[row]:
        out |= {f"tl.{own}": operation.transmitted[:, row], f"tau.{own}": operation.tau[:, row]}
    if log.temperature is not None and np.isfinite(log.temperature[:, row]).all():
        out[f"temp.{own}"] = log.temperature[:, row]
    out["t"] = motion.t - motion.t[0]
    for k in near:
        out |= {f"q.{name[k]}": motion.q[:, k], f"v.{name[k]}": motion.v[:, k]}
        out |= {f"tau.{name[k]}": operation.tau[:, k]} if driven[k] else {}
    return {key: np.asarray(series) for key, series in out.items()}


def _block_numbers(blocks: tuple[Block, ...], log: int, count: int) -> Int[Array, " n"]:
    """Block of each of the ``count`` samples of a log, -1 for samples in the core of no block."""
    out = np.full(count, -1)
    for number, block in enumerate(blocks):
        if block.log == log:
            out[block.core : block.stop] = number
    return out


def _with_separate_inputs(logs: list[ResidualLog], joint: str) -> tuple[ResidualLog, ...]:
    """Recordings without constant inputs, and without the drive torque if it is nearly the transmitted torque."""
    left_out = {name for name in logs[0].inputs if np.ptp(np.concatenate([log.inputs[name] for log in logs])) < 1e-9}
    if f"tl.{joint}" in logs[0].inputs.keys() - left_out:
        passed, drive = (np.concatenate([log.inputs[f"{kind}.{joint}"] for log in logs]) for kind in ("tl", "tau"))
        if abs(np.corrcoef(passed, drive)[0, 1]) > _SAME_TORQUE:
            left_out.add(f"tau.{joint}")
    return tuple(
        replace(log, inputs={name: series for name, series in log.inputs.items() if name not in left_out})
        for log in logs
    )


def _nuisances(
    shown: ShownEffects, row: int, floors: Float[Array, " nv"], residual: Series
) -> tuple[Series, NuisancePrior, tuple[Float[Array, " F"], Float[Array, " F"]]]:
    """Columns of the tolerance parameters and findings on one joint, and the prior on their coefficients.

    A coefficient is a change from the fit of the diagnosis. The prior includes the torques of the other joints, which
    the same parameters change.

    Args:
        shown: The effects that are shown.
        row: Index of the joint.
        floors: Noise floor of each joint.
        residual: Residual of the named effects in the judged band, for each log.

    Returns:
        The columns of each log in the judged band, ``(n, F)``; the prior on their coefficients, with a precision in
        squares of the joint's torque; the lower and the upper bound of each coefficient.
    """
    problem, found = shown.problem, shown.named_fit
    active = found.active
    precision = np.diag(problem.precision[active])
    right = -precision @ found.theta[active]
    for other, index in enumerate(problem.columns.rows):
        if other == row:
            continue
        place, at = _places(active, index)
        for k in range(len(residual)):
            weight = _seen_weights(problem, k)[:, other] / floors[other] ** 2
            x = problem.white.values[k][other][:, at]
            precision[np.ix_(place, place)] += (x * weight[:, None]).T @ x
            right[place] += x.T @ (weight * residual[k][:, other])
    place, at = _places(active, problem.columns.rows[row])
    elsewhere = [k for k in range(len(active)) if k not in set(place)]
    own, own_right = precision[np.ix_(place, place)], right[place]
    if elsewhere:
        # Schur complement: coefficients that act on other joints only are eliminated.
        cross = precision[np.ix_(place, elsewhere)]
        eliminated = solve(precision[np.ix_(elsewhere, elsewhere)], np.column_stack([cross.T, right[elsewhere]]))
        own, own_right = own - cross @ eliminated[:, :-1], own_right - cross @ eliminated[:, -1]
    scale, on_row = floors[row] ** 2, active[place]
    lower, upper = (bound[on_row] - found.theta[on_row] for bound in (problem.lower, problem.upper))
    return (
        tuple(values[row][:, at] for values in problem.white.values),
        NuisancePrior(scale * own, scale * own_right),
        (np.minimum(lower, 0.0), np.maximum(upper, 0.0)),
    )


def _places(active: Array, index: tuple[int, ...]) -> tuple[list[int], list[int]]:
    """Positions of a row's active columns among all active columns, and among the columns ``index`` of the row."""
    place_on_row = {column: k for k, column in enumerate(index)}
    place = [k for k, column in enumerate(active.tolist()) if column in place_on_row]
    return place, [place_on_row[int(active[k])] for k in place]


def _seen_weights(problem: Problem, log: int) -> Float[Array, "n nv"]:
    """Weight of each sample of a log, zero where no fit may see it."""
    weight = sample_weights(problem, log)
    for block, fold in zip(problem.blocks, problem.grams.fold, strict=True):
        if block.log == log and fold < 0:
            weight[block.start : block.stop] = 0.0
    return weight
