"""The report: one self-contained page that says what differs between robot and model, how sure, and what to do."""

from __future__ import annotations

from importlib.resources import files

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from identification.diagnosis import words
from identification.diagnosis.effect_words import REGIMES, effect_words, regime_words
from identification.diagnosis.figures import gap_bars, residual_over_position, residual_over_velocity, torque_figure
from identification.diagnosis.result import Bound, Diagnosis, Finding, JointGap, NotTestable

Row = tuple[str, ...]

VERDICTS = {
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "unknown": "Unknown cause",
    "no_gap": "No gap",
    "not_testable": "Not testable",
}


def report_html(diagnosis: Diagnosis) -> str:
    """The whole page as text; everything it shows is inside it, and every name is escaped."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    source = files("identification.diagnosis").joinpath("report.html.jinja").read_text(encoding="utf-8")
    has_samples = len(diagnosis.evidence.t) > 1
    return environment.from_string(source).render(
        diagnosis=diagnosis,
        badge=VERDICTS.get(diagnosis.verdict, diagnosis.verdict.replace("_", " ")),
        verdict=words.verdict_sentence(diagnosis),
        findings=[(words.finding_words(f), words.capital(words.finding_name(f))) for f in diagnosis.findings],
        say=(diagnosis.next_experiment or {}).get("say"),
        parameters=parameter_rows(diagnosis.findings),
        gaps=[gap_row(joint) for joint in diagnosis.joints],
        gap_figure=Markup(gap_bars(diagnosis.joints)),
        joint_figures=[joint_figures(diagnosis, k) for k in range(len(diagnosis.joints))] if has_samples else [],
        regimes=regime_rows(diagnosis),
        rollout=rollout_rows(diagnosis),
        adjusted=[(a.quantity, f"{100 * a.change:+.2g} %", f"±{100 * a.tolerance:.2g} %") for a in diagnosis.adjusted],
        rest=words.capital(words.rest_phrase(diagnosis.unexplained)),
        bounds=[bound_row(bound) for bound in diagnosis.bounds],
        not_testable=[not_testable_row(entry) for entry in diagnosis.not_testable],
        band=f"{diagnosis.band_hz[0]:g} to {diagnosis.band_hz[1]:.3g} Hz",
        seconds=f"{diagnosis.seconds:.1f}",
    )


def parameter_rows(findings: tuple[Finding, ...]) -> list[Row]:
    """Finding, parameter, and value with its standard deviation and unit."""
    return [
        (words.capital(words.effect_at_finding(finding)), words.parameter_name(name), words.value_words(value))
        for finding in findings
        for name, value in finding.parameters.items()
    ]


def gap_row(joint: JointGap) -> Row:
    """Joint, residual before and after, noise floor, unit, samples."""
    numbers = (joint.rms_before, joint.rms_after, joint.noise_floor)
    return (joint.joint, *(words.number(value) for value in numbers), joint.unit, str(joint.hold_out_samples))


def joint_figures(diagnosis: Diagnosis, joint: int) -> tuple[str, Markup, Markup, Markup]:
    """Name of a joint with its three figures."""
    return (
        diagnosis.joints[joint].joint,
        Markup(torque_figure(diagnosis, joint)),
        Markup(residual_over_velocity(diagnosis, joint)),
        Markup(residual_over_position(diagnosis, joint)),
    )


def regime_rows(diagnosis: Diagnosis) -> list[tuple[str, list[tuple[str, bool]]]]:
    """For each regime that occurs its words and the share of each joint, with whether that share stands out."""
    shares = diagnosis.evidence.regime_shares
    known = [regime for regime in REGIMES if any(regime in joint for joint in shares)]
    others = sorted({regime for joint in shares for regime in joint} - set(known))
    rows = []
    for regime in known + others:
        values = [joint.get(regime, float("nan")) for joint in shares]
        rows.append((words.capital(regime_words(regime)), [(words.percent(v), v >= 0.25) for v in values]))
    return rows


def rollout_rows(diagnosis: Diagnosis) -> list[Row]:
    """Joint with the error of a simulated motion before and after; empty without a rollout."""
    rollout = diagnosis.rollout or {}
    before, after = rollout.get("rms_before") or {}, rollout.get("rms_after") or {}
    units = {joint.joint: "m" if joint.unit == "N" else "rad" for joint in diagnosis.joints}
    return [
        (joint, _number(value), _number(after.get(joint)), units.get(joint, "rad")) for joint, value in before.items()
    ]


def bound_row(bound: Bound) -> Row:
    """Effect, place, parameter and the size from which it would have been seen."""
    effect = words.capital(effect_words(bound.effect).name)
    size = words.with_unit(words.number(bound.below), bound.unit)
    return (effect, words.place(bound.effect, bound.joint), words.parameter_name(bound.parameter), size)


def not_testable_row(entry: NotTestable) -> Row:
    """Effect, place and reason."""
    return (words.capital(effect_words(entry.effect).name), words.place(entry.effect, entry.joint), entry.why)


def _number(value: object) -> str:
    return words.number(float(value)) if isinstance(value, int | float) else "–"
