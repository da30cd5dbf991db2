"""Removes claims that recordings without a measured torque cannot support.

In such recordings the torque is computed from the position error and the gains of the controller. So a wrong torque
constant has the same effect as a wrong gain, and a torque offset the same as another zero of the reference.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import compress

import numpy as np

from identification.data.recording import Recording
from identification.diagnosis.result import Adjusted, EffectAt, Finding, Judgement, NotTestable
from identification.engine.claims import Claim, GateResult, Outcome
from identification.gates import controller_gain as gate
from identification.notes import Code, Note
from identification.rollout.compare import Rollout
from phantom_dyn.model.robot import Robot

# A position error in the simulation under the controllers is noted if it exceeds this many standard deviations of the
# position readings.
_LARGE_ERROR = 10.0
_ONLY_PRODUCT = (
    "positions determine only the product of torque constant and controller gain: measure the current or torque, or "
    "attach a known mass to the robot"
)
_DAMPING = (
    "the gain kd of its controller was estimated from the same positions and includes it: state the controller in "
    "robot.yaml, or measure the current or torque"
)
_LOAD = (
    "the gain of its controller was estimated from the masses of the model, and a load that changes weight and inertia "
    "of a joint alike makes it higher: state the controller in robot.yaml, or measure the current or torque"
)


def without_gain_ambiguities(
    judgement: Judgement, recordings: tuple[Recording, ...], rollout: Rollout, robot: Robot
) -> Judgement:
    """The judgement without claims that an error of a controller's gain would explain as well.

    - Torque constant. If the gain is stated and the ratio differs from 1 by more than two tolerances of the gain, the
      finding remains, with a warning that only the product of constant and gain is known. Any other ratio is listed as
      adjusted. Joints without a finding are listed as not testable.
    - Torque offset. The finding remains, with a note on the zero of the reference that would explain it.
    - If the gain was estimated from the same positions, loads that scale weight and inertia alike, and viscous friction
      up to the damping gain, are not testable on the joint either.

    Args:
        judgement: Judgement of the torque that controllers command.
        recordings: Recordings of the judgement. If a torque was measured, the judgement is returned unchanged.
        rollout: Motion simulated under the controllers.
        robot: The robot with the gains of its controllers, including estimated ones.
    """
    if not any(recording.controlled for recording in recordings):
        return judgement
    estimated = {joint for recording in recordings for joint in recording.gains_estimated}
    results = _gate_results(judgement.findings, estimated, robot)
    removed = {effect_joint for effect_joint, result in results.items() if not result.passed}
    remains = [_effect_joint(finding) not in removed for finding in judgement.findings]
    findings = tuple(compress(judgement.findings, remains))
    found = {_effect_joint(finding) for finding in findings}
    hidden_by_gains = _hidden_by_gains(judgement, estimated)
    hidden = {(entry.effect, entry.joint) for entry in hidden_by_gains}

    def is_hidden(effect: str, joint: str | None) -> bool:
        """True if errors of gains hide an effect, so that bounds and reasons of the judgement do not apply to it."""
        return effect == "torque_constant" or (effect, joint) in hidden

    not_testable_otherwise = tuple(one for one in judgement.not_testable if not is_hidden(one.effect, one.joint))
    untestable = tuple(entry for entry in hidden_by_gains if (entry.effect, entry.joint) not in found)
    ratios = [finding for finding in judgement.findings if finding.effect == "torque_constant"]
    within_gain_tolerance = tuple(
        Adjusted(f"{one.joint} torque constant times controller gain", _excess(one), gate.GAIN_TOLERANCE)
        for one in ratios
        if _effect_joint(one) in removed
    )
    warned = tuple(
        Note(Code.GAIN_OR_CONSTANT, one.joint, {"ratio": 1.0 + _excess(one)})
        for one in ratios
        if _effect_joint(one) not in removed
    )
    warned += _zero_notes(findings, robot)
    shown = tuple(compress(judgement.evidence.tau_without, remains))
    verdict = "no_gap" if not findings and judgement.verdict == "explained" else judgement.verdict
    return replace(
        judgement,
        findings=findings,
        verdict=verdict,
        adjusted=(*judgement.adjusted, *within_gain_tolerance),
        bounds=tuple(bound for bound in judgement.bounds if not is_hidden(bound.effect, bound.joint)),
        not_testable=(*not_testable_otherwise, *untestable),
        warnings=(*judgement.warnings, *warned),
        evidence=replace(judgement.evidence, tau_without=shown),
        notes=(*judgement.notes, *(_stray_notes(judgement, rollout, robot) if verdict == "no_gap" else ())),
        ledger=tuple(_with_gain_gate(claim, results) for claim in judgement.ledger),
    )


def _effect_joint(finding: Finding) -> tuple[str, str | None]:
    """Effect and joint of a finding."""
    return finding.effect, finding.joint


def _gate_results(
    findings: tuple[Finding, ...], estimated: set[str], robot: Robot
) -> dict[tuple[str, str | None], GateResult]:
    """Result of the gate `beyond_the_gain` for each finding that an error of a gain might explain."""
    out = {}
    for finding in findings:
        if finding.effect == "torque_constant":
            out[_effect_joint(finding)] = gate.beyond_the_gain(_excess(finding), stated=finding.joint not in estimated)
        # An estimated kd includes the viscous friction of the joint, so it may be too large by this friction.
        friction = finding.effect == "viscous_friction" and finding.joint in estimated
        if friction and _explained_by_damping_gain(finding, robot):
            out[_effect_joint(finding)] = gate.beyond_the_gain(_friction_over_damping(finding, robot), stated=False)
    return out


def _hidden_by_gains(judgement: Judgement, estimated: set[str]) -> list[NotTestable]:
    """Effects that gains hide: torque constants always, others if the gain was estimated from the same positions."""
    out = [NotTestable("torque_constant", gap.joint, _ONLY_PRODUCT) for gap in judgement.joints]
    joints = [gap.joint for gap in judgement.joints if gap.joint in estimated]
    out += [NotTestable("viscous_friction", joint, _DAMPING) for joint in joints]
    out += [NotTestable("inertial_parameters", joint, _LOAD) for joint in joints]
    if estimated:
        out.append(NotTestable("payload", None, _LOAD))
    return out


def _with_gain_gate(claim: Claim[EffectAt], results: Mapping[tuple[str, str | None], GateResult]) -> Claim[EffectAt]:
    """An entry of the ledger, with the result of the gate `beyond_the_gain` if its effect was a finding."""
    result = results.get((claim.effects[0].effect, claim.effects[0].joint))
    if result is None or claim.outcome != "claimed":
        return claim
    outcome: Outcome = "claimed" if result.passed else "not_claimed"
    return replace(claim, gates=(*claim.gates, result), outcome=outcome)


def _zero_notes(findings: tuple[Finding, ...], robot: Robot) -> tuple[Note, ...]:
    """A note for each torque offset with the zero of the reference that makes the same torque."""
    out = []
    for finding in findings:
        if finding.effect != "torque_offset" or finding.joint is None:
            continue
        row = robot.joint_names.index(finding.joint)
        controller = robot.actuators[row].controller
        if controller is not None and controller.kp > 0:
            zero = float(finding.parameters["torque"].numbers[0]) / controller.kp
            out.append(Note(Code.OFFSET_OR_ZERO, finding.joint, {"zero": zero}))
    return tuple(out)


def _stray_notes(judgement: Judgement, simulated: Rollout, robot: Robot) -> tuple[Note, ...]:
    """A note for each joint whose simulated position error is larger than noise and the residual torque explain.

    Under a position controller, an unmodelled torque causes a position error of the torque divided by the gain kp, also
    if the torque is too small to count as a gap.
    """
    rollout = simulated.json or {}
    errors, noise = rollout.get("rms_after", {}), rollout.get("reading_noise", {})
    rows = {joint: row for row, joint in enumerate(robot.joint_names)}
    by_residual: dict[str, float] = {}
    for gap in judgement.joints:
        controller = robot.actuators[rows[gap.joint]].controller
        if controller is not None and controller.kp:
            by_residual[gap.joint] = gap.allowed / controller.kp
    out = []
    for joint, error in errors.items():
        if error > max(_LARGE_ERROR * noise.get(joint, np.inf), by_residual.get(joint, 0.0)):
            unit = "m" if robot.prismatic[rows[joint]] else "rad"
            out.append(Note(Code.STRAYS_UNDER_CONTROL, joint, {"error": error, "noise": noise[joint], "unit": unit}))
    return tuple(out)


def _explained_by_damping_gain(finding: Finding, robot: Robot) -> bool:
    """True if an error of the damping gain could explain the found viscous friction.

    The true damping gain would then be the sum of both, which must not be negative by more than two deviations.
    """
    assert finding.joint is not None
    controller = robot.actuators[robot.joint_names.index(finding.joint)].controller
    kd = 0.0 if controller is None else controller.kd
    size = finding.parameters["coefficient"]
    return kd + size.numbers[0] >= -2 * size.stds[0]


def _friction_over_damping(finding: Finding, robot: Robot) -> float:
    """Ratio of the found viscous friction to the damping gain that includes it; infinite if this gain is zero."""
    assert finding.joint is not None
    controller = robot.actuators[robot.joint_names.index(finding.joint)].controller
    size = finding.parameters["coefficient"].numbers[0]
    return size / controller.kd if controller is not None and controller.kd else np.inf


def _excess(finding: Finding) -> float:
    """Ratio of the torque constant to the modelled one, minus one."""
    return float(finding.parameters["ratio"].numbers[0]) - 1.0
