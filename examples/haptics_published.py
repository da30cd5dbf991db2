"""Published figures of haptic devices beside what their published parameters give: the table of docs/haptics.md."""

from __future__ import annotations

import argparse
import math

from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA, RigidAxis
from phantom_dyn.haptics.device.drives import PUBLISHED_RISE_LINEAR, PUBLISHED_RISE_PULSES, duty_of_heat_ratio
from phantom_dyn.haptics.device.published import (
    LHIFAM,
    LHIFAM_HEAVIER_MOTOR,
    LHIFAM_NEW_CABLE,
    PERIOD,
    PHANTOM_1_5_X,
    PHANTOM_1_5_Y,
    PHANTOM_1_5_Z,
    PRINTED_CROSSING,
    low_frequency_inertia,
)
from phantom_dyn.haptics.experiments.relay import limit_cycle, simulate_relay
from phantom_dyn.haptics.sensing.encoder import Encoder
from phantom_dyn.haptics.sensing.velocity_comparison import estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import STOCK
from phantom_dyn.haptics.stability.critical_stiffness import critical_stiffness, linear_stiffness
from phantom_dyn.haptics.stability.force_feedforward import (
    Feedforward,
    critical_feedforward,
    felt_mass,
    low_pass,
    worst_critical_feedforward,
)
from phantom_dyn.haptics.stability.force_link import ForceLink, critical_feedforward_of_link
from phantom_dyn.haptics.stability.phantom_improvements import Improvement, operational_masses, phantom_improvements
from phantom_dyn.haptics.stability.published_ratios import Explained, explained_improvements

HZ = 2 * math.pi
Row = tuple[str, str, str, str]


def stability() -> list[Row]:
    original, new = (critical_stiffness(axis, period=PERIOD) for axis in (LHIFAM, LHIFAM_NEW_CABLE))
    heavier = critical_stiffness(LHIFAM_HEAVIER_MOTOR, period=PERIOD)
    late = critical_stiffness(LHIFAM_NEW_CABLE, period=PERIOD, delay=0.25e-3)
    linear = linear_stiffness(LHIFAM.rigid.damping, period=PERIOD)
    x = f"{low_frequency_inertia(PHANTOM_1_5_X) * 1e6:.1f}"
    fits = ", ".join([x, *(f"{low_frequency_inertia(fit) * 1e6:.1f}" for fit in (PHANTOM_1_5_Y, PHANTOM_1_5_Z))])
    masses = ", ".join(f"{1e3 * mass:.1f}" for mass in operational_masses())
    return [
        ("LHIfAM, resonance", "82 Hz", f"{LHIFAM.free_frequency / HZ:.1f} Hz", "the masses are derived from it"),
        (
            "LHIfAM, original cable, distance of the peak",
            "78.16 dB",
            f"{LHIFAM.peak_distance:.2f} dB",
            "the cable's damping is derived from it",
        ),
        (
            "original cable, critical stiffness",
            "limited by the rigid mode",
            f"{original.stiffness:.0f} N/m, {original.decibels:.2f} dB, {original.frequency:.2f} rad/s",
            f"linear condition: {linear:.0f} N/m",
        ),
        (
            "new cable, single crossing",
            f"{PRINTED_CROSSING} rad/s",
            f"{new.frequency:.2f} rad/s, {new.decibels:.2f} dB",
            f"inconsistent: {heavier.frequency:.2f} rad/s needs a motor of {LHIFAM_HEAVIER_MOTOR.motor_mass} kg, and "
            "then the original cable does not resonate at 82 Hz",
        ),
        (
            "new cable, loss by 250 us of inherent delay",
            "more than 7 dB",
            f"{new.decibels - late.decibels:.1f} dB",
            f"inconsistent: or {new.decibels - late.crossings[2].decibels:.1f} dB at the vibration's crossing",
        ),
        (
            "PHANToM 1.5, mass at low frequency: x, y, z",
            f"{fits} g (fits)",
            f"{masses} g (dynamic model)",
            "inconsistent: the fits have no unit that makes them agree",
        ),
    ]


def relay() -> list[Row]:
    rows = []
    for start, words in ((1e-6, "1 um"), (10e-3, "10 mm")):
        theory = critical_stiffness(LHIFAM_NEW_CABLE, period=PERIOD, delay=4e-3)
        experiment = simulate_relay(LHIFAM_NEW_CABLE, period=PERIOD, delay=4e-3, force=5.0, start=start, duration=60.0)
        cycle = limit_cycle(experiment)
        rows.append(
            (
                f"new cable, relay, 4 ms of delay, start at {words}",
                "table lost",
                f"{cycle.frequency / HZ:.2f} Hz, {cycle.decibels:.1f} dB",
                f"theory: {theory.frequency / HZ:.2f} Hz, {theory.decibels:.1f} dB; two cycles coexist",
            )
        )
    return rows


def feedforward() -> list[Row]:
    device = RigidAxis(LHIFAM.rigid.mass, LHIFAM.rigid.damping)
    limit = critical_feedforward(device, YOKOKOHJI_YOSHIKAWA, Feedforward()).gain
    worst = worst_critical_feedforward(device.mass, YOKOKOHJI_YOSHIKAWA.mass)
    gains = ", ".join(f"{felt_mass(device.mass, gain):.1f}" for gain in (2, 5))
    filtered = Feedforward(filter=low_pass(HZ * 30, period=PERIOD))
    bare, smooth = (critical_feedforward(LHIFAM, YOKOKOHJI_YOSHIKAWA, loop) for loop in (Feedforward(), filtered))
    rigid = critical_feedforward(device, YOKOKOHJI_YOSHIKAWA, filtered).gain
    lossy = critical_feedforward_of_link(LHIFAM, YOKOKOHJI_YOSHIKAWA, filtered, ForceLink(loss=0.2))
    return [
        ("LHIfAM, felt mass with a force gain of 2 and 5", "1.8, 0.9 kg", f"{gains} kg", ""),
        (
            "LHIfAM, least mass that feedforward leaves",
            "0.14 kg",
            f"{felt_mass(device.mass, limit):.2f} kg (gain {limit:.2f}, worst case {worst:.1f})",
            "inconsistent: holds for a hand of 2 kg, as cited; 0.14 kg needs one of 0.271 kg",
        ),
        (
            "LHIfAM with its vibration, greatest force gain",
            "5 was used, with a filter of 30 Hz",
            f"{smooth.gain:.2f} with the filter, {bare.gain:.2f} without",
            f"swings at {smooth.frequency / HZ:.0f} and {bare.frequency / HZ:.0f} Hz; rigid: {rigid:.1f} and "
            f"{limit:.2f}; with the filter and one sample in five lost: {lossy:.2f}",
        ),
    ]


def sensing() -> list[Row]:
    stock = estimator_figures(STOCK, Encoder(), speed=0.1003, acceleration=0.1)
    duty = duty_of_heat_ratio(PUBLISHED_RISE_PULSES / PUBLISHED_RISE_LINEAR)
    return [
        ("PHANToM 1.5, lag of 100 averaged differences", "50 ms", f"{1e3 * stock.lag:.1f} ms", ""),
        (
            "motor, rise by pulses and by a linear drive",
            f"{PUBLISHED_RISE_PULSES}, {PUBLISHED_RISE_LINEAR} K",
            f"duty cycle {100 * duty:.0f} %",
            "what the rises imply; none is published",
        ),
    ]


def improved(one: Improvement, explained: Explained) -> Row:
    answers = [model for model in one.models if not math.isnan(model.ratio)]
    found = ", ".join(f"{100 * (model.ratio - 1):+.0f} % ({model.model.split(', ')[-1]})" for model in answers[:2])
    alone = f"52.5 g, lag of the estimators alone: {found}" if answers else "no published model bears it"
    values = f" ({explained.before:.4g} to {explained.after:.4g} {explained.unit})" if explained.published else ""
    given = f" ({one.published[0]:g} to {one.published[1]:g} {one.unit})" if one.published else ""
    needs = " and ".join(f"{need.says}, {need.value:.3g} {need.unit}" for need in explained.assumptions)
    return (
        f"PHANToM 1.5, {one.quantity}",
        f"{100 * (one.published_ratio - 1):+.0f} %{given}",
        f"{100 * (explained.ratio - 1):+.0f} %{values} under an assumption",
        f"assumed: {needs}; without: {alone}",
    )


def improvements() -> list[Row]:
    pairs = zip(phantom_improvements(), explained_improvements(), strict=True)
    return [improved(one, explained) for one, explained in pairs]


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    rows = [*stability(), *relay(), *feedforward(), *sensing(), *improvements()]
    print("| figure | published | computed | |\n|---|---|---|---|")
    for row in rows:
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
