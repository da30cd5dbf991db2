"""Draws figures of friction and stiffness tests: friction over speed, and hysteresis loops of a held arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from identification.experiments.constant_speed_friction import FrictionTest
from identification.experiments.linear_fit import LinearFit
from identification.experiments.transmission import Loop
from phantom_dyn.array_types import Array, Float
from phantom_dyn.haptics.figures.canvas import COLORS, key, panels

_POINTS = 2000  # about the largest number of samples of a test that are drawn
_ABREAST = 3  # largest number of panels in a row


def friction_figure(tests: Sequence[FrictionTest]) -> Figure:
    """Draws measured friction torque and the fitted law over speed, one panel per joint.

    Args:
        tests: One or several tests.
    """
    joints = list(dict.fromkeys(test.joint for test in tests))
    out, (row,) = panels(1, len(joints), title="Friction at constant speeds", width=1.5 + 4.5 * len(joints), height=3.6)
    for joint, ax in zip(joints, row, strict=True):
        for k, test in enumerate(test for test in tests if test.joint == joint):
            few = slice(None, None, max(1, len(test.v) // _POINTS))
            color = COLORS[k % len(COLORS)]
            ax.plot(test.v[few], test.torque[few], ".", ms=2, alpha=0.3, color=color)
            for side in (-1.0, 1.0):
                speed = np.array([0.0, side * float(np.abs(test.v).max())])
                torque = test.fit.theta[0] * speed + side * test.fit.theta[1]
                ax.plot(speed, torque, lw=1.5, color=color, label=test.file if side > 0 else None)
        ax.set_title(joint, fontsize=9)
        ax.set_xlabel(f"speed [{'m/s' if tests[0].fit.units[1] == 'N' else 'rad/s'}]")
        ax.set_ylabel(f"friction torque [{tests[0].fit.units[1]}]")
        key(ax)
    return out


def stiffness_figure(joint: str, loops: Sequence[Loop], fit: LinearFit) -> Figure:
    """Draws motor torque over motor position against a held arm, and the fitted stiffness, one panel per recording.

    Args:
        joint: Name of the joint.
        loops: Recorded hysteresis loops.
        fit: Fitted stiffness, from `identification.experiments.transmission.fit_transmission`.
    """
    ends = np.array([min(loop.position.min() for loop in loops), max(loop.position.max() for loop in loops)])
    torques = np.array([min(loop.torque.min() for loop in loops), max(loop.torque.max() for loop in loops)])
    (stiffness, _), (offset, _) = fit.value("K"), fit.value("offset")
    linear = fit.units[0] == "N/m"
    title = f"{joint} against a held arm; dashed: {stiffness:.4g} {fit.units[0]}"
    columns = min(len(loops), _ABREAST)
    rows = -(-len(loops) // columns)
    out, grid = panels(rows, columns, title=title, width=1.0 + 3.4 * max(columns, 1.8), height=3.2)
    axes = [ax for row in grid for ax in row]
    for k, (ax, loop) in enumerate(zip(axes, loops, strict=False)):
        ax.plot(1e3 * loop.position, loop.torque, lw=0.8, color=COLORS[0])
        ax.plot(1e3 * ends, stiffness * ends + offset, "k--", lw=1.2)
        ax.set_xlim(*_widened(1e3 * ends))
        ax.set_ylim(*_widened(torques))
        ax.set_title(f"recording {k + 1}, {loop.t[-1] - loop.t[0]:.3g} s", fontsize=9)
        ax.set_xlabel(f"position of the motor [{'mm' if linear else 'mrad'}]")
        if k % columns == 0:
            ax.set_ylabel(f"torque of the motor [{'N' if linear else 'N m'}]")
    for ax in axes[len(loops) :]:
        ax.remove()
    return out


def _widened(ends: Float[Array, " 2"]) -> tuple[float, float]:
    """Limits of an axis a little beyond the data."""
    margin = 0.05 * float(ends[1] - ends[0])
    return float(ends[0]) - margin, float(ends[1]) + margin
