"""Makes the curves of one joint around a time of a replay, with a vertical line at this time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identification.reporting.charts.chart import AFTER, BEFORE
from identification.reporting.charts.thinning import thinned
from identification.viewing.replay import CORRECTED, GIVEN, MEASURED, Replay
from phantom_dyn.array_types import Array, Float, Int

MOST_POINTS = 1500
"""Largest number of samples of a curve that are sent at once; a chart has fewer pixels."""
MOST_PARTS = 6
"""Largest number of lines that together draw one curve with gaps."""
_COLOURS = {MEASURED: "#444444", GIVEN: BEFORE, CORRECTED: AFTER}
_MARGIN = 0.06
"""Free space above and below the curves, as a share of the range of values."""


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves of one quantity over the whole recording.

    Attributes:
        title: Name of the quantity, with its unit.
        names: Names of the curves.
        colours: ``#rrggbb`` of each curve.
        t: Times [s], ``(m,)``.
        values: One column per curve, ``(m, k)``; NaN for samples without a value.
    """

    title: str
    names: tuple[str, ...]
    colours: tuple[str, ...]
    t: Float[Array, " m"]
    values: Float[Array, "m k"]

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest value of the vertical axis, for the whole recording."""
        finite = self.values[np.isfinite(self.values)]
        if not finite.size:
            return -1.0, 1.0
        low, high = float(finite.min()), float(finite.max())
        free = _MARGIN * (high - low) or max(abs(high), 1e-9)
        return low - free, high + free

    @cached_property
    def runs(self) -> Int[Array, " m"]:
        """Index of the uninterrupted run of samples to which each sample belongs; -1 where a curve has no value.

        Curves without any value are ignored.
        """
        finite = np.isfinite(self.values)
        drawn = finite.any(axis=0)
        known = np.all(finite[:, drawn], axis=1) if drawn.any() else np.zeros(len(finite), dtype=bool)
        starts = np.diff(known.astype(int), prepend=0) > 0
        return np.where(known, np.cumsum(starts) - 1, -1)

    @property
    def parts(self) -> int:
        """Number of lines for each curve: one per run, because a single line would be connected across gaps."""
        return int(np.clip(self.runs.max(initial=0) + 1, 1, MOST_PARTS))

    def about(self, moment: float, seconds: float) -> Float[Array, "n columns"]:
        """Columns for a chart: time, the lines of each curve, and a vertical line at the given time.

        Args:
            moment: Time in the middle of the chart [s].
            seconds: Length of the drawn interval [s]; infinite for the whole recording.
        """
        rows = np.flatnonzero((np.abs(self.t - moment) <= seconds / 2) & (self.runs >= 0))
        if len(rows) > MOST_POINTS:
            kept = [thinned(self.values[rows, k], MOST_POINTS // len(self.names)) for k in range(len(self.names))]
            rows = rows[np.unique(np.concatenate(kept))]
        count, parts = len(self.names), self.parts
        out = np.full((len(rows) + 2, 2 + count * parts), np.nan)
        # The vertical line takes two rows between the samples: its lower and its upper end.
        at = int(np.searchsorted(self.t[rows], moment))
        sample_rows = np.arange(len(rows)) + 2 * (np.arange(len(rows)) >= at)
        out[sample_rows, 0], out[at : at + 2, 0] = self.t[rows], moment
        out[at : at + 2, -1] = self.limits
        # If there are more runs than lines, the last line contains several runs.
        part = np.minimum(np.unique(self.runs[rows], return_inverse=True)[1], parts - 1)
        for k in range(count):
            out[sample_rows, 1 + k * parts + part] = self.values[rows, k]
        return out


def charts_of(replay: Replay, joint: int) -> tuple[Chart, Chart, Chart]:
    """Charts of torque, torque residual, and error of the simulated position of one joint.

    Args:
        replay: The replay, with its curves.
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
