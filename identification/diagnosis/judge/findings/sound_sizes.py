"""Notes on findings with implausible sizes: a size outside its plausible range, or friction that drives the motion.

Such findings remain if nothing else explains as much, but the verdict is then not "explained".
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.diagnosis.columns.terms import ordered
from identification.diagnosis.judge.findings.gate_state import ShownEffects
from identification.diagnosis.result import Finding
from identification.diagnosis.search.plausible_sizes import implausible_size
from identification.diagnosis.search.refinement import found_effects
from identification.notes import Code, Note, Remark
from phantom_dyn.effects.effect import Effect

# Friction is tested at speeds above this share of the largest speed. Slower samples may follow a reversal, after which
# elastic friction returns energy.
_LEAST_SPEED_SHARE = 0.2
# Friction that drives the joint may be an error of the fit up to this share of all friction: that of the model plus
# that of each finding, each as a root of summed squares.
_DRIVING_SHARE = 0.1


def size_notes(shown: ShownEffects) -> list[Note]:
    """A note for each implausible size of a finding, and for each joint whose friction drives it."""
    session, out = shown.problem.session, list[Note]()
    for term in ordered(shown.named):
        own = shown.full_fit.slices_of(term).coefficients
        fault = implausible_size(session, term, shown.full_fit.coefficients(term), shown.full_fit.cov[own, own])
        if fault is not None and isinstance(term.effect, Effect):
            parameter, value = fault  # the parameter that is implausible
            low, high = parameter.plausible or (-np.inf, np.inf)
            numbers = {
                "effect": term.effect.name,
                "parameter": parameter.name,
                "value": float(value),
                "unit": parameter.unit,
                "because": parameter.plausible_because,
                "least": low if np.isfinite(low) else None,
                "most": high if np.isfinite(high) else None,
            }
            out.append(Note(Code.IMPLAUSIBLE_SIZE, term.joint, numbers))
    names = session.robot.joint_names
    return [*out, *(Note(Code.FRICTION_DRIVES, names[row]) for row in _driven_by_friction(shown))]


def all_plausible(findings: Iterable[Finding], notes: Iterable[Remark]) -> bool:
    """True if no finding has an implausible size, or is on a joint whose friction drives the motion.

    Args:
        findings: Findings that are not minor.
        notes: Notes on the sizes of all findings.
    """
    faults = [note for note in notes if isinstance(note, Note)]
    implausible = {(note.numbers["effect"], note.joint) for note in faults if note.code is Code.IMPLAUSIBLE_SIZE}
    driven = {note.joint for note in faults if note.code is Code.FRICTION_DRIVES}
    return not any((finding.effect, finding.joint) in implausible or finding.joint in driven for finding in findings)


def _driven_by_friction(shown: ShownEffects) -> list[int]:
    """Indices of the joints on which the friction of the model and of all findings together drives the motion."""
    effects = ((term, term.effect) for term in shown.named if isinstance(term.effect, Effect))
    friction = (term for term, effect in effects if effect.rubs or effect.changes_with == "friction")
    findings = found_effects(shown.named_fit, frozenset(friction))
    names = shown.problem.session.robot.joint_names
    # Sums of squares over all recordings: friction along the motion, and each part of the friction by itself.
    driving, separate = np.zeros(len(names)), np.zeros((len(names), 1 + len(findings)))
    for operation in shown.problem.columns.operations:
        parts = [operation.own_friction]
        for finding in findings:
            signature = finding.effect.signature(operation.robot, operation, finding.joint, finding.shape)
            torque = np.zeros_like(operation.v)
            torque[:, list(signature.rows)] = signature.columns @ finding.coefficients
            parts.append(torque)
        moving = np.abs(operation.v) > _LEAST_SPEED_SHARE * np.abs(operation.v).max(axis=0)
        against_motion = np.sum(parts, axis=0) * np.sign(operation.v) * moving
        driving += np.sum(np.minimum(against_motion, 0.0) ** 2, axis=0)
        separate += np.stack([np.sum((part * moving) ** 2, axis=0) for part in parts], axis=1)
    changed = {names.index(joint) for finding in findings if (joint := finding.joint) in names}
    return [row for row in sorted(changed) if np.sqrt(driving[row]) > _DRIVING_SHARE * np.sqrt(separate[row]).sum()]
