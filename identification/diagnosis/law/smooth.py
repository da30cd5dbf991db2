"""Smooth functions of one or two inputs: the share of a residual that each predicts on held-out blocks, and by chance.

A function is a table with linear interpolation between its nodes (hat functions, for two inputs their products). It is
fitted by ridge regression together with tolerance parameters and findings. The share that it predicts is its gain; for
a linear response, gain also has its usual meaning, the ratio of amplitudes at a frequency. The gain by chance is the
largest gain of all inputs on residuals whose blocks are permuted, with random signs. Each block keeps its spectrum and
its slow drifts. A function of the time can fit such drifts by chance, and the gain by chance accounts for that.

The residual may also be a linear response to motion or torque with memory, whose gain and phase change with the
frequency. Such a response is tried like an input, under the name of a frequency. It is the sum of the input and of the
input after low passes and all-passes (Laguerre's basis), which represents any response that decays within seconds. As
this sum is linear in its coefficients, it is fitted and tested like a table over an input.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from identification.diagnosis.input_names import frequency_of, input_of, is_frequency
from identification.diagnosis.law.joint_residual import JointResidual, ResidualLog
from identification.diagnosis.law.responses import laguerre, laguerre_gains
from identification.diagnosis.residual_law import FrequencyResponse, InputCurve, InputGain, Pair
from identification.engine.chance import shuffled_pieces
from identification.engine.numerics.bounded import solve
from identification.engine.products.block_products import block_products
from identification.engine.resampling import block_counts, interval
from phantom_dyn.array_types import Array, Complex, Float
from phantom_dyn.random_streams import random_stream

_NODES = 7  # nodes of a table over one input
_RIDGE = 3e-3  # strength of the ridge, as a share of the samples per node
_DRAWS = 60  # permutations of the blocks
_CHANCE = 0.95  # quantile, over these permutations, of the largest gain
_PAIRS = 6  # largest number of pairs that are listed
_CURVE = 25  # number of points of a curve
# A response with memory is named only if it predicts more of the squared residual than the best function without
# memory, by at least this share.
_CLEARLY = 0.03
_UNITS = {"q": "", "v": "/s", "a": "/s²", "dx": ""}
_CORNERS = (0.05, 0.25)  # corner frequencies, as a share of the edge of the judged band
_ORDER = 5  # number of Laguerre series for each corner frequency


@dataclass(frozen=True)
class _Samples:
    """Samples of a residual with positive weight, each times the square root of its weight.

    Attributes:
        y: The residual, and its permutations by blocks, ``(n, 1 + D)``.
        nuisances: Columns whose coefficients are fitted again, ``(n, F)``.
        blocks: Block of each sample.
        root: Square root of each weight.
    """

    y: Float[Array, "n D"]
    nuisances: Float[Array, "n F"]
    blocks: Array
    root: Float[Array, " n"]


@dataclass(frozen=True)
class Gains:
    """Held-out gains of inputs and pairs.

    Attributes:
        listed: Those that the report lists, the largest first.
        frequency: Name of the input whose response with memory predicts the residual clearly better than every function
            without memory; None if there is none.
        after_response: Squared residual of each block after that response, ``(B,)``; infinite without one.
        judged: Blocks on which gains are compared, ``(b,)``.
    """

    listed: tuple[InputGain, ...]
    frequency: str | None
    after_response: Float[Array, " B"]
    judged: Array

    def clearly_less(self, other: Float[Array, " B"]) -> bool:
        """True if the response has clearly smaller squared residuals than another fit, given for each block."""
        return self.frequency is not None and _clearly(other - self.after_response, self.judged, other.sum())


def input_gains(residual: JointResidual) -> Gains:
    """Held-out gain of every input, of the best pairs and of the responses with memory to motion and torque."""
    used = residual.weight > 0
    samples = _samples(residual, used)
    tables = {name: _table(residual, name)[used] * samples.root[:, None] for name in residual.inputs}
    plain = _losses(samples, np.zeros((len(samples.y), 0)), residual)

    def decrease_by_table(names: tuple[str, ...]) -> Array:
        """Decrease of the squared residual of each block, and of its permutations, by a table over some inputs."""
        x = tables[names[0]]
        if len(names) > 1:
            x = (x[:, :, None] * tables[names[1]][:, None, :]).reshape(len(x), -1) / samples.root[:, None]
        return plain - _losses(samples, x, residual)

    def decrease_by_response(x: Array) -> Array:
        """The same decrease by a sum of given columns."""
        x = x[used] * samples.root[:, None]
        return plain - _losses(samples, x / np.maximum(np.sqrt(np.mean(x**2, axis=0)), 1e-12), residual)

    single = {(name,): decrease_by_table((name,)) for name in residual.inputs}
    pairs = {names: decrease_by_table(names) for names in combinations(residual.inputs, 2)}
    dynamic = {
        (frequency_of(name),): decrease_by_response(response_columns(residual, name))
        for name in residual.frequency_inputs
    }
    # Gain by chance: the largest gain of all functions on each permuted residual.
    every = [*single.values(), *pairs.values(), *dynamic.values()]
    total = plain.sum(axis=0)
    by_chance = np.max([decrease.sum(axis=0)[1:] / total[1:] for decrease in every], axis=0)
    chance = float(max(np.quantile(by_chance, _CHANCE), 0.0))
    best = sorted(pairs, key=lambda names: -pairs[names][:, 0].sum())[:_PAIRS]
    judged = residual.judged
    shown: dict[tuple[str, ...], Array] = {**single, **{names: pairs[names] for names in best}, **dynamic}
    gains = [
        InputGain(names, *_shares(decrease[:, 0], plain[:, 0], judged), chance) for names, decrease in shown.items()
    ]
    listed = sorted(gains, key=lambda one: -one.gain)
    # The best response with memory counts if it gains more than chance, and clearly more than all without memory.
    first = next((one for one in listed if one.inputs in dynamic), None)
    frequency, after_response = None, np.full(len(residual.folds), np.inf)
    if first is not None and first.gain > first.chance and first.interval[0] > 0.0:
        own = shown[first.inputs][:, 0]
        static = [*single.values(), *pairs.values(), decrease_by_response(linear_columns(residual))]
        best_static = max((decrease[:, 0] for decrease in static), key=lambda decrease: decrease[judged].sum())
        if _clearly(own - best_static, judged, plain[judged, 0].sum()):
            frequency, after_response = first.inputs[0], plain[:, 0] - own
    return Gains(tuple(listed), frequency, after_response, judged)


def _clearly(decrease: Float[Array, " B"], judged: Array, whole: float) -> bool:
    """True if a decrease is a noticeable share of the squared residual, and the interval of this share is above zero.

    Args:
        decrease: Decrease of the squared residual of each block.
        judged: Blocks that count.
        whole: Squared residual of which the decrease is a share.
    """
    share, ends = _shares(decrease, np.full(len(decrease), whole / len(judged)), judged)
    return share > _CLEARLY and ends[0] > 0.0


def _shares(decrease: Float[Array, " B"], whole: Float[Array, " B"], judged: Array) -> tuple[float, Pair]:
    """Decrease as a share of the squared residual over the judged blocks, with its interval by block bootstrap."""
    decrease, whole = decrease[judged], whole[judged]
    counts = block_counts(len(judged), random_stream("blocks of the gain of an input"))
    low, high = interval((counts @ decrease) / np.maximum(counts @ whole, 1e-300))
    return float(decrease.sum() / max(whole.sum(), 1e-300)), (float(low), float(high))


def _samples(residual: JointResidual, used: Array) -> _Samples:
    """Weighted samples of a residual, and its permutations by blocks around the fit of the nuisance columns."""
    root = np.sqrt(residual.weight[used])
    y, blocks = residual.y[used] * root, residual.blocks[used]
    nuisances = residual.nuisances[used] * root[:, None]
    rng = random_stream("order of blocks of a smooth rest")
    seen = (residual.folds >= 0)[blocks]
    prior = residual.prior
    theta = solve(nuisances[seen].T @ nuisances[seen] + prior.precision, nuisances[seen].T @ y[seen] + prior.right)
    remaining = y - nuisances @ theta
    pieces = [remaining[blocks == k] for k in np.unique(blocks)]
    mixed = [shuffled_pieces(pieces, rng) for _ in range(_DRAWS)]
    return _Samples(np.column_stack([y, *mixed]), nuisances, blocks, root)


def _losses(samples: _Samples, x: Float[Array, "n k"], residual: JointResidual) -> Float[Array, "B D"]:
    """Squared residual of each block by fits to the other folds.

    Args:
        samples: The residual and its permutations.
        x: Columns of the function, times the square root of each sample's weight.
        residual: Residual of the joint.
    """
    k, folds = x.shape[1], residual.folds
    x = np.column_stack([x, samples.nuisances])
    size = len(folds)
    gram, right = np.zeros((size, x.shape[1], x.shape[1])), np.zeros((size, x.shape[1], samples.y.shape[1]))
    total = np.zeros((size, samples.y.shape[1]))
    for b in range(size):
        here = samples.blocks == b
        xb, yb = x[here], samples.y[here]
        gram[b], right[b], total[b] = xb.T @ xb, xb.T @ yb, (yb**2).sum(axis=0)
    prior = np.zeros((x.shape[1], x.shape[1]))
    prior[k:, k:] = residual.prior.precision
    prior[np.arange(k), np.arange(k)] = _RIDGE * float(samples.root @ samples.root) / _NODES
    pull = np.zeros((x.shape[1], samples.y.shape[1]))
    # In the permuted residuals the fitted nuisances are already subtracted, so their prior has zero mean.
    pull[k:, 0] = residual.prior.right
    out = np.zeros_like(total)
    for fold in np.unique(folds):
        train = (folds >= 0) & (folds != fold)
        theta = np.linalg.solve(
            gram[train].sum(axis=0) + prior + 1e-12 * np.eye(len(prior)), right[train].sum(axis=0) + pull
        )
        for b in np.flatnonzero(folds == fold):
            out[b] = total[b] - 2 * (theta * right[b]).sum(axis=0) + (theta * (gram[b] @ theta)).sum(axis=0)
    return out


def table_nodes(residual: JointResidual, name: str) -> Float[Array, " m"]:
    """Nodes of a table over one input: evenly spaced, but denser near zero for speed and displacement."""
    every = np.concatenate([log.inputs[name] for log in residual.logs])
    low, high = np.percentile(every, [1, 99])
    kind = name.split(".")[0]
    if kind in ("v", "dx") and low < 0.0 < high:
        steps = np.array([0.01, 0.3, 1.0]) if kind == "v" else np.array([0.003, 0.05, 0.25, 1.0])
        return np.concatenate([low * steps[::-1], high * steps])
    return np.linspace(low, high, _NODES)


def hats(x: Float[Array, " N"], nodes: Float[Array, " m"]) -> Float[Array, "N m"]:
    """Weights of linear interpolation between nodes; beyond the first and last node, the function is constant."""
    at = np.clip(np.searchsorted(nodes, x) - 1, 0, len(nodes) - 2)
    share = np.clip((x - nodes[at]) / (nodes[at + 1] - nodes[at]), 0.0, 1.0)
    out = np.zeros((len(x), len(nodes)))
    rows = np.arange(len(x))
    out[rows, at] = 1.0 - share
    out[rows, at + 1] = share
    return out


def _table(residual: JointResidual, name: str) -> Float[Array, "n m"]:
    """Columns of the hat functions over one input, in the judged band."""
    nodes = table_nodes(residual, name)
    return np.concatenate([log.in_band(hats(log.inputs[name], nodes)) for log in residual.logs])


def input_curves(residual: JointResidual, inputs: tuple[str, ...]) -> tuple[InputCurve, ...]:
    """Torque on the joint over each given input, fitted together with the model, with bands from block bootstrap.

    Where the speed or the displacement since a reversal is among the inputs, each direction has its own curve.
    """
    own = {f"v.{residual.joint}", f"dx.{residual.joint}"}
    both_ways = bool(own & set(inputs)) and f"v.{residual.joint}" in residual.inputs
    out: list[InputCurve] = []
    for name in inputs:
        if not is_frequency(name):
            out += _curves_over(residual, name, by_direction=both_ways and name not in own)
    return tuple(out)


def frequency_responses(residual: JointResidual, inputs: tuple[str, ...]) -> tuple[FrequencyResponse, ...]:
    """Gain and phase over the frequency, for each frequency among the given inputs, fitted together with the model."""
    return tuple(_frequency_response(residual, input_of(name)) for name in inputs if is_frequency(name))


def _frequency_response(residual: JointResidual, name: str) -> FrequencyResponse:
    """Gain and phase of the response to one input, with bands from block bootstrap."""
    columns = response_columns(residual, name)
    size = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-12)
    theta = _coefficients(residual, np.column_stack([columns / size, residual.nuisances]), _NODES)
    low, high = residual.frequencies(name)
    hz = np.geomspace(max(low, 1e-3), max(high, 1.01e-3), _CURVE)
    # The torque on the joint is the negative of the torque that the drive has to give.
    responses = -(theta / size) @ complex_gains(residual, name, hz).T
    magnitudes = np.abs(responses)
    phase = np.degrees(np.unwrap(np.angle(responses[0])))
    # Phases are periodic: those of the bootstrap draws are taken relative to that of the fit.
    differences = np.degrees(np.angle(responses[1:] / np.where(magnitudes[0] > 0.0, responses[0], 1.0)))
    parts = (magnitudes[0], *interval(magnitudes[1:]), phase, *(phase + end for end in interval(differences)))
    per = _unit(residual, name)
    unit = "" if per == residual.unit else f"{residual.unit}/({per})" if "/" in per else f"{residual.unit}/{per}"
    return FrequencyResponse(frequency_of(name), unit, *(tuple(z.tolist()) for z in (hz, *parts)))


def _curves_over(residual: JointResidual, name: str, *, by_direction: bool) -> list[InputCurve]:
    """Torque on the joint over one input, as one curve or as one for each direction of motion."""
    nodes = table_nodes(residual, name)
    parts = []
    for log in residual.logs:
        table = hats(log.inputs[name], nodes)
        if by_direction:
            v = log.inputs[f"v.{residual.joint}"]
            table = np.column_stack([table * (v > 0)[:, None], table * (v <= 0)[:, None]])
        parts.append(np.column_stack([log.in_band(table), log.nuisances]))
    theta = _coefficients(residual, np.concatenate(parts), len(nodes))
    at = np.sort(np.concatenate([np.linspace(nodes[0], nodes[-1], _CURVE), nodes]))
    weights = hats(at, nodes)
    unit = _unit(residual, name)
    out = []
    for k, direction in enumerate(("forwards", "backwards") if by_direction else ("",)):
        # The torque on the joint is the negative of the torque that the drive has to give.
        lines = -theta[:, k * len(nodes) : (k + 1) * len(nodes)] @ weights.T
        low, high = interval(lines[1:])
        out.append(InputCurve(name, unit, direction, *(tuple(z.tolist()) for z in (at, lines[0], low, high))))
    return out


def _coefficients(residual: JointResidual, columns: Float[Array, "n C"], ridge_divisor: int) -> Float[Array, "D k"]:
    """Coefficients of columns, fitted together with the nuisances: on all blocks, then on each bootstrap draw.

    Args:
        residual: Residual of the joint.
        columns: Columns at the kept samples, the nuisances last.
        ridge_divisor: The ridge is `_RIDGE` times the weight of all samples over this: the number of nodes of a table.
    """
    size = columns.shape[1]
    count = size - residual.prior.count
    prior = np.zeros((size, size))
    prior[count:, count:] = residual.prior.precision
    prior[np.arange(count), np.arange(count)] = _RIDGE * float(residual.weight.sum()) / ridge_divisor
    pull = np.concatenate([np.zeros(count), residual.prior.right])
    products = block_products(columns, residual.y, residual.weight, residual.blocks, len(residual.folds))
    return products.of_draws(residual.block_weights("blocks of a curve"), prior, pull)[:, :count]


def _unit(residual: JointResidual, name: str) -> str:
    """Unit of an input."""
    kind = name.split(".")[0]
    if kind == "t":
        return "s"
    if kind == "temp":
        return "°C"
    return ("m" if residual.unit == "N" else "rad") + _UNITS[kind] if kind in _UNITS else residual.unit


def response_columns(residual: JointResidual, name: str) -> Float[Array, "n k"]:
    """Columns of the response to an input in the judged band: its present value, and Laguerre series of the input."""
    names, parts = _inputs_of_response(residual, name), []
    for log in residual.logs:
        filtered = [laguerre(log.inputs[name], log.dt, hz, _ORDER) for hz in _corners(log)]
        parts.append(log.in_band(np.column_stack([*(log.inputs[one] for one in names), *filtered])))
    return np.concatenate(parts)


def linear_columns(residual: JointResidual) -> Float[Array, "n k"]:
    """Columns without memory: a constant, position, velocity, acceleration and torques of the joint."""
    kinds = [f"{kind}.{residual.joint}" for kind in ("q", "v", "a", "tl", "tau")]
    names = [name for name in kinds if name in residual.inputs]
    return np.concatenate(
        [log.in_band(np.column_stack([np.ones(len(log.t)), *(log.inputs[n] for n in names)])) for log in residual.logs]
    )


def complex_gains(residual: JointResidual, name: str, hz: Float[Array, " F"]) -> Complex[Array, "F k"]:
    """Complex gain of each series of `response_columns` at given frequencies of the input."""
    log = residual.logs[0]
    turning = 2j * np.pi * hz[:, None]
    powers = {"q": -1, "v": 0, "a": 1}  # powers of ``j w`` that make each from the velocity
    now = [turning ** (powers.get(one.split(".")[0], 0)) for one in _inputs_of_response(residual, name)]
    return np.hstack([*now, *(laguerre_gains(hz, log.dt, corner, _ORDER) for corner in _corners(log))])


def _inputs_of_response(residual: JointResidual, name: str) -> list[str]:
    """Inputs without memory in the response to one input: for a speed, also position and acceleration of its joint."""
    kind, _, joint = name.partition(".")
    names = [f"{one}.{joint}" for one in ("q", "v", "a")] if kind == "v" else [name]
    return [one for one in names if one in residual.inputs]


def _corners(log: ResidualLog) -> list[float]:
    """Corner frequencies [Hz] of the Laguerre series."""
    return [share * log.cutoff_hz for share in _CORNERS]
