"""Writes the report of a diagnosis as one self-contained HTML page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import Diagnosis, Finding
from identification.export.file_names import MJCF, URDF, YAML
from identification.notes import Note, Remark
from identification.reporting.page.explaining import JointMotion, joint_motions, joint_of
from identification.reporting.page.first_screen import gap_bars_of, groups_of, share_curve
from identification.reporting.page.gap_figures import (
    finding_figure,
    position_figure,
    residual_over_position,
    residual_over_velocity,
    time_curves,
    torque_figure,
    unexplained_figure,
)
from identification.reporting.page.geometry_section import poses_view
from identification.reporting.page.law_section import law_view
from identification.reporting.page.report_tables import (
    detectable_sizes,
    gap_row,
    parameter_rows,
    regime_table,
    rollout_rows,
    untestable_rows,
)
from identification.reporting.page.robot_scene import joint_colours, robot_scene, shares_of
from identification.words import diagnosis_words as words
from identification.words.ledger_words import nearest_claims
from identification.words.note_words import sentences
from identification.words.notes_on_motion import simulated_motion_words
from identification.words.numbers_and_names import percent_short_of_all
from identification.words.verdict_words import (
    closed_by_tolerances,
    headline,
    hidden_words,
    reservations,
    residual_phrase,
    short_headline,
)
from phantom_dyn.model.robot import Robot

VERDICTS = {
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "unknown": "Unknown cause",
    "no_gap": "No gap",
    "not_testable": "Not testable",
}
# Figures take time and space. If a robot has many joints, only those with the largest gap are drawn.
_FIGURES = 20  # largest number of findings with a figure
_CURVES = 12  # largest number of joints that are drawn over time
_CLOUDS = 6  # largest number of joints whose residual is drawn over velocity and position
_LEAST_SHARE = 0.02  # a joint's residual is drawn over velocity and position from this share of the gap
_OPEN_JOINTS = 2  # number of joints whose figures are unfolded: those with the largest gap

View = dict[str, Any]
"""Values for one part of the page, by their names in the template."""


def report_html(diagnosis: Diagnosis, robot: Robot | None = None, *, linked_files: tuple[str, ...] = ()) -> str:
    """The whole page as text. Names of joints, files and effects are escaped.

    Args:
        diagnosis: The diagnosis.
        robot: If given, the robot is drawn in three dimensions.
        linked_files: Names of files in the folder of the page to which the page has links.
    """
    from jinja2 import Environment, StrictUndefined

    poses = None if diagnosis.geometry is None else poses_view(diagnosis.geometry)
    badge = VERDICTS.get(diagnosis.verdict, diagnosis.verdict.replace("_", " "))
    diagnosis = diagnosis.with_torque_verdict
    diagnosis = replace(diagnosis, evidence=diagnosis.evidence.drawn)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    source = Path(__file__).with_name("diagnosis_report.html.jinja").read_text(encoding="utf-8")
    has_samples = len(diagnosis.evidence.t) > 1
    bars, more_joints = gap_bars_of(diagnosis)
    views = _joint_views(diagnosis) if has_samples else []
    motions = joint_motions(robot, diagnosis) if has_samples else {}
    return environment.from_string(source).render(
        diagnosis=diagnosis,
        poses=poses,
        badge=badge,
        verdict=" ".join(poses["sentences"]) if poses and diagnosis.poses_alone else short_headline(diagnosis),
        reservations="" if diagnosis.poses_alone else " ".join(_details(diagnosis)),
        bars=bars,
        more_joints=more_joints,
        groups=groups_of(diagnosis),
        curve=Markup(share_curve(diagnosis)),
        cards=[_card(diagnosis, motions, index) for index in range(len(diagnosis.findings))],
        warnings=sentences(diagnosis.data_warnings),
        notes=sentences(note for note in diagnosis.notes if not _on_model_files(note)),
        file_notes=sentences(note for note in diagnosis.notes if _on_model_files(note)),
        proposal=(diagnosis.next_experiment or {}).get("say"),
        scene=None if robot is None or diagnosis.poses_alone else _scene(robot, diagnosis),
        gaps=[gap_row(joint, len(diagnosis.evidence.t)) for joint in diagnosis.joints],
        command=diagnosis.command,
        linked_files=linked_files,
        joints=views,
        motions=_motion_views(diagnosis) if has_samples else [],
        motion_words=_simulated_motion_words(diagnosis.evidence),
        curves=_curves(diagnosis, [k for k, view in enumerate(views) if view["torque"]]),
        has_times=bool(diagnosis.evidence.regime_times),
        rollout=rollout_rows(diagnosis),
        closed=_closed(diagnosis),
        minor=words.joined([words.placed_finding(finding) for finding in diagnosis.minor]),
        adjusted=[
            (
                a.quantity,
                f"{100 * a.change:+.2g} %",
                f"±{100 * a.tolerance:.2g} %",
                f"at its limit: {hidden_words(a)}" if a.at_limit else "",
            )
            for a in diagnosis.adjusted
        ],
        unexplained=words.capital(residual_phrase(diagnosis)),
        unexplained_figure=_unexplained_figure(diagnosis, motions),
        law=law_view(diagnosis.unexplained),
        nearest=nearest_claims(diagnosis),
        bounds=detectable_sizes(diagnosis.bounds),
        not_testable=untestable_rows(diagnosis.not_testable, diagnosis.joints),
        band="at rest" if diagnosis.at_rest else f"{diagnosis.band_hz[0]:g} to {diagnosis.band_hz[1]:.3g} Hz",
        residual="position less reference" if diagnosis.at_rest else "measured less modelled torque",
        seconds=f"{diagnosis.seconds:.1f}",
    )


def _details(diagnosis: Diagnosis) -> list[str]:
    """Sentences that the short headline leaves out."""
    whole = headline(diagnosis)
    return [*([] if whole == short_headline(diagnosis) else [whole]), *reservations(diagnosis)]


def _on_model_files(remark: Remark) -> bool:
    """True for notes on the files of the corrected model, which have their own section."""
    return isinstance(remark, Note) and bool({YAML, URDF, MJCF} & set(remark.files))


def _closed(diagnosis: Diagnosis) -> str:
    """Sentence on the part of the gap that all findings close together; empty without a gap."""
    gap = diagnosis.gap
    if gap.closed is None or gap.interval is None:
        return ""
    by_tolerances = closed_by_tolerances(diagnosis)
    share = words.share_words(gap.closed, gap.interval)
    if by_tolerances is None:
        return f"All findings together close {share} of the gap."
    return (
        f"The findings close {percent_short_of_all(gap.closed - by_tolerances)} of the gap, and changes within the "
        f"tolerances {percent_short_of_all(by_tolerances)}: {share} together."
    )


def _card(diagnosis: Diagnosis, motions: dict[str, JointMotion], index: int) -> View:
    """Values for one finding: name, share of the gap, sentences, sizes, and figure (empty without samples)."""
    finding = diagnosis.findings[index]
    return {
        "name": _title(finding),
        "share": words.share_of_gap_words(finding),
        "sentence": words.finding_words(finding, diagnosis.next_experiment),
        "sizes": parameter_rows(finding),
        "figure": Markup(finding_figure(diagnosis, motions, index) if motions and index < _FIGURES else ""),
    }


def _title(finding: Finding) -> str:
    where = "" if finding.joint is None else f" {words.on_place(finding.effect, finding.joint)}"
    return words.capital(words.finding_name(finding)) + where


def _joint_views(diagnosis: Diagnosis) -> list[View]:
    """Values for each joint: share of the gap, figures over time, velocity and position, and regimes.

    ``has_gap`` is False for a joint whose residual shows noise and tolerances only.
    """
    shares = shares_of(diagnosis)
    ranked = np.argsort(-shares, kind="stable").tolist()
    named = {joint_of(diagnosis, finding.joint) for finding in diagnosis.findings[:_FIGURES]}
    drawn = [k for k in ranked if shares[k] > _LEAST_SHARE or k in named or k in ranked[:_OPEN_JOINTS]][:_CLOUDS]
    return [
        {
            "name": gap.joint,
            "share": percent_short_of_all(float(shares[k])) if shares.any() else "",
            "torque": Markup(torque_figure(diagnosis, k) if k in ranked[:_CURVES] else ""),
            "clouds": [Markup(f(diagnosis, k)) for f in (residual_over_velocity, residual_over_position) if k in drawn],
            "regimes": regime_table(diagnosis, k) if shares.any() else [],
            "unfolded": k == ranked[0] or (k in ranked[:_OPEN_JOINTS] and shares[k] > _LEAST_SHARE),
            "has_gap": bool(shares[k] > _LEAST_SHARE or k == ranked[0]),
        }
        for k, gap in enumerate(diagnosis.joints)
    ]


def _motion_views(diagnosis: Diagnosis) -> list[View]:
    """Values for each joint whose simulated motion is drawn, beginning with the largest gap."""
    if diagnosis.evidence.simulated is None:
        return []
    ranked = np.argsort(-shares_of(diagnosis), kind="stable").tolist()[:_CURVES]
    return [
        {
            "name": diagnosis.joints[k].joint,
            "number": k,
            "position": Markup(position_figure(diagnosis, k)),
            "unfolded": k == ranked[0],
        }
        for k in ranked
    ]


def _simulated_motion_words(evidence: Evidence) -> str:
    simulated = evidence.simulated
    return "" if simulated is None else simulated_motion_words(simulated, on_base=evidence.touched is not None)


def _curves(diagnosis: Diagnosis, joints: list[int]) -> View | None:
    """The script that draws torque over time, and its samples as JSON; None without joints."""
    if not joints:
        return None
    return {"script": _script("curve_viewer.js"), "figure": _inside_script(time_curves(diagnosis, joints))}


def _unexplained_figure(diagnosis: Diagnosis, motions: dict[str, JointMotion]) -> Markup:
    unexplained = diagnosis.unexplained
    if not motions or not unexplained.structured or unexplained.joint is None:
        return Markup("")
    return Markup(unexplained_figure(diagnosis, motions, unexplained.joint))


def _scene(robot: Robot, diagnosis: Diagnosis) -> View:
    """Values for the robot in three dimensions: script, solids as JSON, and a legend of joints.

    The legend has name, share of the gap and colour of each joint.
    """
    scene = robot_scene(robot, diagnosis)
    shares = shares_of(diagnosis)
    return {
        "script": _script("robot_viewer.js"),
        "figure": _inside_script(scene.figure),
        "legend": [
            (gap.joint, percent_short_of_all(float(share)) if shares.any() else "", colour)
            for gap, share, colour in zip(diagnosis.joints, shares, joint_colours(shares), strict=True)
        ],
        "from_meshes": scene.from_meshes,
        "has_gap": bool(shares.any()),
        "is_testable": diagnosis.verdict != "not_testable",
    }


def _script(name: str) -> Markup:
    return Markup(Path(__file__).with_name(name).read_text(encoding="utf-8"))


def _inside_script(json_text: str) -> Markup:
    """JSON with escaped characters, so that no name can end the script element."""
    return Markup(json_text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029"))
