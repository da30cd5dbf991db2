"""The paper on simulated cheap hardware: its device, its models, Table 2 and Figures 4 and 8 to 10."""

from __future__ import annotations

import math

import numpy as np
from haptics_gallery import FRICTION_OF_FIGURE_8, PLAY_OF_FIGURE_9, creeping_probe, swinging_probe

from papers.page import NOT_GIVEN, Row, Section, compared, exact
from phantom_dyn.haptics.cheap.cheap_axis import (
    CUTOFF_HZ,
    WORKSTATION,
    CheapAxis,
    WorkstationAxis,
    cheap_rotation,
    cheap_translation,
)
from phantom_dyn.haptics.cheap.cheap_hardware import GAP_DAMPING, WINDOW, butterworth_weights, coupling_force, rendered

RATES = (500, 1000, 2000)
TRANSLATION = cheap_translation(slip=1.0, order=600.0, limit=math.inf)
ROTATION = cheap_rotation(slip=0.1, order=40.0, limit=math.inf)
MODELS = "`phantom_dyn.haptics.cheap`"


def _by_rate(values: list[float], digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _axis(name: str, axis: WorkstationAxis) -> Row:
    scale, unit, force = (math.degrees(1.0), "degrees", "N m") if axis.turns else (1e3, "mm", "N")
    printed = "turns on" if math.isinf(axis.travel) else f"{scale * axis.travel:.0f} {unit}"
    printed += f", {axis.continuous:g} and {axis.peak:g} {force}" if axis.peak else ", no motor"
    steps = _by_rate([scale * axis.resolution * rate for rate in RATES], 0)
    t = np.arange(100) / 1000.0
    held = float(np.abs(rendered(axis.motor, t, 0 * t, np.full(100, 2 * axis.peak + 1.0)).force).max())
    return Row(
        f"Table 1, {name}",
        f"{printed}, steps of {scale * axis.resolution:g} {unit}",
        (f"holds {held:g} {force} of a larger force; " if axis.peak else "") + f"velocity in steps of {steps} {unit}/s",
        "",
        "at 500, 1000 and 2000 Hz",
    )


def device() -> Section:
    rows = tuple(_axis(name, axis) for name, axis in WORKSTATION.items())
    return Section("I.C Hardware, Table 1", "`phantom_dyn.haptics.cheap.cheap_axis`", rows)


def models() -> Section:
    weights = [butterworth_weights(1 / rate, CUTOFF_HZ) for rate in RATES]
    at_wall = -coupling_force(0.5 * 1e-3, 0.0, 1.0, 1e-3, 600.0, 0.0)
    t = np.arange(1000) / 1000.0
    x = np.linspace(0.0, 0.02, 1000)  # two waves of the cogging
    order = 2 * np.pi / 0.01
    cogging = cheap_translation(slip=1.0, order=order, limit=math.inf).cogging
    wave = rendered(CheapAxis(cogging=cogging), t, x, 0 * x).force
    return Section(
        "II and III Hardware models and their composition, Figures 2, 3 and 5 to 7",
        f"{MODELS}; `cheap_axis`, `sticking_friction` and `backlash` of `examples/haptics_gallery.py`",
        (
            Row(
                "A: first-order Butterworth filter of 70 Hz, b0 and a1",
                NOT_GIVEN,
                "; ".join(f"{b:.4f}, {a:.4f}" for b, a in weights),
                "",
                "at 500, 1000 and 2000 Hz; computed anew for each step",
            ),
            Row(
                "A: delay of the mean of 25 forces",
                NOT_GIVEN,
                f"{_by_rate([1e3 * (WINDOW - 1) / 2 / rate for rate in RATES], 0)} ms",
                "",
                f"at 500, 1000 and 2000 Hz; it lets nothing through at "
                f"{_by_rate([rate / WINDOW for rate in RATES], 0)} Hz",
            ),
            Row(
                "B (2): spring in contact",
                "K (x_vm - x_hi)",
                "K (p_vc - x_hi)",
                f"{1e3 * 0.5 * 600 * 1e-3:.0f} mN at contact",
                f"misprint: as printed the force jumps there by K d/2 (600 N/m, 1 mm), with ours by {at_wall:.0f}",
            ),
            Row(
                "B: damping in the gap over that in contact",
                "0.2",
                f"{GAP_DAMPING:g}",
                "none",
                "between probe and mass, as the text has it",
            ),
            compared("C: f_static / f_slip", "1.05", FRICTION_OF_FIGURE_8.static_ratio, "", digits=2),
            Row("C: f_slip", NOT_GIVEN, "an input", "", ""),
            Row(
                "D, Figure 4: cogging torque",
                "a sine of the angle",
                f"a sine; work over two waves {exact(abs(float(np.trapezoid(wave, x))), 'J', none='0 J')}",
                "",
                "its period is not given and is an input",
            ),
            Row("III, Figure 7: composition", "a diagram", "as drawn", "none", "forces pass beside the coupling"),
            Row("E: level of the clipping", "20 to 30 % of the stall torque", "an input", "", "no number is given"),
        ),
    )


def table_2() -> Section:
    rows = []
    for name, axis, unit, force in (("translation", TRANSLATION, "m", "N"), ("rotation", ROTATION, "rad", "N m")):
        mass, friction, cogging = axis.mass, axis.friction, axis.cogging
        assert mass is not None
        assert friction is not None
        assert cogging is not None
        turns = name == "rotation"
        rows += [
            Row(
                f"{name}: mass",
                '"1 mkgmm"' if turns else "0.1 kg",
                f"{mass.inertia:g} {'kg m2' if turns else 'kg'}",
                "none",
                "read so that the period is that of the translation" if turns else "",
            ),
            Row(f"{name}: K", "1 N m/rad" if turns else "150 N/m", f"{mass.stiffness:g} {force}/{unit}", "none", ""),
            Row(
                f"{name}: B",
                "0.04, no unit" if turns else "0.05, no unit",
                f"{mass.damping:.3g} {force} s/{unit}",
                "",
                '"ideally critically damped": the printed number is not, in N s/m or in N s/mm',
            ),
            Row(
                f"{name}: gap",
                "2 degrees" if turns else "1 mm",
                f"{math.degrees(axis.gap):g} degrees" if turns else f"{1e3 * axis.gap:g} mm",
                "none",
                "",
            ),
            Row(
                f"{name}: cogging",
                "0.04 N m" if turns else "0.6 N",
                f"{cogging.amplitude[0]:g} {force}",
                "none",
                "",
            ),
            Row(
                f"{name}: pre-sliding and stick velocity",
                "100 um, 5 mm/s" if turns else "5 mrad, 6 degrees/s",
                f"{1e3 * friction.displacement:g} mrad, {math.degrees(friction.stick_velocity):g} degrees/s"
                if turns
                else f"{1e6 * friction.displacement:g} um, {1e3 * friction.stick_velocity:g} mm/s",
                "",
                "misprint: the columns are exchanged"
                + (f"; the text has 0.2 degrees, {1e3 * math.radians(0.2):.2f} mrad" if turns else ""),
            ),
        ]
    mass, heavier = TRANSLATION.mass, PLAY_OF_FIGURE_9.mass
    assert mass is not None
    assert heavier is not None
    rows += [
        compared(
            "IV: time constant",
            "150",
            1e3 * mass.period,
            "ms",
            reason="ours: period of 0.1 kg on 150 N/m; how the paper took it is not stated",
        ),
        compared(
            "IV: the same with the values of the text on backlash",
            "150",
            1e3 * heavier.period,
            "ms",
            reason="0.2 kg on 600 N/m: the text contradicts itself, and 0.2 kg is more than Table 2 allows",
        ),
        compared("IV: EA/L of 1 cm3 of steel", "200", 200e9 * 1e-4 / 1e-2 / 1e7, "1e7 N/m", digits=0),
    ]
    return Section(
        "IV Results, Table 2",
        "`cheap_translation` and `cheap_rotation` of `phantom_dyn.haptics.cheap.cheap_axis`",
        tuple(rows),
    )


def figures() -> Section:
    friction, drop, play, hits = [], [], [], []
    for rate in RATES:
        t, x = creeping_probe(rate)
        out = rendered(CheapAxis(friction=FRICTION_OF_FIGURE_8), t, x, 0 * x)
        friction.append(float(np.abs(out.force).max()) / FRICTION_OF_FIGURE_8.torque)
        first = int(np.flatnonzero(out.stuck & (t > 0.1))[0])
        drop.append(abs(float(out.force[first])) / FRICTION_OF_FIGURE_8.torque)
        t, x = swinging_probe(rate)
        swing = rendered(PLAY_OF_FIGURE_9, t, x, 0 * x)
        play.append(1e3 * float(np.abs(x - swing.mass_position)[t > 2.0].max()))
        period = swing.contact[(t > 1.0) & (t <= 1.0 + 1 / 0.7)]
        hits.append(np.count_nonzero(~period[:-1] & period[1:]))
    bend = 1e3 * (0.5e-3 + 0.2 * 0.01 * (2 * np.pi * 0.7) ** 2 / 600.0)
    return Section(
        "IV Results, Figures 8, 9 and 10",
        "`sticking_friction` and `backlash` of `examples/haptics_gallery.py`; Figure 10: "
        "`python benchmarks/haptics_step_cost.py`, see "
        "[Haptic rendering](../haptics.md#processor-time-of-a-control-step)",
        (
            Row(
                "Figure 8: largest friction over that in slip",
                "1.05",
                _by_rate(friction, 3),
                f"{100 * (min(friction) / 1.05 - 1):+.1f} % at most",
                "at 500, 1000 and 2000 Hz: it breaks loose between two samples; motion of the probe assumed",
            ),
            Row(
                "Figure 8: friction as it begins to stick, over that in slip",
                "drops",
                _by_rate(drop, 2),
                "",
                "it grows again while the hand creeps, and changes sign with it",
            ),
            Row(
                "Figure 9: largest distance of probe and mass",
                "a figure",
                f"{_by_rate(play, 3)} mm",
                "",
                "0.2 kg, 600 N/m, 1 mm as printed, critical damping, velocity filtered at 70 Hz; 10 mm at "
                f"0.7 Hz assumed; half the gap and M a / K are {bend:.3f} mm",
            ),
            Row("Figure 9: walls that are hit in a period", "2", _by_rate(hits, 0), "none", "at 500, 1000 and 2000 Hz"),
            Row("Figure 10: processor time", "a chart without numbers", "see there", "", "another machine"),
        ),
    )
