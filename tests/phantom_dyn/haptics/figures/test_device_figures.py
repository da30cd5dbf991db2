"""Figures of a device's electronics draw what they are given; oracles: the results' own arrays, closed forms."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from phantom_dyn.haptics import figures
from phantom_dyn.haptics.device.commutation import BrushMotor, steady_torque
from phantom_dyn.haptics.device.drives import Winding
from phantom_dyn.haptics.device.safety import Guard, ThermalMotor, run_guard
from phantom_dyn.haptics.sensing.sinusoidal_encoder import SinusoidalEncoder
from phantom_dyn.haptics.stability.force_link import NoiseFelt
from phantom_dyn.walking.stairs import Stairs, climb
from phantom_dyn.walking.walker import talos_bent


def line(figure: Figure, gid: str) -> tuple[np.ndarray, np.ndarray]:
    """Abscissas and ordinates of the one line of this name."""
    (found,) = [one for ax in figure.axes for one in ax.lines if one.get_gid() == gid]
    return np.asarray(found.get_xdata(), float), np.asarray(found.get_ydata(), float)


def test_link_figure_draws_limits_and_noise_over_the_loss_in_per_cent():
    felt = [NoiseFelt(0.1, 1e-3, 0.2), NoiseFelt(0.2, 2e-3, 0.3)]
    figure = figures.lossy_link_figure(np.array([0.0, 0.5]), {"rigid": [6.0, 5.0]}, {"gain 2": felt}, name="LHIfAM")
    np.testing.assert_array_equal(line(figure, "rigid"), ([0, 50], [6, 5]))
    np.testing.assert_array_equal(line(figure, "gain 2"), ([0, 50], [0.1, 0.2]))
    np.testing.assert_allclose(figure.axes[2].lines[0].get_ydata(), [1.0, 2.0])  # mm


def test_encoder_figure_draws_the_wave_of_an_offset_and_its_ripple():
    """Closed form: p o / 2 pi of position, o v of velocity."""
    figure = figures.sinusoidal_encoder_figure({"offset": SinusoidalEncoder(offset=(0.01, 0.0))}, speed=0.1)
    x, error = line(figure, "offset")
    assert x[-1] == pytest.approx(240.0)  # two lines, in um
    assert error.max() == pytest.approx(120 * 0.01 / (2 * math.pi), rel=1e-3)
    assert np.max(figure.axes[1].lines[0].get_ydata()) == pytest.approx(1.0, rel=0.02)


def test_brush_figure_draws_two_switching_periods_of_each_speed():
    motor = BrushMotor(Winding(2.0, 2e-4), 0.02, 11)
    figure = figures.commutation_figure(motor, voltage=4.0, speeds=(1.0, 50.0))
    angle, torque = line(figure, "50")
    assert angle[-1] == pytest.approx(2 * math.pi / 11)
    np.testing.assert_allclose(torque[:401], 1e3 * steady_torque(motor, speed=50.0, voltage=4.0).torque)


def test_safety_figure_draws_commands_force_and_rise():
    guard = Guard(ThermalMotor(2.0, 10.0, 200.0), 0.5, 0.5, 60.0, 50.0)
    asked = np.where(np.arange(200) < 150, 5.0, np.nan)
    trace = run_guard(guard, 1.0, asked)
    figure = figures.safety_figure(guard, 1.0, asked, trace)
    np.testing.assert_array_equal(line(figure, "asked")[1], asked)
    np.testing.assert_array_equal(line(figure, "force")[1], trace.force)
    np.testing.assert_array_equal(line(figure, "rise"), (np.arange(1.0, 201.0), trace.rise))


@pytest.mark.whole
def test_stairs_figure_draws_soles_centre_of_mass_and_margin():
    reference = climb(talos_bent(), Stairs(0.22, 0.05), 2, rate=50.0)
    figure = figures.stairs_figure(reference)
    np.testing.assert_array_equal(line(figure, "left sole"), reference.left.position[:, [0, 2]].T)
    np.testing.assert_array_equal(line(figure, "com"), reference.com.position[:, [0, 2]].T)
    np.testing.assert_array_equal(line(figure, "margin"), (reference.t, 1e3 * reference.margin))
    assert set(np.round(line(figure, "stairs")[1], 12)) >= {0.0, 0.05, 0.1}


def test_a_line_style_has_one_meaning_in_all_figures():
    """Solid: a result. Dashed: an ideal, an approximation or a plan. Dotted: a level or an instant pointed at."""
    for path in Path(figures.__file__).parent.glob("*.py"):
        assert path.name == "canvas.py" or not re.search(r"""ls=["'][^"']|linestyle""", path.read_text()), path
