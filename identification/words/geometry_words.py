"""Sentences on errors of a robot's geometry that measured poses show."""

from __future__ import annotations

from typing import TYPE_CHECKING

from identification.diagnosis.result import Diagnosis, EffectAt, Finding, Rival, Value
from identification.geometry.terms import BASE_POSE, ELASTIC, LINK, PLACES, TOOL_POSE, ZERO
from identification.words.diagnosis_words import capital, certainty_words, finding_share, joined, share_of_gap_words
from identification.words.note_words import sentences as note_sentences
from identification.words.numbers_and_names import NO_BREAK, number, value_words
from identification.words.verdict_words import headline

if TYPE_CHECKING:
    from identification.geometry.result import FrameGap, GeometryResult, Number, Place, PoseFinding

_SHIFTS = ("x", "y", "z")
_SMALL = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}
EFFECTS = {
    ZERO: "a zero error",
    LINK: "a wrong place",
    ELASTIC: "elasticity",
    BASE_POSE: "a wrong pose",
    TOOL_POSE: "a wrong pose",
}


def verdict_sentences(diagnosis: Diagnosis) -> str:
    """The verdict in a few sentences: on the torques if there are any, then on the poses if there are any."""
    torques = [] if diagnosis.poses_alone else [headline(diagnosis.with_torque_verdict)]
    return " ".join([*torques, *([] if diagnosis.geometry is None else geometry_sentences(diagnosis.geometry))])


def all_findings(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """Findings from torques, then findings from poses."""
    return (*diagnosis.findings, *(() if diagnosis.geometry is None else map(_as_finding, diagnosis.geometry.findings)))


def _as_finding(one: PoseFinding) -> Finding:
    """A finding from poses in the form of a finding from torques."""
    return Finding(
        effect=one.effect,
        joint=one.joint,
        regime="high_load" if one.effect == ELASTIC else "posture",
        parameters={name: Value(x.value, x.std, x.unit) for name, x in one.parameters.items()},
        gap_closed=one.gap_closed,
        gap_closed_interval=one.gap_closed_interval,
        probability=one.probability,
        rivals=tuple(
            Rival(tuple(EffectAt(place.effect, place.joint) for place in rival.places), rival.probability)
            for rival in one.rivals
        ),
        verdict=one.verdict,
        share=one.share,
    )


def small_words(value: float, unit: str) -> str:
    """A length in mm or an angle in mrad; any other quantity in its own unit."""
    factor, name = _SMALL.get(unit, (1.0, unit))
    return f"{number(factor * value)} {name}"


def number_words(one: Number) -> str:
    """A number with its standard deviation, lengths in mm and angles in mrad."""
    factor, name = _SMALL.get(one.unit, (1.0, one.unit))
    return value_words(Value(factor * one.value, factor * one.std, name))


def finding_at(finding: PoseFinding) -> str:
    """Effect, joint and sizes, as in ``a zero error of j2 of 2.0 ± 0.1 mrad``."""
    at = f"{EFFECTS[finding.effect]} of {place_of(finding.effect, finding.joint)}"
    if finding.effect == ELASTIC:
        return f"{at} ({finding_sizes(finding)})"
    return f"{at}{', by' if finding.effect in PLACES else ' of'} {finding_sizes(finding)}"


def place_of(effect: str, joint: str | None) -> str:
    """Place of an effect: a joint, the base, or the target on a frame."""
    if effect == TOOL_POSE:
        return f"the target on {joint}"
    return "the base" if joint is None else joint


def finding_sizes(finding: PoseFinding) -> str:
    """Sizes of a finding: the stiffness of an elasticity, the components of a wrong place, or the offset of a zero."""
    if finding.effect == ELASTIC:
        compliance = finding.parameters["compliance"]
        unit = _stiffness_unit(compliance.unit)
        stiffness = Value(1.0 / compliance.value, compliance.std / compliance.value**2, unit)
        return f"stiffness {value_words(stiffness)}"
    if finding.effect in PLACES:
        return joined([f"{number_words(one)} {_along(name)}" for name, one in finding.parameters.items()])
    return number_words(finding.parameters["offset"])


def _stiffness_unit(compliance: str) -> str:
    """Unit of a stiffness from that of a compliance, such as ``N m/rad`` from ``rad/(N m)``."""
    above, _, below = compliance.partition("/")
    return f"{below.strip('()')}/{above}"


def _along(name: str) -> str:
    """``along x`` for a shift ``x``, ``about x`` for a rotation ``rx``."""
    return f"along {name}" if name in _SHIFTS else f"about {name[1:]}"


def place_words(place: Place) -> str:
    """Effect and joint of a rival, with axes if it is a wrong place."""
    at = f"{EFFECTS[place.effect]} of {place_of(place.effect, place.joint)}"
    if place.effect not in PLACES:
        return at
    return f"{at} {joined([_along(name) for name in place.parameters])}"


def geometry_sentences(found: GeometryResult) -> list[str]:
    """Sentences on the errors of the measured frames, their causes, and the errors that remain."""
    return [_gap_sentence(found), *_cause_sentences(found), *_delay_sentences(found), *note_sentences(found.notes)]


def _gap_sentence(found: GeometryResult) -> str:
    """Distance of the measured frames from their poses in the given model."""
    said: list[str] = []
    for frame in found.frames:
        size = f"{small_words(frame.rms_before, frame.unit)} (rms)"
        said.append(f"{frame.frame} is off by {size}" if frame.unit == "m" else f"turned by {size}")
    fitted = {one.what for one in found.fitted}
    poses = "the poses of base and target are" if "base" in fitted else "the pose of the target is"
    condition = f"once {poses} fitted" if fitted else "in the robot's root frame"
    return f"Measured poses: {joined(said)} {condition}."


def _cause_sentences(found: GeometryResult) -> list[str]:
    """The findings and their rivals, and the error that remains with them."""
    if not found.findings:
        return [_why_no_finding(found)]
    largest = found.findings[0]
    out = [f"{capital(finding_at(largest))} explains {share_of_gap_words(largest, 'the error')}{_rivals(largest)}."]
    if len(found.findings) > 1:
        others = [f"{finding_at(one)} ({finding_share(one)}{_rivals(one)})" for one in found.findings[1:]]
        out.append(f"Besides, {joined(others)}.")
    remaining_errors = [f"{small_words(f.rms_after, f.unit)} of a noise of {_floor(f)}" for f in found.frames]
    more = {
        "explained": "",
        "partly_explained": "; part of it is still unexplained",
        "unknown": "; it depends on the posture in a way that no zero, place or elasticity explains",
    }
    subject = "it" if len(found.findings) == 1 else "them"
    return [*out, f"With {subject}, {joined(remaining_errors)} is left{more[found.verdict]}."]


def _floor(frame: FrameGap) -> str:
    """Noise floor of a frame; ``at most`` if it is only an upper limit, from predictors of the residual."""
    limit = "at most " if frame.noise_floor_source == "predictors" else ""
    return f"{limit}{small_words(frame.noise_floor, frame.unit)}"


def _why_no_finding(found: GeometryResult) -> str:
    """Why the poses gave no finding."""
    if found.verdict == "no_gap":
        noise = joined([_floor(frame) for frame in found.frames])
        return (
            f"That is the noise of the measurement ({noise}): the model's geometry and stiffness are right within it."
        )
    if found.verdict == "not_testable":
        return "These poses cannot show an error of the geometry: measure more postures, with all joints in motion."
    if found.structured:
        return "What is left depends on the posture, and no zero, place or elasticity of a joint explains it."
    return "Many joints together explain part of it, but no few of them do: measure more poses."


def _rivals(finding: PoseFinding) -> str:
    """Other explanations that these poses cannot separate from a finding."""
    if not finding.rivals:
        return ""
    others = [joined([place_words(place) for place in rival.places]) for rival in finding.rivals]
    named = others[:2] + ([f"{len(others) - 2} more"] if len(others) > 2 else [])
    return f", {certainty_words(finding.probability)}; these poses do not separate it from {' or '.join(named)}"


def _delay_sentences(found: GeometryResult) -> list[str]:
    """Sentences on files whose poses are delayed by more than three standard deviations."""
    late_files = [late for late in found.delays if abs(late.delay) > 3 * late.std]
    return [
        f"In {late.file} poses are stamped {1e3 * abs(late.delay):.3g}{NO_BREAK}ms "
        f"{'later' if late.delay > 0 else 'earlier'} than joint positions; this was corrected."
        for late in late_files
    ]
