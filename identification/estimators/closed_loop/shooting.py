"""Closed loops simulated in stretches, each from a state of its own, and their slopes in parameters and states."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from identification.estimators.closed_loop.loop import Loop, simulated
from identification.estimators.closed_loop.plant import plant_of
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor

Array = np.ndarray

# Share of a signal by which a parameter or a state is moved for a slope: dry friction makes slopes of less rough.
_NUDGE = 1e-4
_TRUST = 1e-2  # share of a signal by which a recorded state may be off: many times the noise of any encoder


@dataclass(frozen=True)
class Stretch:
    """Samples ``start`` to ``stop`` of recording ``log``."""

    log: int
    start: int
    stop: int


def stretches_of(loops: tuple[Loop, ...], seconds: float) -> tuple[Stretch, ...]:
    """Stretches of about this length, a recording at least one.

    Args:
        loops: The closed loops.
        seconds: Wanted length [s].
    """
    out = []
    for k, loop in enumerate(loops):
        N = len(loop.log.motion.t)
        edges = np.linspace(0, N, max(1, round(N * loop.dt / seconds)) + 1).round().astype(int)
        out += [Stretch(k, int(a), int(b)) for a, b in pairwise(edges)]
    return tuple(out)


@dataclass(frozen=True)
class Shooting:
    """What is simulated and compared: torque, then position, of every joint in the band.

    Attributes:
        regressor: Gives robot, terms and recordings.
        base: The unknown parameters.
        loops: The closed loops.
        stretches: Each with an unknown state at its start.
    """

    regressor: Regressor
    base: BaseParameters
    loops: tuple[Loop, ...]
    stretches: tuple[Stretch, ...]

    def first_states(self) -> Float[Array, "s 2 nv"]:
        """Positions and velocities at the starts as they were recorded."""
        logs = [loop.log for loop in self.loops]
        return np.array([[logs[s.log].motion.q[s.start], logs[s.log].motion.v[s.start]] for s in self.stretches])

    def measured(self) -> Float[Array, "N c"]:
        """Recorded torques and positions in the band, shape ``(N, 2 nv)``."""
        logs = [loop.log for loop in self.loops]
        positions = [log.motion.q if log.raw_q is None else log.raw_q for log in logs]
        return self._banded([np.hstack([log.tau, q]) for log, q in zip(logs, positions, strict=True)])

    def outputs(self, theta: Float[Array, " r"], states: Float[Array, "s 2 nv"]) -> list[Float[Array, "_ c"]]:
        """Simulated torques and positions of each recording at the full rate.

        Args:
            theta: Base parameters.
            states: At the starts.

        Raises:
            EstimationError: If the robot cannot move with these parameters.
        """
        plant = plant_of(self.regressor, self.base, theta)
        out = [np.zeros((len(loop.log.motion.t), 2 * self.regressor.robot.nv)) for loop in self.loops]
        for s, (q0, v0) in zip(self.stretches, states, strict=True):
            motion, tau = simulated(self.loops[s.log], plant, s.start, s.stop, q0, v0)
            out[s.log][s.start : s.stop] = np.hstack([tau, motion.q])
        return out

    def in_band(self, outputs: list[Float[Array, "_ c"]]) -> Float[Array, "N c"]:
        """Full-rate outputs in the band, valid samples only."""
        return self._banded(outputs)

    def _banded(self, values: list[Array]) -> Array:
        return np.concatenate([Regressor.in_band(loop.log, one) for loop, one in zip(self.loops, values, strict=True)])

    def slopes(
        self, theta: Float[Array, " r"], states: Float[Array, "s 2 nv"], outputs: list[Float[Array, "_ c"]]
    ) -> Float[Array, "N c p"]:
        """Derivatives of the outputs in the band by all states, stretch by stretch, and then by the parameters.

        Args:
            theta: Base parameters.
            states: At the starts.
            outputs: Of these.

        Raises:
            EstimationError: If the robot cannot move next to these parameters.
        """
        columns = []
        for which in np.ndindex(2, self.regressor.robot.nv):
            nudge = self._state_nudge(which)
            moved = states.copy()
            moved[(slice(None), *which)] += nudge
            changes = [(a - b) / nudge for a, b in zip(self.outputs(theta, moved), outputs, strict=True)]
            # A start moves its own stretch and nothing else.
            for s in self.stretches:
                alone = [np.zeros_like(change) for change in changes]
                alone[s.log][s.start : s.stop] = changes[s.log][s.start : s.stop]
                columns.append(self._banded(alone))
        for k, nudge in enumerate(self._parameter_nudges()):
            moved = theta.copy()
            moved[k] += nudge
            columns.append(
                self._banded([(a - b) / nudge for a, b in zip(self.outputs(moved, states), outputs, strict=True)])
            )
        return np.stack(columns, axis=2)

    def state_trust(self) -> Float[Array, "2 nv s"]:
        """Standard deviations of the recorded states: a state that the band does not show stays as it was recorded."""
        sizes = [[self._state_size((i, j)) for j in range(self.regressor.robot.nv)] for i in range(2)]
        return _TRUST * np.repeat(np.array(sizes)[:, :, None], len(self.stretches), axis=2)

    def _state_nudge(self, which: tuple[int, ...]) -> float:
        return _NUDGE * self._state_size(which)

    def _state_size(self, which: tuple[int, ...]) -> float:
        name, joint = "qv"[which[0]], which[1]
        size = max(float(np.ptp(getattr(loop.log.motion, name)[:, joint])) for loop in self.loops)
        return size if size > 0 else 1.0

    def _parameter_nudges(self) -> Float[Array, " r"]:
        """What changes the torque by a ten-thousandth."""
        torque = np.linalg.norm(self.regressor.measured)
        return _NUDGE * torque / self.base.norms[list(self.base.independent)]
