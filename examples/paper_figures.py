"""Figures of two papers on haptic devices that no other example draws, from simulated experiments.

PHANToM 1.5: Figure 4. Advances in Haptics: Figures 14 (PHANToM 1.0), 19 (relay over nine delays), 21 and 25 (force
feedforward). What the papers do not give is assumed, and said in the title of the figure.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from arguments import chosen_folder
from matplotlib.figure import Figure

from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA
from phantom_dyn.haptics.device.published import (
    LHIFAM,
    LHIFAM_MASS,
    LHIFAM_NEW_CABLE,
    PERIOD,
    PHANTOM_1_5_X,
    PHANTOM_1_5_Y,
    PHANTOM_1_5_Z,
    phantom_1_0,
)
from phantom_dyn.haptics.device.transfer_function import TransferFunction
from phantom_dyn.haptics.experiments.frequency_response import (
    FrequencyResponse,
    TwoMassFit,
    estimate_frequency_response,
    fit_two_mass,
)
from phantom_dyn.haptics.experiments.noise_and_sweep import simulate_white_noise
from phantom_dyn.haptics.experiments.relay import LimitCycle, limit_cycle, simulate_relay
from phantom_dyn.haptics.figures import two_mass_fit_figure
from phantom_dyn.haptics.figures.canvas import COLORS, GREY, IDEAL, MARK, MARKERS, key, panels
from phantom_dyn.haptics.stability.critical_stiffness import CriticalStiffness, critical_stiffness, loop_bode
from phantom_dyn.haptics.stability.force_feedforward import Feedforward, felt_mass, low_pass
from phantom_dyn.haptics.stability.force_link import ForceLink, simulate_link

HZ = 2 * math.pi
PHANTOM_FITS: dict[str, TransferFunction] = {"x": PHANTOM_1_5_X, "y": PHANTOM_1_5_Y, "z": PHANTOM_1_5_Z}
PHANTOM_RESONANCES = {"x": ("90",), "y": ("60", "125", "250", "30"), "z": ("65",)}
"""Resonances that the text states [Hz]; the first of each is compared with the fit."""
CABLE_DAMPING = 0.002  # N m s/rad, of the PHANToM 1.0: not given
DELAYS = tuple(1e-3 * k for k in range(9))
STARTS = {"released at 1 um": 1e-6, "released at 10 mm": 10e-3}
SENSOR_NOISE = 0.05  # N, of the force sensor: not given


def phantom_frequency_response() -> Figure:
    """Figure 4 of the paper on the PHANToM: the three fits, and the resonances that the text states."""
    out, axes = panels(3, title="PHANToM 1.5: published fits (solid) and resonances of the text (dotted)", height=2.0)
    frequency = np.geomspace(10.0, 1000.0, 2001)
    for (ax,), (axis, fit) in zip(axes, PHANTOM_FITS.items(), strict=True):
        ax.semilogx(frequency, 20 * np.log10(np.abs(fit.response(HZ * frequency))), color=COLORS[0])
        for stated in PHANTOM_RESONANCES[axis]:
            ax.axvline(float(stated), color=COLORS[1], ls=MARK, lw=1.2)
            ax.annotate(f" {stated} Hz", (float(stated), 0.02), xycoords=("data", "axes fraction"), fontsize=8)
        ax.axvspan(200.0, 1000.0, color="0.93", lw=0)
        ax.set_ylabel(f"{axis}: position over\nforce [dB]")
    axes[-1][0].set_xlabel("frequency [Hz]; grey: beyond 200 Hz, where the fits end")
    return out


def phantom_1_0_identified() -> TwoMassFit:
    """Two masses of the first axis of the PHANToM 1.0 from a simulated white-noise experiment of section 4.2."""
    experiment = simulate_white_noise(
        phantom_1_0(CABLE_DAMPING),
        period=PERIOD,
        force=0.02,
        position_noise=2e-5,
        duration=60.0,
        rng=np.random.default_rng(1),
    )
    return fit_two_mass(experiment.frequency_response(segment=4.0).between(0.0, HZ * 300))


def phantom_1_0_response() -> Figure:
    """Figure 14 of the chapter."""
    return two_mass_fit_figure(phantom_1_0_identified(), name="PHANToM 1.0 (cable's damping assumed)", rotary=True)


@dataclass(frozen=True)
class RelayAt:
    """Theory and relay experiments at one delay.

    Attributes:
        delay: [s].
        theory: Critical stiffness of the LHIfAM with its new cable.
        cycles: One limit cycle for each start.
    """

    delay: float
    theory: CriticalStiffness
    cycles: dict[str, LimitCycle]


def relays_over_delays() -> list[RelayAt]:
    """Table 4 of the chapter: nine delays."""
    out = []
    for delay in DELAYS:
        theory = critical_stiffness(LHIFAM_NEW_CABLE, period=PERIOD, delay=delay)
        runs = {
            words: simulate_relay(LHIFAM_NEW_CABLE, period=PERIOD, delay=delay, force=5.0, start=start, duration=60.0)
            for words, start in STARTS.items()
        }
        out.append(RelayAt(delay, theory, {words: limit_cycle(run) for words, run in runs.items()}))
    return out


def relay_over_delays() -> Figure:
    """Figure 19 of the chapter: gain margins of the relay experiments on the Bode diagram of the loop."""
    title = "LHIfAM, new cable: loop without delay, and relay experiments at delays of 0 to 8 ms (5 N, 60 s)"
    out, ((ax,),) = panels(1, title=title, height=4.5)
    bode = loop_bode(LHIFAM_NEW_CABLE, period=PERIOD)
    ax.semilogx(bode.frequency / HZ, bode.decibels, color=GREY, label="loop, computed")
    found = relays_over_delays()
    for k, words in enumerate(STARTS):
        cycles = [each.cycles[words] for each in found]
        frequency = [cycle.frequency / HZ for cycle in cycles]
        margin = [-cycle.decibels for cycle in cycles]
        ax.plot(frequency, margin, MARKERS[k], color=COLORS[k], ms=6, mfc="none", label=f"relay, {words}")
    frequency = [each.theory.frequency / HZ for each in found]
    ax.plot(frequency, [-each.theory.decibels for each in found], "x", color="black", label="lowest margin, computed")
    for each in found[:3]:
        at = (each.theory.frequency / HZ, -each.theory.decibels)
        ax.annotate(f"{1e3 * each.delay:.0f} ms", at, xytext=(6, 6), textcoords="offset points", fontsize=8)
    ax.set_xlim(0.5, 500.0)
    ax.set_ylim(-125.0, -30.0)
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel("position over force [dB]")
    key(ax, "lower left")
    return out


def feedforward_experiment(gain: float) -> FrequencyResponse:
    """Position over measured force of the LHIfAM in a hand, simulated: Figures 21 and 25 of the chapter."""
    rng = np.random.default_rng(5)
    loop = Feedforward(period=PERIOD, filter=low_pass(HZ * 30, period=PERIOD))
    pushed = 20.0 * rng.standard_normal(40_000)
    trace = simulate_link(LHIFAM, YOKOKOHJI_YOSHIKAWA, loop, gain, ForceLink(SENSOR_NOISE), pushed, rng)
    response = estimate_frequency_response(trace.reading, trace.tip, period=PERIOD, segment=4.0)
    return response.between(HZ * 1.0, HZ * 10.0)


def lighter_by(with_gain: FrequencyResponse, without: FrequencyResponse) -> float:
    """Rise of position over force by the gain, mean of 1 to 3 Hz [dB]."""
    low = without.frequency < HZ * 3
    return float(np.mean((with_gain.decibels - without.decibels)[low]))


def force_feedforward() -> Figure:
    """Figures 21 and 25 of the chapter."""
    title = (
        "LHIfAM with force feedforward, simulated: filter of 30 Hz, hand of 2 kg and "
        f"{SENSOR_NOISE:g} N of sensor noise assumed"
    )
    out, ((left, right),) = panels(1, 2, title=title, height=3.6, width=10)
    without = feedforward_experiment(0.0)
    f = without.frequency / HZ
    for ax, gain, figure in ((left, 2.0, "21"), (right, 5.0, "25")):
        for k, (used, each) in enumerate(((0.0, without), (gain, feedforward_experiment(gain)))):
            mass = felt_mass(LHIFAM_MASS, used)
            ax.semilogx(f, each.decibels, MARKERS[k], color=COLORS[k], ms=3, label=f"force gain {used:g}")
            ax.semilogx(f, -20 * np.log10(mass * (HZ * f) ** 2), color=COLORS[k], ls=IDEAL, label=f"{mass:.1f} kg")
        ax.set_title(f"Figure {figure}" + (": 0.9 kg is the y axis, as stated" if figure == "25" else ""), fontsize=10)
        ax.set_xlabel("frequency [Hz]")
        key(ax, "lower left")
    left.set_ylabel("position over force [dB]")
    return out


FIGURES: tuple[Callable[[], Figure], ...] = (
    phantom_frequency_response,
    phantom_1_0_response,
    relay_over_delays,
    force_feedforward,
)


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for draw in FIGURES:
        path = folder / f"{draw.__name__}.png"
        draw().savefig(path)
        print(f"wrote {path}", flush=True)


if __name__ == "__main__":
    main(chosen_folder(__doc__, "papers"))
