"""Curves of one joint about a moment of a replay: which samples are drawn, and the line that marks the moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.reporting.chart import AFTER, BEFORE
from identification.reporting.thinning import thinned
from identification.viewing.replay import CORRECTED, GIVEN, MEASURED, Replay

Array = np.ndarray

MOST_POINTS = 1500
"""Samples of a curve that are sent at once: more than a chart has points."""
_COLOURS = {MEASURED: "#444444", GIVEN: BEFORE, CORRECTED: AFTER}
_MARGIN = 0.06
"""Of the range of values: what stays free above and below."""


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves over the whole recording.

    Attributes:
        title: What is drawn, with its unit.
        names: Of the curves.
        colours: As ``#rrggbb``, of the curves.
        t: Times [s], ``(m,)``.
        values: One column a curve, ``(m, k)``; NaN where there is nothing to draw.
    """

    title: str
    names: tuple[str, ...]
    colours: tuple[str, ...]
    t: Float[Array, " m"]
    values: Float[Array, "m k"]

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest value of the axis, the same for the whole recording."""
        finite = self.values[np.isfinite(self.values)]
        if not finite.size:
            return -1.0, 1.0
        low, high = float(finite.min()), float(finite.max())
        free = _MARGIN * (high - low) or max(abs(high), 1e-9)
        return low - free, high + free

    def about(self, moment: float, seconds: float) -> Float[Array, "n columns"]:
        """Time, curves and a vertical line at a moment, as columns that a chart draws.

        Args:
            moment: Time [s] in the middle.
            seconds: Length of what is drawn; infinite for the whole recording.
        """
        rows = np.flatnonzero(np.abs(self.t - moment) <= seconds / 2)
        if len(rows) > MOST_POINTS:
            kept = [thinned(self.values[rows, k], MOST_POINTS // len(self.names)) for k in range(len(self.names))]
            rows = rows[np.unique(np.concatenate(kept))]
        t, values = self.t[rows], self.values[rows]
        here = np.array([np.interp(moment, self.t, column, np.nan, np.nan) for column in self.values.T])
        at = int(np.searchsorted(t, moment))
        drawn = np.insert(np.column_stack([t, values]), [at, at], np.concatenate([[moment], here]), axis=0)
        line = np.full(len(drawn), np.nan)
        line[at : at + 2] = self.limits
        return np.column_stack([drawn, line])


def charts_of(replay: Replay, joint: int) -> tuple[Chart, Chart, Chart]:
    """Torque, torque residual, and error of the simulated position of one joint.

    Args:
        replay: Holds the curves.
        joint: Index of the joint.
    """
    curves, names = replay.curves, tuple(copy.name for copy in replay.copies)
    robot, models = replay.robot, names[1:]
    name, unit = robot.joint_names[joint], robot.torque_units[joint]
    torque = "force" if unit == "N" else "torque"
    modelled = [one[:, joint] for one in curves.modelled]
    residuals = [curves.residual(k)[:, joint] for k in range(len(models))]
    measured = replay.copies[0].q[:, joint]
    errors = [copy.q[:, joint] - measured for copy in replay.copies[1:]]
    position = robot.position_units[joint]
    return (
        _chart(f"{name}: {torque} [{unit}]", names, curves.t, [curves.measured[:, joint], *modelled]),
        _chart(f"{name}: measured less modelled {torque} [{unit}]", models, curves.t, residuals),
        _chart(f"{name}: simulated less measured position [{position}]", models, replay.t, errors),
    )


def _chart(title: str, names: tuple[str, ...], t: Float[Array, " m"], columns: list[Array]) -> Chart:
    return Chart(title, names, tuple(_COLOURS[name] for name in names), t, np.column_stack(columns))
