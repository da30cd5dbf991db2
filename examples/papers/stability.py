"""The chapter on stability and transparency in Advances in Haptics: vibration modes, delays and force feedforward."""

from __future__ import annotations

import math

import numpy as np
from paper_figures import (
    CABLE_DAMPING,
    STARTS,
    feedforward_experiment,
    lighter_by,
    phantom_1_0_identified,
    relays_over_delays,
)

from papers.page import LOST, Row, Section, compared
from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA, Operator, RigidAxis
from phantom_dyn.haptics.device.published import (
    LHIFAM,
    LHIFAM_HEAVIER_MOTOR,
    LHIFAM_MASS,
    LHIFAM_NEW_CABLE,
    PERIOD,
    PHANTOM_INERTIA,
    PHANTOM_RADIUS,
    phantom_1_0,
)
from phantom_dyn.haptics.experiments.frequency_response import NAMES
from phantom_dyn.haptics.stability.critical_stiffness import (
    critical_stiffness,
    linear_ratio,
    linear_stiffness,
    loop_bode,
)
from phantom_dyn.haptics.stability.force_feedforward import (
    Feedforward,
    critical_feedforward,
    felt_mass,
    low_pass,
    worst_critical_feedforward,
)
from phantom_dyn.haptics.stability.force_link import ForceLink, critical_feedforward_of_link

HZ = 2 * math.pi
LIGHT_HAND = Operator(0.271, 0.271, 1.355)
"""The hand that 0.14 kg needs; damping and stiffness in the ratios of the cited one."""


def linear_condition() -> Section:
    axis = RigidAxis(LHIFAM_MASS, LHIFAM.rigid.damping)
    rows = [
        Row(
            f"(10) of a rigid LHIfAM, {1e3 * delay:.0f} ms of delay",
            LOST,
            f"{linear_stiffness(axis.damping, period=PERIOD, delay=delay):.0f} N/m",
            f"exact: {100 * (linear_ratio(axis, period=PERIOD, delay=delay) - 1):+.2g} %",
            "(10) is derived: K < (b + B) / (T/2 + t_d)",
        )
        for delay in (0.0, 8e-3)
    ]
    light = RigidAxis(0.073, 0.59)
    rows += [
        Row(
            f"(10) of 73 g with a virtual damping of {damping:g} N s/m",
            LOST,
            f"{linear_stiffness(light.damping, period=PERIOD, virtual_damping=damping):.0f} N/m",
            f"exact: {100 * (linear_ratio(light, period=PERIOD, virtual_damping=damping) - 1):+.2g} %",
            "it holds for low damping; this one is high for so light a device" if damping > 10 else "",
        )
        for damping in (5.0, 20.0)
    ]
    return Section(
        "3 Linear condition, (10)",
        "`phantom_dyn.haptics.stability.critical_stiffness`; `linear_condition` and `map_of_critical_stiffness` of "
        "`examples/haptics_gallery.py`",
        tuple(rows),
    )


def identification() -> Section:
    fit = phantom_1_0_identified()
    values, deviations = (
        dict(zip(map(str, NAMES), part.tolist(), strict=True)) for part in (fit.values, fit.deviations)
    )
    resonance, deviation = fit.resonance
    inertia = 1e3 * (fit.values[0] + fit.values[1]) / PHANTOM_RADIUS**2
    assumed = f"simulated; the cable's damping, {CABLE_DAMPING:g} N m s/rad, the noise and 60 s are assumed"

    def fitted(words: str, printed: str, name: str, unit: str) -> Row:
        row = compared(words, printed, values[name], unit)
        return Row(row.what, row.published, f"{row.ours} (+- {deviations[name]:.2g})", row.difference, assumed)

    lost = [
        Row(
            f"Table 2, {words}",
            LOST,
            f"PHANToM {phantom:.4g} {units[0]}; LHIfAM {lhifam:.4g} {units[1]}",
            "",
            reason,
        )
        for words, phantom, lhifam, units, reason in (
            (
                "motor mass",
                phantom_1_0(CABLE_DAMPING).motor_mass,
                LHIFAM.motor_mass,
                ("kg m2", "kg"),
                "from total mass, cable stiffness and resonance",
            ),
            ("body mass", phantom_1_0(CABLE_DAMPING).body_mass, LHIFAM.body_mass, ("kg m2", "kg"), "the same"),
            (
                "cable damping",
                CABLE_DAMPING,
                LHIFAM.cable_damping,
                ("N m s/rad", "N s/m"),
                "PHANToM: assumed; LHIfAM: from Q",
            ),
            (
                "body damping",
                0.0,
                LHIFAM.body_damping,
                ("N m s/rad", "N s/m"),
                "assumed; of the LHIfAM 3.14 to 7.71 N s/m give the crossings that the text describes",
            ),
        )
    ]
    return Section(
        "4.2 Parameters of the model, Table 2, Figures 13 and 14",
        "`phantom_dyn.haptics.experiments.frequency_response.fit_two_mass`; Figure 14: `phantom_1_0_response` of "
        "`examples/paper_figures.py`; LHIfAM: `empirical_transfer_function` and `swept_sine` of "
        "`examples/haptics_gallery.py`",
        (
            compared(
                "PHANToM, resonance", "62.5", resonance / HZ, "Hz", reason=f"+- {deviation / HZ:.2g} Hz; {assumed}"
            ),
            Row(
                'the same, "may correspond to 60 Hz in Çavuşoğlu"',
                "60 Hz",
                "90 Hz",
                "",
                "60 Hz is the y axis there; the first joint moves x, which is at 90 Hz",
            ),
            fitted("Table 2, PHANToM: motor damping", "0.0085", "motor_damping", "N m s/rad"),
            fitted("Table 2, PHANToM: cable stiffness", "18.13", "cable_stiffness", "N m/rad"),
            compared("PHANToM, mass at 12 cm", "72.92", inertia, "g", reason="below 75 g, the manufacturer's number"),
            Row("Table 2, LHIfAM: motor damping, cable stiffness", "0.1 N s/m, 79.5 kN/m", "the same", "", "used"),
            *lost,
        ),
    )


def vibration() -> Section:
    original, new = (critical_stiffness(axis, period=PERIOD) for axis in (LHIFAM, LHIFAM_NEW_CABLE))
    heavier = critical_stiffness(LHIFAM_HEAVIER_MOTOR, period=PERIOD)
    linear = linear_stiffness(LHIFAM.rigid.damping, period=PERIOD)
    phantom = RigidAxis(PHANTOM_INERTIA, 0.0085)
    by_damping = ", ".join(
        f"{critical_stiffness(phantom_1_0(damping), period=PERIOD).stiffness:.1f}"
        for damping in (1e-3, 2e-3, 4e-3, 8e-3)
    )
    decibels = 20 * math.log10(linear)
    return Section(
        "4.3 Influence of the vibration mode, Table 3, Figures 15 and 16",
        "`phantom_dyn.haptics.stability.critical_stiffness`; `bode_of_the_original_cable` and `bode_of_the_new_cable` "
        "of `examples/haptics_gallery.py`",
        (
            compared("LHIfAM, resonance", "82", LHIFAM.free_frequency / HZ, "Hz", reason="the masses follow from it"),
            Row(
                "Table 3, LHIfAM: gain margin, and by (10)",
                LOST,
                f"{original.decibels:.2f} dB ({original.stiffness:.0f} N/m at {original.frequency:.2f} rad/s), "
                f"{decibels:.2f} dB ({linear:.0f} N/m)",
                "",
                "the vibration does not limit it, as the text says",
            ),
            Row(
                "Table 3, PHANToM: critical stiffness, and by (10)",
                LOST,
                f"{by_damping} N m/rad, {linear_stiffness(phantom.damping, period=PERIOD):.1f} N m/rad",
                "",
                "for a cable's damping of 0.001, 0.002, 0.004, 0.008 N m s/rad, which is lost",
            ),
            Row(
                "Figure 16: crossings of the new cable",
                "one",
                str(sum(each.frequency < 0.99 * math.pi / PERIOD for each in new.crossings)),
                "none",
                "",
            ),
            compared(
                "Figure 16: frequency of that crossing",
                "411.23",
                new.frequency,
                "rad/s",
                reason=f"{heavier.frequency:.2f} rad/s with a motor of {LHIFAM_HEAVIER_MOTOR.motor_mass} kg, but then "
                "the original cable resonates at 75.8 Hz, not at 82 Hz",
            ),
            Row(
                "Figure 16: gain margin, new and original cable",
                "larger",
                f"{new.decibels:.2f} and {original.decibels:.2f} dB",
                "none",
                "",
            ),
            compared("distance Q of the peak", "78.16", LHIFAM.peak_distance, "dB", reason="gives the cable's damping"),
            Row(
                "criterion: the vibration counts if Q is",
                '"similar or larger" than the margin of (10)',
                "similar or smaller",
                "",
                "misprint: Q is a distance to 0 dB",
            ),
        ),
    )


def relay() -> Section:
    new = critical_stiffness(LHIFAM_NEW_CABLE, period=PERIOD)
    late = critical_stiffness(LHIFAM_NEW_CABLE, period=PERIOD, delay=0.25e-3)
    rows = [
        Row(
            f"Table 4, {1e3 * each.delay:.0f} ms of delay",
            LOST,
            f"{each.theory.frequency / HZ:.2f} Hz, {each.theory.decibels:.2f} dB ({each.theory.stiffness:.0f} N/m)",
            "",
            "; ".join(
                f"relay {words}: {each.cycles[words].frequency / HZ:.2f} Hz, {each.cycles[words].decibels:.1f} dB"
                for words in STARTS
            ),
        )
        for each in relays_over_delays()
    ]
    bode = loop_bode(LHIFAM_NEW_CABLE, period=PERIOD)
    low = np.interp(np.log(HZ * np.array([1.0, 3.0])), np.log(bode.frequency), bode.decibels)
    slope = float(low[1] - low[0]) / math.log10(3.0)
    rows.append(
        compared(
            "Figure 17: slope from 1 to 3 Hz",
            "-40",
            slope,
            "dB a decade",
            reason="steeper by the anti-resonance at 14 Hz",
        )
    )
    rows.append(
        Row(
            "loss by 250 us of inherent delay",
            "more than 7 dB",
            f"{new.decibels - late.decibels:.1f} dB",
            "",
            f"or {new.decibels - late.crossings[2].decibels:.1f} dB at the vibration's crossing: neither is 7 dB",
        )
    )
    return Section(
        "4.4 Experimental results, Table 4, Figures 17 to 19",
        "`phantom_dyn.haptics.experiments.relay`; Figure 19: `relay_over_delays` of `examples/paper_figures.py`; "
        "Figure 18: `limit_cycles` of `examples/haptics_gallery.py`. Ours: lowest margin of the new cable, computed; "
        "the relay of 5 N is simulated for 60 s, and its limit cycle depends on the start",
        tuple(rows),
    )


def transparency() -> Section:
    device = RigidAxis(LHIFAM_MASS, LHIFAM.rigid.damping)
    without = feedforward_experiment(0.0)
    rises = {gain: lighter_by(feedforward_experiment(gain), without) for gain in (2.0, 5.0)}
    hand, cited = YOKOKOHJI_YOSHIKAWA, YOKOKOHJI_YOSHIKAWA.mass
    bare, light = (critical_feedforward(device, each, Feedforward()) for each in (hand, LIGHT_HAND))
    late = {
        delay: critical_feedforward(device, YOKOKOHJI_YOSHIKAWA, Feedforward(delay=delay)) for delay in (0.02, 0.05)
    }
    filtered = Feedforward(filter=low_pass(HZ * 30, period=PERIOD))
    open_mode, smooth = (critical_feedforward(LHIFAM, YOKOKOHJI_YOSHIKAWA, loop) for loop in (Feedforward(), filtered))
    rigid = critical_feedforward(device, YOKOKOHJI_YOSHIKAWA, filtered).gain
    lossy = critical_feedforward_of_link(LHIFAM, YOKOKOHJI_YOSHIKAWA, filtered, ForceLink(loss=0.2))
    simulated = "simulated with the vibration, a filter of 30 Hz, a hand of 2 kg and 0.05 N of sensor noise"
    return Section(
        "5 Transparency, Figures 20 to 25",
        "`phantom_dyn.haptics.stability.force_feedforward`; Figures 21 and 25: `force_feedforward` of "
        "`examples/paper_figures.py`; `apparent_inertia`, `worst_case_over_delay`, `force_through_the_vibration` and "
        "`lossy_link` of `examples/haptics_gallery.py`",
        (
            compared("Figure 21: rise by a force gain of 2", "9.54", rises[2.0], "dB", reason=simulated),
            compared("(28) felt mass with a force gain of 2", "1.8", felt_mass(LHIFAM_MASS, 2.0), "kg"),
            Row(
                "(30) operator",
                "cited, no numbers",
                "2 kg, 2 N s/m, 10 N/m",
                "",
                "as commonly cited after Yokokohji and Yoshikawa",
            ),
            compared("Figure 23: the phase crosses at", "500", bare.frequency / HZ, "Hz", reason="Nyquist frequency"),
            compared(
                "(32) least mass that feedforward leaves",
                "0.14",
                felt_mass(LHIFAM_MASS, bare.gain),
                "kg",
                reason=f"for a hand of {cited:g} kg (gain {bare.gain:.2f}); a hand of {LIGHT_HAND.mass:g} kg gives "
                f"{felt_mass(LHIFAM_MASS, light.gain):.2f} kg",
            ),
            Row(
                "(33) limit of the gain under large delays",
                "1 + m / m_h",
                f"{worst_critical_feedforward(LHIFAM_MASS, cited):.2f}",
                "",
                "the exact loop: "
                + ", ".join(f"{found.gain:.3f} at {1e3 * delay:.0f} ms" for delay, found in late.items()),
            ),
            compared("gain that any hand allows", "1", worst_critical_feedforward(LHIFAM_MASS, math.inf), ""),
            Row(
                "5.2 greatest gain with a filter of 30 Hz",
                "5 was used",
                f"{smooth.gain:.2f} with the filter, {open_mode.gain:.2f} without",
                "",
                f"with the vibration, swinging at {smooth.frequency / HZ:.0f} and {open_mode.frequency / HZ:.0f} Hz; "
                f"rigid: {rigid:.1f} and {bare.gain:.2f}; one sample in five lost, with the filter: {lossy:.2f}",
            ),
            compared("felt mass with a force gain of 5", "0.9", felt_mass(LHIFAM_MASS, 5.0), "kg"),
            Row(
                "Figure 25: x axis with a force gain of 5 beside the y axis",
                f"0.9 kg: {20 * math.log10(6):.2f} dB above 5.4 kg",
                f"{rises[5.0]:.2f} dB",
                "none" if abs(rises[5.0] - 20 * math.log10(6)) < 0.05 else "",
                simulated,
            ),
        ),
    )
