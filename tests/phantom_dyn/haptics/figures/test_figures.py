"""Figures of haptic devices hold the computed values."""

import math
import re
from pathlib import Path

import control
import numpy as np
import pytest
from matplotlib.figure import Figure

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics import figures
from phantom_dyn.haptics.cheap.cheap_axis import CheapAxis, StickingFriction, VirtualMass
from phantom_dyn.haptics.cheap.cheap_hardware import rendered
from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA, RigidAxis
from phantom_dyn.haptics.device.drives import BrushMotor, Winding, steady_torque, switched_current, warming
from phantom_dyn.haptics.device.published import LHIFAM, LHIFAM_NEW_CABLE, PHANTOM_1_5_X
from phantom_dyn.haptics.device.safety import Guard, ThermalMotor, run_guard
from phantom_dyn.haptics.experiments.frequency_response import fit_two_mass
from phantom_dyn.haptics.experiments.noise_and_sweep import simulate_white_noise
from phantom_dyn.haptics.experiments.relay import limit_cycle, simulate_relay
from phantom_dyn.haptics.sensing.encoder import Encoder, SinusoidalEncoder
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings
from phantom_dyn.haptics.sensing.velocity_comparison import estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import STOCK, AveragedDifference
from phantom_dyn.haptics.stability.critical_stiffness import loop_bode, stability_map
from phantom_dyn.haptics.stability.force_feedforward import (
    Feedforward,
    critical_feedforward,
    transparency,
    worst_critical_feedforward,
)
from phantom_dyn.haptics.stability.force_link import NoiseFelt
from phantom_dyn.haptics.stability.virtual_wall import simulate_teleoperation
from phantom_dyn.walking.stairs import Stairs, climb
from phantom_dyn.walking.walker import talos_bent

T = 1e-3

RIGID = RigidAxis(5.4, 3.5)


def line(figure: Figure, gid: str) -> tuple[np.ndarray, np.ndarray]:
    """Abscissas and ordinates of the one line of this name."""
    (found,) = [one for ax in figure.axes for one in ax.lines if one.get_gid() == gid]
    return np.asarray(found.get_xdata(), float), np.asarray(found.get_ydata(), float)


def words(figure: Figure) -> str:
    """Title and legends."""
    legends = [text.get_text() for ax in figure.axes if ax.get_legend() for text in ax.get_legend().get_texts()]
    return "\n".join([figure.get_suptitle(), *legends])


def test_bode_diagram_draws_the_loop_it_is_given():
    bode = loop_bode(LHIFAM, period=T)
    figure = figures.loop_bode_figure(bode, name="LHIfAM")
    np.testing.assert_array_equal(line(figure, "gain"), (bode.frequency, bode.decibels))
    np.testing.assert_allclose(line(figure, "phase"), (bode.frequency, np.degrees(bode.phase)))


def test_bode_diagram_marks_the_gain_margin_of_every_crossing_at_its_frequency():
    bode = loop_bode(LHIFAM, period=T)
    figure = figures.loop_bode_figure(bode, name="LHIfAM")
    marked = [one.get_xydata() for one in figure.axes[0].lines if one.get_gid() == "gain margin"]
    wanted = [[[c.frequency, -c.decibels], [c.frequency, 0]] for c in bode.margin.crossings]
    np.testing.assert_allclose(marked, wanted)
    # Published masses: 78.89 dB at 38.52 rad/s.
    assert "stable up to 8803.6 N/m (78.89 dB)" in words(figure)
    assert "gain margin 78.89 dB at 38.52 rad/s" in words(figure)


def test_crossings_are_marked_where_the_phase_is_half_a_turn():
    bode = loop_bode(LHIFAM_NEW_CABLE, period=T, delay=4 * T)
    figure = figures.loop_bode_figure(bode, name="LHIfAM", stiffness=400.0)
    marks = [one.get_xydata()[0] for one in figure.axes[1].lines if one.get_gid() == "crossing"]
    assert marks
    for (frequency, turn), crossing in zip(marks, bode.margin.crossings, strict=True):
        at = np.interp(frequency, bode.frequency, np.degrees(bode.phase))
        assert frequency == crossing.frequency
        assert turn == pytest.approx(at, abs=2.0)


def test_a_stiffer_wall_lifts_the_loop_and_takes_from_the_margin():
    bode = loop_bode(LHIFAM, period=T)
    figure = figures.loop_bode_figure(bode, name="LHIfAM", stiffness=100.0)
    np.testing.assert_allclose(line(figure, "gain")[1], bode.decibels + 40.0)
    assert "gain margin 38.89 dB" in words(figure)


def test_phase_margin_is_that_of_python_control():
    bode = loop_bode(RIGID, period=T, delay=2 * T)
    ((frequency, margin),) = figures.phase_margins(bode, 500.0)
    s = RIGID.state_space
    sampled = control.c2d(control.ss(s.A, s.B[:, None], s.C[None], 0), T)
    loop = 500.0 * control.tf(sampled) * control.tf([1], [1, 0, 0], T)
    _, wanted, _, _, at, _ = control.stability_margins(loop, method="frd")
    assert frequency == pytest.approx(at, rel=1e-3)
    assert math.degrees(margin) == pytest.approx(wanted, abs=0.02)


def test_a_wall_of_nothing_has_no_phase_margin():
    with pytest.raises(ParameterError, match="A wall of 0 has no phase margin"):
        figures.phase_margins(loop_bode(RIGID, period=T), 0.0)


def test_a_device_that_bears_no_wall_is_said_to_bear_none():
    assert "no virtual wall is stable" in words(figures.loop_bode_figure(loop_bode(PHANTOM_1_5_X, period=T), name="x"))


def test_map_draws_stiffness_and_frequency_of_its_points():
    found = stability_map(LHIFAM_NEW_CABLE, period=[T], delay=np.linspace(0, 4e-3, 5), damping=np.linspace(0, 9, 4))
    left, right = figures.critical_stiffness_figure(found, name="LHIfAM").axes[:2]
    np.testing.assert_array_equal(left.collections[0].get_array(), found.stiffness[:, 0, :, 0])
    np.testing.assert_allclose(right.collections[0].get_array(), found.frequency[:, 0, :, 0] / (2 * np.pi))
    assert left.get_xlabel() == "delay in addition to the hold [ms]"
    assert left.get_ylabel() == "damping added to the motor [N s/m]"


def test_a_map_of_one_quantity_is_no_map_of_two():
    with pytest.raises(ParameterError, match="The map varies delay: this figure takes one that varies 2 of damping"):
        figures.critical_stiffness_figure(stability_map(RIGID, period=[T], delay=[0.0, T]), name="LHIfAM")


def test_linear_condition_stands_beside_the_exact_boundary():
    virtual = np.linspace(0.0, 20.0, 9)
    found = stability_map(RigidAxis(0.073, 0.59), period=[T], delay=[0.0, T], virtual_damping=virtual)
    values, quotient = figures.linear_condition_figure(found, name="PHANToM").axes
    np.testing.assert_array_equal([one.get_ydata() for one in values.lines[::2]], found.stiffness[0, :, :, 0].T)
    np.testing.assert_array_equal([one.get_ydata() for one in values.lines[1::2]], found.linear[0, :, :, 0].T)
    # Facts: 0.761 at 20 N s/m and no delay.
    assert quotient.lines[0].get_ydata()[-1] == pytest.approx(0.761, abs=5e-4)


def test_more_curves_than_colours_are_refused():
    found = stability_map(RIGID, period=[T], delay=np.linspace(0, T, 8), virtual_damping=np.linspace(0, 1, 9))
    with pytest.raises(ParameterError, match="8 curves were asked for"):
        figures.linear_condition_figure(found, name="LHIfAM")


def test_relay_figure_draws_the_end_of_each_run_and_its_spectrum():
    experiment = simulate_relay(LHIFAM_NEW_CABLE, period=T, force=5.0, start=1e-6, duration=20.0)
    cycle = limit_cycle(experiment)
    figure = figures.limit_cycles_figure({"small": (experiment, cycle)}, name="LHIfAM")
    t, x = line(figure, "position")
    np.testing.assert_array_equal(t, experiment.t[-len(t) :])
    np.testing.assert_allclose(x, 1e6 * experiment.position[-len(t) :])  # less than a millimetre
    np.testing.assert_array_equal(line(figure, "force")[1], experiment.force[-len(t) :])
    np.testing.assert_array_equal(line(figure, "density")[1], cycle.position_density[1:])
    assert "87.7 dB" in words(figure)


def test_white_noise_figure_draws_measurement_model_and_coherence(rng):
    experiment = simulate_white_noise(LHIFAM, period=T, force=5.0, position_noise=1e-6, duration=60.0, rng=rng)
    fit = fit_two_mass(experiment.frequency_response(segment=4.0).between(0.0, 2 * np.pi * 300))
    figure = figures.two_mass_fit_figure(fit, name="LHIfAM")
    np.testing.assert_array_equal(line(figure, "measured")[1], fit.response.decibels)
    np.testing.assert_array_equal(line(figure, "model")[1], 20 * np.log10(np.abs(fit.model)))
    np.testing.assert_array_equal(line(figure, "coherence")[1], fit.response.coherence)
    assert "resonance 82.0" in words(figure)


def test_transparency_figure_draws_apparent_inertia_and_the_ideal_response():
    result = transparency(RIGID, YOKOKOHJI_YOSHIKAWA, Feedforward(), 2.0, np.geomspace(1, 1000, 20))
    figure = figures.transparency_figure({2.0: result}, name="LHIfAM", filtered="sensor")
    np.testing.assert_array_equal(line(figure, "force gain 2, inertia")[1], result.apparent_inertia)
    # Known: 5.4 kg and a gain of 2 leave 1.8 kg; a spike near the filter does not set the scale.
    assert "1.8 kg at low frequency" in words(figure)
    assert figure.axes[2].get_ylim()[1] == pytest.approx(3.6, abs=0.1)
    np.testing.assert_allclose(line(figure, "force gain 2, ideal")[1], 20 * np.log10(np.abs(result.ideal)))


def test_worst_case_figure_draws_each_limit_over_its_delay():
    delay = np.array([0.0, 1e-3, 5e-3])
    limits = [critical_feedforward(RIGID, YOKOKOHJI_YOSHIKAWA, Feedforward(delay=float(late))) for late in delay]
    worst = worst_critical_feedforward(5.4, 2.0)
    figure = figures.worst_delay_figure(delay, {"hand": limits}, {"hand": worst}, name="LHIfAM")
    t, gain = line(figure, "hand")
    np.testing.assert_allclose(t, [0.0, 1.0, 5.0])
    np.testing.assert_allclose(gain, [6.644, 5.172, 3.938], rtol=1e-3)  # facts of the chapter's loop
    assert "worst case 3.70" in words(figure)


def test_estimator_figure_draws_lags_grains_and_traces():
    estimators = {"difference": AveragedDifference(), "stock": STOCK}
    found = {name: estimator_figures(e, Encoder(), speed=0.1003, acceleration=0.1) for name, e in estimators.items()}
    lag, grain, fast, steady = figures.velocity_estimators_figure(found).axes
    # The coarsest one is in the bars alone: over time it is upright lines.
    assert [one.get_label() for one in steady.lines] == ["true", "stock"]
    assert [bar.get_width() for bar in lag.patches] == [1e3 * one.lag for one in found.values()]
    assert [bar.get_width() for bar in grain.patches] == [1e3 * one.granularity for one in found.values()]
    drawn = np.asarray(fast.lines[1].get_ydata(), float)
    np.testing.assert_array_equal(drawn, 1e3 * found["stock"].estimate[-len(drawn) :])
    drawn = np.asarray(steady.lines[1].get_ydata(), float)
    np.testing.assert_array_equal(drawn, 1e3 * found["stock"].steady_estimate[-len(drawn) :])


def test_heat_figure_draws_currents_heats_and_rises():
    current = switched_current(Winding(2.0, 5e-5), voltage=4.0, duty=0.42, frequency=20e3)
    warm = warming(heat_pulses=3.0, heat_linear=1.0, resistance=10.0, time_constant=200.0, t=np.linspace(0, 900, 7))
    figure = figures.drive_heat_figure({"winding": current}, warm)
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), current.current)
    assert [bar.get_height() for bar in figure.axes[1].patches] == [current.heat, current.heat_linear]
    np.testing.assert_array_equal(line(figure, "pulses")[1], warm.pulses)
    np.testing.assert_array_equal(line(figure, "linear")[1], warm.linear)


def test_loop_traces_show_both_devices():
    tip = RigidAxis(0.0525, 1.0)
    trace = simulate_teleoperation(tip, tip, LoopSettings(), 500.0, duration=0.1)
    position, force = figures.loop_traces_figure({"500 N/m": trace}, title="two tips").axes
    np.testing.assert_array_equal([one.get_ydata() for one in position.lines], 1e3 * trace.position.T)
    np.testing.assert_array_equal([one.get_ydata() for one in force.lines], trace.force.T)


@pytest.fixture
def swing() -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(1000) / 1000.0
    return t, -0.01 * np.cos(2 * np.pi * 0.7 * t)


def test_sticking_figure_draws_position_force_and_velocity(swing):
    axis = CheapAxis(friction=StickingFriction(2.0, 100e-6, 5e-3))
    out = rendered(axis, *swing, np.zeros(1000))
    figure = figures.sticking_figure(*swing, out, axis)
    np.testing.assert_array_equal(line(figure, "position"), (swing[0], 1e3 * swing[1]))
    np.testing.assert_array_equal(line(figure, "force")[1], out.force)
    np.testing.assert_array_equal(line(figure, "velocity")[1], 1e3 * out.velocity)


def test_backlash_figure_draws_the_probe_in_the_gap(swing):
    axis = CheapAxis(mass=VirtualMass(0.2, 600.0), gap=1e-3)
    out = rendered(axis, *swing, np.zeros(1000))
    figure = figures.backlash_figure(*swing, out, axis)
    np.testing.assert_array_equal(line(figure, "apart")[1], 1e3 * (swing[1] - out.mass_position))
    np.testing.assert_array_equal(line(figure, "coupling")[1], out.coupling)
    assert "mass 0.2 kg on 600 N/m" in words(figure)


def test_cheap_axis_figure_draws_what_is_asked_and_what_is_felt(swing):
    axis, asked = CheapAxis(limit=0.5), np.sin(swing[0])
    out = rendered(axis, *swing, asked)
    figure = figures.cheap_axis_figure(*swing, asked, out, axis)
    np.testing.assert_array_equal(line(figure, "asked")[1], asked)
    np.testing.assert_array_equal(line(figure, "felt")[1], out.force)
    assert "A cheap axis (motor of 0.5 N)" in words(figure)


def test_link_figure_draws_limits_and_noise_over_the_loss_in_per_cent():
    felt = [NoiseFelt(0.1, 1e-3), NoiseFelt(0.2, 2e-3)]
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
