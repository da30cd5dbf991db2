"""The figures of the report as inline SVG whose text and axes take the page's colour, so that dark pages work too."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import Diagnosis
from identification.reporting.charts.chart import AFTER, BEFORE, STRETCH_S, Panel, chart
from identification.reporting.charts.chart_marks import INK, Cloud, Curve
from identification.reporting.charts.thinning import (
    binned_median,
    eventful_stretch,
    gap_starts,
    scatter_choice,
    thinned,
)
from identification.reporting.page.explaining import (
    JointMotion,
    Variable,
    explaining_variable,
    joint_of,
    strongest_variable,
)
from phantom_dyn.array_types import Array, Bool, Float

BEFORE_POINTS, AFTER_POINTS = "#eba36f", "#6fb1d8"
# Samples of which a median is drawn, each with the dashes of its line.
Groups = tuple[tuple[Bool[Array, " N"], str], ...]

_WINDOWS = 12  # of simulated motion that are seen at first, where they are short: each has to be seen
_SWINGS = 6  # the same of swings of a leg, with what lies between them
FEW_POINTS = 600  # fewer are drawn larger
FINER_FROM = 3.0  # ratio of residuals from which the corrected model's panel has a scale of its own


def torque_figure(diagnosis: Diagnosis, joint: int) -> str:
    """Torque measured and modelled over a stretch that shows something, and the residuals below it."""
    evidence, gap = diagnosis.evidence, diagnosis.joints[joint]
    rows = shown_stretch(evidence, joint)
    t = evidence.t[rows]

    tau = (
        _over_time(t, evidence.tau_measured[rows, joint], INK, 1.8, "measured", 0.55),
        _over_time(t, evidence.tau_before[rows, joint], BEFORE, 1.1, "given model"),
        _over_time(t, evidence.tau_after[rows, joint], AFTER, 1.1, "corrected model"),
    )
    left = [
        _over_time(t, residual(values, evidence, joint)[rows], colour, 0.9)
        for values, colour in ((evidence.tau_before, BEFORE), (evidence.tau_after, AFTER))
    ]
    top = Panel(torque_label(diagnosis, joint), tau, height=3.0)
    bottom = Panel(f"residual [{gap.unit}]", tuple(left), height=2.0, band=2 * gap.noise_floor, zero=True)
    title = f"Measured and modelled torque of joint {gap.joint} over time"
    return chart((top, bottom), "time [s]", (11.5, 4.2), title)


def position_figure(diagnosis: Diagnosis, joint: int) -> str:
    """Position measured, and simulated by both models from recorded states, and the errors of these below it."""
    evidence, followed = diagnosis.evidence, diagnosis.evidence.followed
    if followed is None:
        return ""
    rows = shown_motion(evidence, joint)
    t, read, given, corrected = (
        x[rows] for x in (evidence.t, evidence.q[:, joint], followed.before[:, joint], followed.after[:, joint])
    )
    places = (
        _over_time(t, read, INK, 1.8, "measured", 0.55),
        _over_time(t, given, BEFORE, 1.3, "given model"),
        _over_time(t, corrected, AFTER, 1.3, "corrected model"),
    )
    left = tuple(_over_time(t, read - q, colour, 1.1) for q, colour in ((given, BEFORE), (corrected, AFTER)))
    name, unit = diagnosis.joints[joint].joint, position_unit(diagnosis, joint)
    top = Panel(f"position [{unit}]", places, height=3.0)
    bottom = Panel(f"error [{unit}]", left, height=2.0, zero=True)
    return chart((top, bottom), "time [s]", (11.5, 4.2), f"Measured and simulated position of joint {name} over time")


def shown_motion(evidence: Evidence, joint: int) -> slice:
    """Rows of the stretch that is seen first: ten seconds, or a dozen windows, where the given model errs most."""
    followed = evidence.followed
    if followed is None:
        return slice(0, len(evidence.t))
    error = evidence.q[:, joint] - followed.before[:, joint]
    windows = _WINDOWS if evidence.touched is None else _SWINGS
    return eventful_stretch(evidence.t, error, min(STRETCH_S, windows * followed.seconds))


def position_unit(diagnosis: Diagnosis, joint: int) -> str:
    """Unit of a joint's position."""
    return "m" if diagnosis.joints[joint].unit == "N" else "rad"


def shown_stretch(evidence: Evidence, joint: int) -> slice:
    """Rows of the stretch of ten seconds whose residual of the given model is largest: what is seen first."""
    return eventful_stretch(evidence.t, residual(evidence.tau_before, evidence, joint), STRETCH_S)


def torque_label(diagnosis: Diagnosis, joint: int) -> str:
    """Label of an axis over which torque is drawn, force of a linear joint, position where it is judged at rest."""
    unit = diagnosis.joints[joint].unit
    return f"{'error' if diagnosis.at_rest else 'force' if unit == 'N' else 'torque'} [{unit}]"


def residual_over_velocity(diagnosis: Diagnosis, joint: int) -> str:
    """Residual over the joint's own velocity, given model above, corrected model below."""
    unit = "m/s" if diagnosis.joints[joint].unit == "N" else "rad/s"
    return _before_after(diagnosis, joint, Variable("velocity", unit, diagnosis.evidence.v[:, joint]))


def residual_over_position(diagnosis: Diagnosis, joint: int) -> str:
    """Residual over the joint's own position, given model above, corrected model below, medians by direction.

    One median over both directions would jump between the two branches that friction makes.
    """
    unit = position_unit(diagnosis, joint)
    q = diagnosis.evidence.q[:, joint]
    return _before_after(diagnosis, joint, Variable("position", unit, q, by_direction=True))


def finding_figure(diagnosis: Diagnosis, motions: dict[str, JointMotion], index: int) -> str:
    """Residual over the variable that explains a finding: without it above, with everything that was found below."""
    evidence, finding = diagnosis.evidence, diagnosis.findings[index]
    row = joint_of(diagnosis, finding.joint)
    alone = bool(evidence.tau_without)
    before = residual(evidence.tau_without[index] if alone else evidence.tau_before, evidence, row)
    variable = explaining_variable(diagnosis, motions, finding, before)
    titles = ("without this finding", "with it") if alone else ("given model", "corrected model")
    after = residual(evidence.tau_after, evidence, row)
    return _residual_figure(diagnosis, row, variable, (before, after), titles)


def unexplained_figure(diagnosis: Diagnosis, motions: dict[str, JointMotion], joint: str) -> str:
    """Residual that no effect of the catalogue explains, over the variable that explains most of it."""
    evidence, row = diagnosis.evidence, joint_of(diagnosis, joint)
    after = residual(evidence.tau_after, evidence, row)
    variable = strongest_variable(diagnosis, motions, diagnosis.joints[row].joint, after)
    return _before_after(diagnosis, row, variable)


def residual(tau: Float[Array, "N nv"], evidence: Evidence, joint: int) -> Float[Array, " N"]:
    """Measured less modelled torque of one joint, NaN where its row is not used."""
    return evidence.residual(tau)[:, joint]


def _before_after(diagnosis: Diagnosis, joint: int, variable: Variable) -> str:
    evidence = diagnosis.evidence
    both = (residual(evidence.tau_before, evidence, joint), residual(evidence.tau_after, evidence, joint))
    return _residual_figure(diagnosis, joint, variable, both, ("given model", "corrected model"))


def _residual_figure(
    diagnosis: Diagnosis,
    joint: int,
    variable: Variable,
    residuals: tuple[Float[Array, " N"], Float[Array, " N"]],
    titles: tuple[str, str],
) -> str:
    gap, v = diagnosis.joints[joint], diagnosis.evidence.v[:, joint]
    within = np.isfinite(variable.x)
    if variable.reach:
        within &= np.abs(variable.x) <= variable.reach
    groups: Groups = ((v > 0, ""), (v < 0, "5.4 2.7")) if variable.by_direction else ((within, ""),)
    reach = [max(_reach(values[within]), 3 * np.nan_to_num(gap.noise_floor)) for values in residuals]
    # What is left would be a flat line on the scale of a large gap.
    finer = reach[0] > FINER_FROM * reach[1]

    colours = ((BEFORE_POINTS, BEFORE), (AFTER_POINTS, AFTER))
    named = (titles[0], f"{titles[1]}, finer scale" if finer else titles[1])
    panels = [
        Panel(
            f"residual [{gap.unit}]",
            _medians(np.where(within, variable.x, np.nan), values, groups, line),
            _cloud(np.where(within, variable.x, np.nan), values, points),
            title=f"{words}: samples and median",
            band=2 * gap.noise_floor,
            zero=True,
        )
        for values, (points, line), words in zip(residuals, colours, named, strict=True)
    ]
    title = f"Residual of joint {gap.joint} over {variable.name}"
    return chart(tuple(panels), f"{variable.name} [{variable.unit}]", (5.7, 4.2), title, same_scale=not finer)


def _over_time(t: Array, y: Array, colour: str, width: float, label: str = "", opacity: float = 1.0) -> Curve:
    """A thinned curve over time; between recordings, and in their gaps, the line is interrupted."""
    # Before samples are left out: those that are kept are at uneven steps.
    begins = np.zeros(len(t), dtype=bool)
    begins[gap_starts(t)] = True
    # What has no number in between is two curves.
    begins[1:] |= np.isfinite(y[1:]) & ~np.isfinite(y[:-1])
    y = np.asarray(y, dtype=float)
    kept = np.flatnonzero(np.isfinite(y))
    chosen = kept[thinned(y[kept])]
    piece = np.cumsum(begins)[chosen]
    x, y = t[chosen], y[chosen]
    starts = np.flatnonzero(np.diff(piece)) + 1
    return Curve(np.insert(x, starts, np.nan), np.insert(y, starts, np.nan), colour, width, label, opacity)


def _cloud(x: Array, y: Array, colour: str) -> Cloud:
    chosen = scatter_choice(np.isfinite(x) & np.isfinite(y))
    return Cloud(x[chosen], y[chosen], colour, 1.8 if len(chosen) > FEW_POINTS else 3.0)


def _medians(x: Array, y: Array, groups: Groups, colour: str) -> tuple[Curve, ...]:
    finite = np.isfinite(x) & np.isfinite(y)
    inside = [(finite & members, dashes) for members, dashes in groups]
    return tuple(Curve(*binned_median(x[rows], y[rows]), colour, 1.8, dashes=dashes) for rows, dashes in inside)


def _reach(residual: Float[Array, " N"]) -> float:
    finite = residual[np.isfinite(residual)]
    return float(np.max(np.abs(finite))) if len(finite) else 0.0
