"""The figure of a blocked arm. Oracle: the loops that are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from identification.experiments.transmission import blocked_arm_loop, fit_transmission, triangular_torque
from identification.reporting.experiment_figures import stiffness_figure


@pytest.mark.parametrize("count", [1, 4])
def test_no_recording_hides_another(count):
    """Four in two rows of three panels: two are left empty."""
    loops = []
    for frequency in (0.5, 0.7, 0.9, 1.1)[:count]:
        t = np.arange(0.0, 3 / frequency, 0.005)
        torque = triangular_torque(t, 1.5, frequency)
        loops.append(blocked_arm_loop(t, torque, stiffness=2000.0, damping=0.0, coulomb=0.12))
    figure = stiffness_figure("q2", loops, fit_transmission(loops, cutoff_hz=20.0))
    assert len(figure.axes) == count
    for ax, loop in zip(figure.axes, loops, strict=True):
        np.testing.assert_array_equal(ax.lines[0].get_ydata(), loop.torque)
        assert ax.get_xlim() == figure.axes[0].get_xlim()
