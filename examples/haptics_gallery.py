"""Every figure of haptics, drawn from the published devices: margins, maps, limit cycles, transparency, sensing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from arguments import chosen_folder
from joystick_walk import JOYSTICK, SILENT_ABOVE
from matplotlib.figure import Figure

from phantom_dyn.errors import RobotError
from phantom_dyn.haptics import figures
from phantom_dyn.haptics.cheap.cheap_axis import CheapAxis, StickingFriction, VirtualMass, cheap_translation
from phantom_dyn.haptics.cheap.cheap_hardware import rendered
from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA, Operator, RigidAxis
from phantom_dyn.haptics.device.drives import (
    PUBLISHED_RISE_LINEAR,
    PUBLISHED_RISE_PULSES,
    BrushMotor,
    Winding,
    switched_current,
    warming,
)
from phantom_dyn.haptics.device.published import LHIFAM, LHIFAM_NEW_CABLE
from phantom_dyn.haptics.device.safety import Guard, ThermalMotor, run_guard
from phantom_dyn.haptics.experiments.frequency_response import fit_two_mass
from phantom_dyn.haptics.experiments.noise_and_sweep import Sweep, simulate_swept_sine, simulate_white_noise
from phantom_dyn.haptics.experiments.relay import limit_cycle, simulate_relay
from phantom_dyn.haptics.sensing.accelerometer import AccelerationObserver, Accelerometer
from phantom_dyn.haptics.sensing.encoder import Encoder, SinusoidalEncoder
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings
from phantom_dyn.haptics.sensing.velocity_comparison import estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import (
    IMPROVED,
    STOCK,
    AdaptiveWindow,
    AveragedDifference,
    KalmanVelocity,
)
from phantom_dyn.haptics.stability.critical_stiffness import loop_bode, stability_map
from phantom_dyn.haptics.stability.force_feedforward import (
    Feedforward,
    critical_feedforward,
    low_pass,
    transparency,
    worst_critical_feedforward,
)
from phantom_dyn.haptics.stability.force_link import ForceLink, critical_feedforward_of_link, noise_felt
from phantom_dyn.haptics.stability.virtual_wall import (
    critical_loop_gain,
    critical_wall,
    simulate_teleoperation,
    simulate_wall,
)
from phantom_dyn.walking.stairs import Stairs, climb
from phantom_dyn.walking.walker import talos, talos_bent
from phantom_dyn.walking.walking_reference import walk

T = 1e-3
RIGID_LHIFAM = RigidAxis(5.4, 3.5)
# y axis of the PHANToM 1.5 at the origin; the hand's 1 N s/m is a round number, none is published.
HELD_TIP = RigidAxis(0.0525, 1.0)
HAND = f"with {HELD_TIP.damping:g} N s/m of damping assumed for the hand"


def bode_of_the_original_cable() -> Figure:
    return figures.loop_bode_figure(loop_bode(LHIFAM, period=T), name="LHIfAM, original cable")


def bode_of_the_new_cable() -> Figure:
    return figures.loop_bode_figure(loop_bode(LHIFAM_NEW_CABLE, period=T), name="LHIfAM, new cable")


def bode_under_a_delay() -> Figure:
    bode = loop_bode(LHIFAM_NEW_CABLE, period=T, delay=4 * T)
    return figures.loop_bode_figure(bode, name="LHIfAM, new cable, 4 ms of delay", stiffness=400.0)


def map_of_critical_stiffness() -> Figure:
    delay, damping = np.linspace(0.0, 8e-3, 100), np.linspace(0.0, 60.0, 100)
    found = stability_map(LHIFAM_NEW_CABLE, period=[T], delay=delay, damping=damping)
    return figures.critical_stiffness_figure(found, name="LHIfAM, new cable")


def linear_condition() -> Figure:
    found = stability_map(
        RigidAxis(0.073, 0.59), period=[T], delay=[0.0, 1e-3, 4e-3], virtual_damping=np.linspace(0.0, 20.0, 81)
    )
    return figures.linear_condition_figure(found, name="PHANToM, 73 g")


def limit_cycles() -> Figure:
    runs = {}
    for start, name in ((1e-6, "released at 1 um"), (10e-3, "released at 10 mm")):
        experiment = simulate_relay(LHIFAM_NEW_CABLE, period=T, delay=4 * T, force=5.0, start=start, duration=60.0)
        runs[name] = (experiment, limit_cycle(experiment))
    return figures.limit_cycles_figure(runs, name="LHIfAM, new cable, 4 ms of delay,")


def empirical_transfer_function() -> Figure:
    experiment = simulate_white_noise(
        LHIFAM, period=T, force=5.0, position_noise=2e-5, duration=100.0, rng=np.random.default_rng(1)
    )
    response = experiment.frequency_response(segment=4.0).between(0.0, 2 * np.pi * 300)
    return figures.two_mass_fit_figure(fit_two_mass(response), name="LHIfAM")


def swept_sine() -> Figure:
    experiment = simulate_swept_sine(
        LHIFAM,
        Sweep(2 * np.pi * 0.75, 2 * np.pi * 300, 20.0),
        period=T,
        force=15.0,
        position_noise=2e-5,
        rng=np.random.default_rng(1),
    )
    fit = fit_two_mass(experiment.frequency_response())
    return figures.two_mass_fit_figure(fit, name="LHIfAM", experiment="a swept sine")


def apparent_inertia() -> Figure:
    loop = Feedforward(filter=low_pass(2 * np.pi * 30, period=T))
    frequency = np.geomspace(0.5, 3000.0, 600)
    results = {gain: transparency(RIGID_LHIFAM, YOKOKOHJI_YOSHIKAWA, loop, gain, frequency) for gain in (0.0, 2.0, 5.0)}
    filtered = "Butterworth filter of second order at 30 Hz, sensor at 200 Hz, hold at 1 kHz; hand of 2 kg"
    return figures.transparency_figure(results, name="LHIfAM", filtered=filtered)


def worst_case_over_delay() -> Figure:
    delay = np.unique(np.concatenate([np.linspace(0.0, 2e-3, 21), np.linspace(2e-3, 20e-3, 37)]))
    hands = {
        "hand of 2 kg, as cited": YOKOKOHJI_YOSHIKAWA,
        "hand of 0.271 kg, which 0.14 kg needs": Operator(0.271, 0.271, 1.355),
    }
    limits = {
        words: [critical_feedforward(RIGID_LHIFAM, hand, Feedforward(delay=float(late))) for late in delay]
        for words, hand in hands.items()
    }
    worst = {words: worst_critical_feedforward(RIGID_LHIFAM.mass, hand.mass) for words, hand in hands.items()}
    return figures.worst_delay_figure(delay, limits, worst, name="LHIfAM")


def force_through_the_vibration() -> Figure:
    loop = Feedforward(filter=low_pass(2 * np.pi * 30, period=T))
    frequency = np.geomspace(0.5, 3000.0, 1200)
    results = {gain: transparency(LHIFAM, YOKOKOHJI_YOSHIKAWA, loop, gain, frequency) for gain in (0.0, 2.0, 5.0)}
    filtered = "with the vibration of its cable; Butterworth filter at 30 Hz, sensor at 200 Hz; hand of 2 kg"
    return figures.transparency_figure(results, name="LHIfAM", filtered=filtered)


def lossy_link() -> Figure:
    # 0.1 N of noise is a round number, none is published.
    loop, loss = Feedforward(filter=low_pass(2 * np.pi * 30, period=T)), np.linspace(0.0, 0.9, 19)
    devices = {"rigid": RIGID_LHIFAM, "with its vibration": LHIFAM}
    hand = YOKOKOHJI_YOSHIKAWA
    limits = {
        words: [critical_feedforward_of_link(device, hand, loop, ForceLink(loss=float(lost))) for lost in loss]
        for words, device in devices.items()
    }
    felt = {
        f"force gain {gain:g}": [noise_felt(LHIFAM, hand, loop, gain, ForceLink(0.1, float(lost))) for lost in loss]
        for gain in (2.0, 4.0)
    }
    return figures.lossy_link_figure(loss, limits, felt, name="LHIfAM, filter of 30 Hz, noise of 0.1 N")


def velocity_estimators() -> Figure:
    estimators = {
        "finite difference": AveragedDifference(),
        "mean of 16": AveragedDifference(16),
        "mean of 100 (stock)": STOCK,
        "period, mean of 16 (improved)": IMPROVED,
        "adaptive window": AdaptiveWindow(),
        "Kalman filter": KalmanVelocity(),
    }
    found = {
        name: estimator_figures(estimator, Encoder(), speed=0.1003, acceleration=0.1)
        for name, estimator in estimators.items()
    }
    # An accelerometer of 0.05 m/s2 of noise and 0.3 m/s2 of bias: round numbers, none is published.
    found["position and acceleration"] = estimator_figures(
        AccelerationObserver(),
        Encoder(),
        speed=0.1003,
        acceleration=0.1,
        accelerometer=Accelerometer(0.05, bias=0.3),
        rng=np.random.default_rng(1),
    )
    return figures.velocity_estimators_figure(found)


def sinusoidal_encoder() -> Figure:
    # Errors of 1 % are round numbers; the paper plans such encoders and states none.
    encoders = {
        "offset of 1 %": SinusoidalEncoder(offset=(0.01, 0.0)),
        "amplitudes 1 % apart": SinusoidalEncoder(mismatch=0.01),
        "0.01 rad off square": SinusoidalEncoder(phase=0.01),
        "third harmonic of 0.2 %": SinusoidalEncoder(harmonic=0.002),
    }
    return figures.sinusoidal_encoder_figure(encoders, speed=0.1)


def brush_cogging() -> Figure:
    # A motor of 2 ohm, 0.2 mH, 20 mN m/A and 11 bars: round numbers, none is published.
    motor = BrushMotor(Winding(2.0, 2e-4), 0.02, 11)
    return figures.commutation_figure(motor, voltage=4.0, speeds=(1.0, 50.0, 150.0))


def driver_safety() -> Figure:
    # Limits and thermal constants are round numbers, none is published.
    guard = Guard(ThermalMotor(2.0, 10.0, 200.0), current_per_force=0.5, slowest=0.5, warmest=60.0, cool=50.0)
    asked = np.where(np.arange(400) < 340, 5.0, np.nan)
    return figures.safety_figure(guard, 1.0, asked, run_guard(guard, 1.0, asked))


def drive_heat() -> Figure:
    # Resistance, inductances, voltage and pulses are round numbers; the published rises imply 42 % of duty.
    duty = PUBLISHED_RISE_LINEAR / PUBLISHED_RISE_PULSES
    windings = {"no inductance": Winding(2.0), "0.05 mH": Winding(2.0, 5e-5), "0.5 mH": Winding(2.0, 5e-4)}
    switched = {name: switched_current(one, voltage=4.0, duty=duty, frequency=20e3) for name, one in windings.items()}
    heat = switched["no inductance"]
    constant = 200.0
    resistance = PUBLISHED_RISE_LINEAR / heat.heat_linear / -np.expm1(-600.0 / constant)
    warm = warming(
        heat_pulses=heat.heat,
        heat_linear=heat.heat_linear,
        resistance=float(resistance),
        time_constant=constant,
        t=np.linspace(0.0, 900.0, 91),
    )
    return figures.drive_heat_figure(switched, warm)


def virtual_wall() -> Figure:
    settings = LoopSettings()
    limit = critical_wall(HELD_TIP, settings).gain
    traces = {
        f"{share * limit:.0f} N/m": simulate_wall(HELD_TIP, settings, share * limit, duration=0.4)
        for share in (0.5, 0.9, 1.6)
    }
    title = f"PHANToM tip on a virtual wall: stable up to {limit:.0f} N/m, {HAND}"
    return figures.loop_traces_figure(traces, title=title)


def teleoperation() -> Figure:
    settings = LoopSettings()
    limit = critical_loop_gain(HELD_TIP, HELD_TIP, settings).gain
    traces = {
        f"{share * limit:.0f} N/m": simulate_teleoperation(HELD_TIP, HELD_TIP, settings, share * limit, duration=0.4)
        for share in (0.5, 0.95, 1.05)
    }
    title = f"Two PHANToM tips tied by their position error: stable up to {limit:.0f} N/m, {HAND}"
    return figures.loop_traces_figure(traces, title=title)


FRICTION_OF_FIGURE_8 = StickingFriction(2.0, 100e-6, 5e-3)
PLAY_OF_FIGURE_9 = CheapAxis(mass=VirtualMass(0.2, 600.0), gap=1e-3)


def creeping_probe(rate: float = 1000.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions of a probe that slows down, creeps on, turns and speeds up again."""
    t = np.arange(round(2.0 * rate)) / rate
    corners = [0.0, 0.3, 0.4, 0.6, 0.7, 1.2, 1.5, 2.0]
    v = np.interp(t, corners, [0.05, 0.05, 1e-4, 1e-4, -1e-3, -1e-3, -0.05, -0.05])
    return t, np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) / rate)])


def swinging_probe(rate: float = 1000.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and positions of a probe that swings by 10 mm at 0.7 Hz."""
    t = np.arange(round(3.0 * rate)) / rate
    return t, -0.01 * np.cos(2 * np.pi * 0.7 * t)


def sticking_friction() -> Figure:
    axis = CheapAxis(friction=FRICTION_OF_FIGURE_8)
    t, x = creeping_probe()
    return figures.sticking_figure(t, x, rendered(axis, t, x, 0 * x), axis)


def backlash() -> Figure:
    t, x = swinging_probe()
    return figures.backlash_figure(t, x, rendered(PLAY_OF_FIGURE_9, t, x, 0 * x), PLAY_OF_FIGURE_9)


def cheap_axis() -> Figure:
    # Friction in slip, cogging's period and the level of clipping are not published: 0.3 N, 10 mm, 1.5 N.
    axis = cheap_translation(slip=0.3, order=2 * np.pi / 0.01, limit=1.5)
    t = np.cumsum(np.random.default_rng(1).uniform(1 / 2000, 1 / 500, 3000))
    x = -0.01 * np.cos(2 * np.pi * 0.7 * t)
    asked = np.where(x > 0.004, -400.0 * (x - 0.004), 0.0)
    return figures.cheap_axis_figure(t, x, asked, rendered(axis, t, x, asked), axis)


def joystick_walk() -> Figure:
    return figures.walk_figure(walk(talos(), JOYSTICK, duration=10.0), silent_above=SILENT_ABOVE)


def stairs() -> Figure:
    return figures.stairs_figure(climb(talos_bent(), Stairs(0.22, 0.05), 4))


GALLERY: tuple[Callable[[], Figure], ...] = (
    bode_of_the_original_cable,
    bode_of_the_new_cable,
    bode_under_a_delay,
    map_of_critical_stiffness,
    linear_condition,
    limit_cycles,
    empirical_transfer_function,
    swept_sine,
    apparent_inertia,
    force_through_the_vibration,
    worst_case_over_delay,
    lossy_link,
    velocity_estimators,
    sinusoidal_encoder,
    brush_cogging,
    drive_heat,
    driver_safety,
    virtual_wall,
    teleoperation,
    sticking_friction,
    backlash,
    cheap_axis,
    joystick_walk,
    stairs,
)


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for draw in GALLERY:
        path = folder / f"{draw.__name__}.png"
        half = path.with_suffix(".part.png")  # nobody reads half of a picture
        try:
            drawn = draw()
        except RobotError as problem:  # the walk's robot is in a package of its own
            print(f"left out {path.name}: {problem}", flush=True)
            continue
        drawn.savefig(half)
        half.replace(path)
        print(f"wrote {path}", flush=True)


if __name__ == "__main__":
    main(chosen_folder(__doc__, "haptics"))
