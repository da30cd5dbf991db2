"""Sections 4, 5 and 7 of the paper on the PHANToM: electronics, velocity, frequency response, improvements."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from computed_torque import WAYS, follow
from paper_figures import PHANTOM_FITS, PHANTOM_RESONANCES

from papers.page import NOT_GIVEN, Row, Section, compared
from phantom_dyn.devices.phantom import PHANTOM_1_5, wrench_torque
from phantom_dyn.haptics.device.drives import (
    PUBLISHED_RISE_LINEAR,
    PUBLISHED_RISE_PULSES,
    Winding,
    duty_of_heat_ratio,
    switched_current,
)
from phantom_dyn.haptics.device.published import low_frequency_inertia, two_mass_of_fit
from phantom_dyn.haptics.device.transfer_function import TransferFunction
from phantom_dyn.haptics.sensing.encoder import PHANTOM_STEP, Encoder, SinusoidalEncoder
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings
from phantom_dyn.haptics.sensing.velocity_comparison import estimator_figures
from phantom_dyn.haptics.sensing.velocity_estimators import IMPROVED, STOCK, AveragedDifference
from phantom_dyn.haptics.stability.phantom_improvements import (
    Explained,
    Improvement,
    ModelFigure,
    explained_improvements,
    operational_masses,
    phantom_improvements,
)
from phantom_dyn.haptics.stability.virtual_wall import critical_wall

HZ = 2 * math.pi
CLOCK, COUNTS = 10e6, 2**16
MISPLACED = (0.05, -0.03, 0.02, -0.04)
"""Edges of a quadrature off their places, in steps: not given."""


def electronics() -> Section:
    quarter = switched_current(Winding(2.0), voltage=4.0, duty=0.25, frequency=20e3)
    duty = duty_of_heat_ratio(PUBLISHED_RISE_PULSES / PUBLISHED_RISE_LINEAR)
    downward = np.array([[0.0, -2.0, 0.0, 0.0, 0.0, 0.0]])
    held = abs(float(wrench_torque(np.zeros((1, 3)), downward)[0, 1])) / PHANTOM_1_5.gear_ratio
    return Section(
        "4.1.1 and 4.2.1 Motor drive electronics",
        "`phantom_dyn.haptics.device.drives`, `commutation` and `safety`; `drive_heat`, `brush_cogging` and "
        "`driver_safety` of `examples/haptics_gallery.py`",
        (
            compared("heat of pulses over a linear drive at 25 % duty", "4", quarter.ratio, "times"),
            Row(
                "section 5: rise of the casing, stock and linear",
                f"{PUBLISHED_RISE_PULSES} and {PUBLISHED_RISE_LINEAR} K",
                f"ratio {PUBLISHED_RISE_PULSES / PUBLISHED_RISE_LINEAR:.2f}: duty {100 * duty:.0f} %",
                "",
                "the duty cycle that the rises imply; none is given",
            ),
            Row(
                "section 5: torque of motor 2 that holds 2 N downward at the origin",
                NOT_GIVEN,
                f"{1e3 * held:.1f} mN m at the motor",
                "",
                f"{11.6 * held:.2f} N m at the joint, over a transmission of 11.6",
            ),
            Row("cogging of the stock amplifier", "felt", "see `brush_cogging`", "", "motor's constants are not given"),
        ),
    )


def velocity() -> Section:
    period = LoopSettings().period
    one = estimator_figures(AveragedDifference(), Encoder(), speed=0.1003, acceleration=0.1)
    stock, improved = (estimator_figures(each, Encoder(), speed=0.1003, acceleration=0.1) for each in (STOCK, IMPROVED))
    by_order = {
        order: estimator_figures(
            replace(IMPROVED, samples=order), Encoder(spacing=MISPLACED), speed=0.0303, acceleration=0.1
        ).granularity
        for order in (8, 12, 14, 16)
    }
    return Section(
        "4.1.2 and 4.2.2 Velocity estimation",
        "`phantom_dyn.haptics.sensing.velocity_comparison.estimator_figures`; `velocity_estimators` of "
        "`examples/haptics_gallery.py`",
        (
            compared("granularity at 1 kHz", "30", 1e3 * one.granularity, "mm/s"),
            compared("lag of 100 averaged differences", "50", 1e3 * stock.lag, "ms"),
            compared("phase that 50 ms add at 10 Hz", "180", 360 * 10 * 50e-3, "degrees"),
            Row(
                "period measurement, mean of 16: granularity",
                '"very little"',
                f"{1e3 * improved.granularity:.3g} mm/s",
                "",
                f"stock: {1e3 * stock.granularity:.3g} mm/s; at 100.3 mm/s",
            ),
            compared(
                "lag, stock over improved",
                "6",
                stock.lag / improved.lag,
                "times",
                reason=f"ours is {1e3 * improved.lag:.1f} ms late: 15/2 samples, and half the time between two edges",
            ),
            Row(
                "granularity with a mean of 8, 12 and 16",
                '"not adequately smooth" at 8 and 12',
                ", ".join(f"{1e3 * by_order[order]:.2f}" for order in (8, 12, 16)) + " mm/s",
                "",
                "edges of the quadrature misplaced by up to 5 % assumed, at 30.3 mm/s; the order is to be a multiple "
                f"of 4, but here 14 lies between its neighbours: {1e3 * by_order[14]:.2f} mm/s",
            ),
            Row(
                "slowest speed before a 16-bit counter at 10 MHz runs over",
                NOT_GIVEN,
                f"{1e3 * PHANTOM_STEP * CLOCK / COUNTS:.2f} mm/s",
                "",
                f"{PHANTOM_STEP * CLOCK / 0.1:.0f} ticks an edge at 100 mm/s; sampling period {1e3 * period:g} ms",
            ),
        ),
    )


def peaks(fit: TransferFunction) -> list[float]:
    """Frequencies [Hz] at which the response of a fit has a local maximum."""
    frequency = np.geomspace(10.0, 1000.0, 20001)
    size = np.abs(fit.response(HZ * frequency))
    inside = (size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])
    return frequency[1:-1][inside].tolist()


def resonance(roots: np.ndarray) -> str:
    """Frequencies [Hz] and damping ratios of roots that are not zero, one of each pair."""
    pairs = sorted(root for root in roots if root.imag > 1e-6)
    pairs = sorted(pairs, key=abs)
    return ", ".join(f"{abs(root) / HZ:.1f} Hz ({-root.real / abs(root):.3f})" for root in pairs)


def response() -> Section:
    rows: list[Row] = []
    for axis, fit in PHANTOM_FITS.items():
        (peak,) = peaks(fit)
        first, *others = PHANTOM_RESONANCES[axis]
        rows.append(
            compared(
                f"{axis}, resonance",
                first,
                peak,
                "Hz",
                reason="peak of the published fit"
                + ("; the fit contradicts the text" if axis == "x" else '; "approximately"' if axis == "z" else ""),
            )
        )
        rows += [
            Row(
                f"{axis}, resonance",
                f"{other} Hz",
                "none",
                "",
                "the published fit has one peak; the text calls this one "
                + ('"clearly visible"' if other == "125" else "smaller"),
            )
            for other in others
        ]
    for axis, fit in PHANTOM_FITS.items():
        rows.append(
            Row(
                f"4.3.2 {axis}: zeros; poles (damping ratios)",
                "coefficients of the fit",
                f"{resonance(fit.zeros)}; {resonance(fit.poles)}",
                "",
                "from the printed coefficients",
            )
        )
    fits = [low_frequency_inertia(fit) * 1e6 for fit in PHANTOM_FITS.values()]
    for axis, printed, model in zip(PHANTOM_FITS, fits, operational_masses(), strict=True):
        rows.append(
            compared(
                f"{axis}, mass at low frequency",
                f"{printed:.2f}",
                1e3 * model,
                "g",
                reason="published: the fit, in N and mm, its unit is not stated; ours: the dynamic model of section 3. "
                "No unit of force and position makes all three agree",
            )
        )
    for axis, fit in PHANTOM_FITS.items():
        reading = two_mass_of_fit(fit)
        dampings = ", ".join(f"{damping:.3g}" for damping in reading.dampings)
        rows.append(
            Row(
                f"4.3.1 {axis}: the damper b of the two-mass model",
                "one number",
                dampings,
                "",
                "the coefficients of the fit that hold b contradict each other (footnote 1: the fit has more freedom)",
            )
        )
    for axis, fit in PHANTOM_FITS.items():
        gain = critical_wall(fit, LoopSettings()).gain
        rows.append(
            Row(
                f"virtual wall on the fit of {axis}",
                "2.0 to 2.7 N/mm (y)" if axis == "y" else NOT_GIVEN,
                "stable for every wall" if math.isinf(gain) else "unstable for every wall",
                "",
                "the fits hold no damper to ground and no hand",
            )
        )
    return Section(
        "4.3 Frequency response, Figures 4 and 5",
        "`phantom_dyn.haptics.device.published`; Figure 4: `phantom_frequency_response` of `examples/paper_figures.py`",
        tuple(rows),
    )


def improvement(one: Improvement, explained: Explained) -> Row:
    """A published ratio, and what it takes to get it."""
    values = f" ({explained.before:.4g} to {explained.after:.4g} {explained.unit})" if explained.published else ""
    given = f" ({one.published[0]:g} to {one.published[1]:g} {one.unit})" if one.published else ""
    needs = " and ".join(f"{need.says} ({need.value:.3g} {need.unit})" for need in explained.assumptions)
    off = explained.ratio / one.published_ratio - 1
    return Row(
        one.quantity,
        f"{100 * (one.published_ratio - 1):+.0f} %{given}",
        f"{100 * (explained.ratio - 1):+.0f} %{values}",
        "none, under assumptions" if abs(off) < 0.005 else f"{100 * off:+.2g} %, under assumptions",
        f"assumed: {needs}. {one.needs}",
    )


def alone(model: ModelFigure) -> Row:
    """What a model of the paper gives without any assumption."""
    answer = not math.isnan(model.ratio)
    values = "" if "fit" in model.unit else f" ({model.before:.3g} to {model.after:.3g} {model.unit})"
    found = f"{100 * (model.ratio - 1):+.0f} %{values}" if answer else "no answer"
    return Row(f"nothing assumed: {model.model}", "", found, "", model.says)


def evaluation() -> Section:
    pairs = zip(phantom_improvements(), explained_improvements(), strict=True)
    return Section(
        "5 Experimental evaluation, and the abstract",
        "`phantom_dyn.haptics.stability.phantom_improvements` and `published_ratios`; `virtual_wall` and "
        "`teleoperation` of `examples/haptics_gallery.py`; "
        "[what the ratios need](../haptics.md#what-the-published-improvements-need)",
        tuple(row for one, explained in pairs for row in (improvement(one, explained), *map(alone, one.models))),
    )


def future() -> Section:
    encoder = estimator_figures(AveragedDifference(), Encoder(), speed=0.1003, acceleration=0.1)
    rows = []
    for factor in (16, 64):
        fine = estimator_figures(AveragedDifference(), SinusoidalEncoder(factor=factor), speed=0.1003, acceleration=0.1)
        rows.append(
            compared(
                f"sinusoidal encoder, factor {factor}: granularity of the velocity, better by",
                str(factor),
                encoder.granularity / fine.granularity,
                "times",
                reason="without errors of its signals, of which none are given",
            )
        )
    for words, sensing in WAYS.items():
        rows.append(
            Row(
                f"teleoperation by computed torque, {words}: error of the slave's tip",
                '"not feasible" without better sensors' if "stock" in words else "planned",
                f"{1e3 * follow(sensing).rms:.2f} mm rms",
                "",
                "simulated; motion, gains and sensors are assumed",
            )
        )
    return Section(
        "7 Future work",
        "`phantom_dyn.haptics.sensing`; `sinusoidal_encoder` of `examples/haptics_gallery.py`; teleoperation: "
        "`examples/computed_torque.py`",
        tuple(rows),
    )
