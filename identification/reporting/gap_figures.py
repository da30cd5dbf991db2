"""The figures of the report as inline SVG whose text and axes take the page's colour, so that dark pages work too."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from identification.diagnosis.result import Diagnosis, Evidence
from identification.reporting.explaining import JointMotion, Variable, explaining_variable, joint_of, strongest_variable
from identification.reporting.svg import AFTER, BEFORE, INK, STRETCH_S, Margins, draw_curve, draw_legend, drawn_svg
from identification.reporting.thinning import binned_median, eventful_stretch, scatter_choice

Array = np.ndarray

BEFORE_POINTS, AFTER_POINTS = "#eba36f", "#6fb1d8"
# Samples of which a median is drawn, each with the dashes of its line.
Groups = tuple[tuple[Bool[Array, " N"], str | tuple[int, tuple[float, ...]]], ...]

FEW_POINTS = 600  # fewer are drawn larger
FINER_FROM = 3.0  # ratio of residuals from which the corrected model's panel has a scale of its own


def torque_figure(diagnosis: Diagnosis, joint: int) -> str:
    """Torque measured and modelled over a stretch that shows something, and the residuals below it."""
    evidence, gap = diagnosis.evidence, diagnosis.joints[joint]
    rows = shown_stretch(evidence, joint)
    t = evidence.t[rows]

    def draw(figure: Figure) -> None:
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        draw_curve(top, t, evidence.tau_measured[rows, joint], INK, "measured", 1.8, 0.55)
        draw_curve(top, t, evidence.tau_before[rows, joint], BEFORE, "given model", 1.1)
        draw_curve(top, t, evidence.tau_after[rows, joint], AFTER, "corrected model", 1.1)
        draw_curve(bottom, t, residual(evidence.tau_before, evidence, joint)[rows], BEFORE, "", 0.9)
        draw_curve(bottom, t, residual(evidence.tau_after, evidence, joint)[rows], AFTER, "", 0.9)
        _noise_band(bottom, gap.noise_floor)
        top.set_ylabel(torque_label(diagnosis, joint))
        bottom.set_ylabel(f"residual [{gap.unit}]")
        bottom.set_xlabel("time [s]")
        draw_legend(figure, top)

    title = f"Measured and modelled torque of joint {gap.joint} over time"
    return drawn_svg(draw, f"torque{joint}", (11.5, 4.2), title, Margins(top=0.35, between=0.15))


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
    return _before_after(diagnosis, joint, Variable("velocity", unit, diagnosis.evidence.v[:, joint]), "velocity")


def residual_over_position(diagnosis: Diagnosis, joint: int) -> str:
    """Residual over the joint's own position, given model above, corrected model below, medians by direction.

    One median over both directions would jump between the two branches that friction makes.
    """
    unit = "m" if diagnosis.joints[joint].unit == "N" else "rad"
    q = diagnosis.evidence.q[:, joint]
    return _before_after(diagnosis, joint, Variable("position", unit, q, by_direction=True), "position")


def finding_figure(diagnosis: Diagnosis, motions: dict[str, JointMotion], index: int) -> str:
    """Residual over the variable that explains a finding: without it above, with everything that was found below."""
    evidence, finding = diagnosis.evidence, diagnosis.findings[index]
    row = joint_of(diagnosis, finding.joint)
    alone = bool(evidence.tau_without)
    before = residual(evidence.tau_without[index] if alone else evidence.tau_before, evidence, row)
    variable = explaining_variable(diagnosis, motions, finding, before)
    titles = ("without this finding", "with it") if alone else ("given model", "corrected model")
    after = residual(evidence.tau_after, evidence, row)
    return _residual_figure(diagnosis, row, variable, (before, after), titles, f"finding{index}")


def unexplained_figure(diagnosis: Diagnosis, motions: dict[str, JointMotion], joint: str) -> str:
    """Residual that no effect of the catalogue explains, over the variable that explains most of it."""
    evidence, row = diagnosis.evidence, joint_of(diagnosis, joint)
    after = residual(evidence.tau_after, evidence, row)
    variable = strongest_variable(diagnosis, motions, diagnosis.joints[row].joint, after)
    return _before_after(diagnosis, row, variable, "rest")


def residual(tau: Float[Array, "N nv"], evidence: Evidence, joint: int) -> Float[Array, " N"]:
    """Measured less modelled torque of one joint."""
    return evidence.tau_measured[:, joint] - tau[:, joint]


def _before_after(diagnosis: Diagnosis, joint: int, variable: Variable, key: str) -> str:
    evidence = diagnosis.evidence
    both = (residual(evidence.tau_before, evidence, joint), residual(evidence.tau_after, evidence, joint))
    return _residual_figure(diagnosis, joint, variable, both, ("given model", "corrected model"), key)


def _residual_figure(
    diagnosis: Diagnosis,
    joint: int,
    variable: Variable,
    residuals: tuple[Float[Array, " N"], Float[Array, " N"]],
    titles: tuple[str, str],
    key: str,
) -> str:
    gap, v = diagnosis.joints[joint], diagnosis.evidence.v[:, joint]
    within = np.isfinite(variable.x)
    if variable.reach:
        within &= np.abs(variable.x) <= variable.reach
    groups: Groups = ((v > 0, "-"), (v < 0, (0, (3, 1.5)))) if variable.by_direction else ((within, "-"),)
    reach = [max(_reach(values[within]), 3 * np.nan_to_num(gap.noise_floor)) for values in residuals]
    # What is left would be a flat line on the scale of a large gap.
    finer = reach[0] > FINER_FROM * reach[1]

    def draw(figure: Figure) -> None:
        panels = figure.subplots(2, 1, sharex=True, sharey=not finer)
        colours = ((BEFORE_POINTS, BEFORE), (AFTER_POINTS, AFTER))
        named = (titles[0], f"{titles[1]}, finer scale" if finer else titles[1])
        for axes, values, (points, line), title in zip(panels, residuals, colours, named, strict=True):
            _cloud(axes, np.where(within, variable.x, np.nan), values, groups, points, line)
            _noise_band(axes, gap.noise_floor)
            axes.set_ylabel(f"residual [{gap.unit}]")
            axes.set_title(f"{title}: samples and median", loc="left", fontsize=10.5)
        panels[1].set_xlabel(f"{variable.name} [{variable.unit}]")

    title = f"Residual of joint {gap.joint} over {variable.name}"
    return drawn_svg(draw, f"{key}-{joint}", (5.7, 4.2), title, Margins())


def _cloud(axes: Axes, x: Array, y: Array, groups: Groups, points: str, line: str) -> None:
    finite = np.isfinite(x) & np.isfinite(y)
    chosen = scatter_choice(finite)
    # Thousands of markers as vectors would weigh megabytes: the cloud is a picture, the median a curve.
    size = 3.0 if len(chosen) > FEW_POINTS else 9.0
    axes.scatter(x[chosen], y[chosen], s=size, color=points, linewidths=0, rasterized=True)
    for members, dashes in groups:
        inside = finite & members
        axes.plot(*binned_median(x[inside], y[inside]), color=line, linewidth=1.8, linestyle=dashes)


def _noise_band(axes: Axes, noise_floor: float) -> None:
    if np.isfinite(noise_floor):
        axes.axhspan(-2 * noise_floor, 2 * noise_floor, color="#808080", alpha=0.22, linewidth=0, zorder=0)
    axes.axhline(0.0, color=INK, linewidth=0.5, alpha=0.6)


def _reach(residual: Float[Array, " N"]) -> float:
    finite = residual[np.isfinite(residual)]
    return float(np.max(np.abs(finite))) if len(finite) else 0.0
