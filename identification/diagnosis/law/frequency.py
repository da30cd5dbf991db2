"""The frequency as an input: answers to motion or torque whose gain and phase change with it.

No function of the present value of an input makes such a rest. A sum of the input and its series behind low passes and
all-passes (Laguerre's) makes any that fades within seconds, whatever its order; it is linear in its coefficients, and
so is fitted and held out as a table over an input is.
"""

from __future__ import annotations

import numpy as np

from identification.diagnosis.law.responses import laguerre, laguerre_answer
from identification.diagnosis.law.rest import Rest, RestLog
from phantom_dyn.array_types import Array, Complex, Float

_CORNERS = (0.05, 0.25)  # of the edge of the judged band
_ORDER = 5  # series behind each corner


def answer_columns(rest: Rest, name: str) -> Float[Array, "n k"]:
    """Series of the answer to an input in the judged band; of the velocity, beside the whole motion without memory."""
    parts = []
    for log in rest.logs:
        dt = _step(log)
        behind = [laguerre(log.inputs[name], dt, hz, _ORDER) for hz in _corners(log)]
        parts.append(log.in_band(np.column_stack([*(log.inputs[one] for one in _present(rest, name)), *behind])))
    return np.concatenate(parts)


def linear_columns(rest: Rest) -> Float[Array, "n k"]:
    """Columns without memory: a constant, position, velocity, acceleration and torques of the joint."""
    kinds = [f"{kind}.{rest.joint}" for kind in ("q", "v", "a", "tl", "tau")]
    names = [name for name in kinds if name in rest.inputs]
    return np.concatenate(
        [log.in_band(np.column_stack([np.ones(len(log.t)), *(log.inputs[n] for n in names)])) for log in rest.logs]
    )


def complex_gains(rest: Rest, name: str, hz: Float[Array, " F"]) -> Complex[Array, "F k"]:
    """Complex gain of each series of `answer_columns` at given frequencies of the input."""
    log = rest.logs[0]
    turning = 2j * np.pi * hz[:, None]
    powers = {"q": -1, "v": 0, "a": 1}  # of the turning, of the velocity
    now = [turning ** (powers.get(one.split(".")[0], 0)) for one in _present(rest, name)]
    return np.hstack([*now, *(laguerre_answer(hz, _step(log), corner, _ORDER) for corner in _corners(log))])


def _present(rest: Rest, name: str) -> list[str]:
    kind, _, joint = name.partition(".")
    names = [f"{one}.{joint}" for one in ("q", "v", "a")] if kind == "v" else [name]
    return [one for one in names if one in rest.inputs]


def _corners(log: RestLog) -> list[float]:
    return [share * log.cutoff_hz for share in _CORNERS]


def _step(log: RestLog) -> float:
    return float(log.t[1] - log.t[0])
