"""Removes claims that motion without a measured torque cannot support.

Without a measured torque, a wrong torque constant has the same effect as a wrong controller gain, and a torque offset
the same as another zero of the reference.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.data.recording import Recording
from identification.diagnosis.result import Adjusted, EffectAt, Finding, Judgement, NotTestable
from identification.engine.claims import Claim, GateResult, Outcome
from identification.gates import controller_gain as gate
from identification.notes import Code, Note
from identification.rollout.compare import Rollout
from phantom_dyn.model.robot import Robot

# Smallest error of a joint simulated under its controller that is noted, in standard deviations of its readings.
_STRAYS = 10.0
_TWIN = (
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

    A ratio of torque constants that differs from 1 by at most two tolerances of the gains is no gap, and is listed as
    adjusted. A larger ratio remains a finding, with a warning that it is the product of constant and gain. Gains that
    were estimated from the same positions hide three effects, which are then not testable: any ratio of torque
    constants, loads that scale weight and inertia of a joint alike, and viscous friction up to the damping gain. A
    torque offset remains a finding, with a note of the zero of the reference that would explain it.

    Args:
        judgement: Judgement of the torque that controllers command.
        recordings: Its recordings; if a torque was measured, the judgement is returned unchanged.
        rollout: Motion simulated under the controllers.
        robot: The robot with its gains, estimated ones included.
    """
    if not any(recording.controlled for recording in recordings):
        return judgement
    estimated = {joint for recording in recordings for joint in recording.gains_estimated}
    constants = [finding for finding in judgement.findings if finding.effect == "torque_constant"]
    results = {_place(one): gate.beyond_the_gain(_excess(one), stated=one.joint not in estimated) for one in constants}
    small = [one for one in constants if not results[_place(one)].passed]
    large = [finding for finding in constants if finding not in small]
    # An estimated kd includes the viscous friction of the joint, so it may be too large by this friction.
    damping = [
        one
        for one in judgement.findings
        if one.effect == "viscous_friction" and one.joint in estimated and _explained_by_damping_gain(one, robot)
    ]
    small += damping
    results |= {_place(one): gate.beyond_the_gain(_over_damping(one, robot), stated=False) for one in damping}
    findings = tuple(finding for finding in judgement.findings if finding not in small)
    claimed = {finding.joint for finding in large}
    untestable = tuple(
        NotTestable("torque_constant", gap.joint, _TWIN) for gap in judgement.joints if gap.joint not in claimed
    )
    found = {(finding.effect, finding.joint) for finding in findings}
    by_gains = [("viscous_friction", g.joint, _DAMPING) for g in judgement.joints if g.joint in estimated]
    by_gains += [("inertial_parameters", g.joint, _LOAD) for g in judgement.joints if g.joint in estimated]
    by_gains += [("payload", None, _LOAD)] if estimated else []
    untestable += tuple(NotTestable(*one) for one in by_gains if one[:2] not in found)
    places_by_gains = {one[:2] for one in by_gains}

    def hidden(effect: str, joint: str | None) -> bool:
        """True if errors of gains hide an effect, so that the judgement's own statements on it do not hold."""
        return effect == "torque_constant" or (effect, joint) in places_by_gains

    others = tuple(entry for entry in judgement.not_testable if not hidden(entry.effect, entry.joint))
    within_gain_tolerance = tuple(
        Adjusted(f"{finding.joint} torque constant times controller gain", _excess(finding), gate.GAIN_TOLERANCE)
        for finding in small
        if finding not in damping
    )
    warned = tuple(Note(Code.GAIN_OR_CONSTANT, finding.joint, {"ratio": 1.0 + _excess(finding)}) for finding in large)
    warned += _zero_notes(findings, robot)
    kept = [finding not in small for finding in judgement.findings]
    without = judgement.evidence.tau_without
    shown = tuple(torque for torque, keep in zip(without, kept, strict=False) if keep)
    verdict = "no_gap" if not findings and judgement.verdict == "explained" else judgement.verdict
    return replace(
        judgement,
        findings=findings,
        verdict=verdict,
        adjusted=(*judgement.adjusted, *within_gain_tolerance),
        bounds=tuple(bound for bound in judgement.bounds if not hidden(bound.effect, bound.joint)),
        not_testable=(*others, *untestable),
        warnings=(*judgement.warnings, *warned),
        evidence=replace(judgement.evidence, tau_without=shown),
        notes=(*judgement.notes, *(_stray_notes(judgement, rollout, robot) if verdict == "no_gap" else ())),
        ledger=tuple(_limited(claim, results) for claim in judgement.ledger),
    )


def _place(finding: Finding) -> tuple[str, str | None]:
    return finding.effect, finding.joint


def _limited(claim: Claim[EffectAt], results: Mapping[tuple[str, str | None], GateResult]) -> Claim[EffectAt]:
    """An entry of the ledger with the result of the gate of gains for its effect."""
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
    """A note for each joint whose simulated position error exceeds both its noise and the error that "no gap" allows.

    A position controller yields to an unmodelled torque by the torque divided by its gain. A residual that counts as
    no gap causes such an error too.
    """
    rollout = simulated.json or {}
    after, noise = rollout.get("rms_after", {}), rollout.get("reading_noise", {})
    units = {joint: "m" if linear else "rad" for joint, linear in zip(robot.joint_names, robot.prismatic, strict=True)}
    gains = {joint: drive.controller for joint, drive in zip(robot.joint_names, robot.actuators, strict=True)}
    yielded = {gap.joint: gap.allowed / gain.kp for gap in judgement.joints if (gain := gains[gap.joint]) and gain.kp}
    return tuple(
        Note(Code.STRAYS_UNDER_CONTROL, joint, {"error": after[joint], "noise": noise[joint], "unit": units[joint]})
        for joint in after
        if after[joint] > max(_STRAYS * noise.get(joint, np.inf), yielded.get(joint, 0.0))
    )


def _explained_by_damping_gain(finding: Finding, robot: Robot) -> bool:
    """True if an error of the damping gain, which is not negative, could explain the found viscous friction."""
    assert finding.joint is not None
    controller = robot.actuators[robot.joint_names.index(finding.joint)].controller
    kd = 0.0 if controller is None else controller.kd
    size = finding.parameters["coefficient"]
    return kd + size.numbers[0] >= -2 * size.stds[0]


def _over_damping(finding: Finding, robot: Robot) -> float:
    """Ratio of the found viscous friction to the damping gain that includes it; infinite if this gain is zero."""
    assert finding.joint is not None
    controller = robot.actuators[robot.joint_names.index(finding.joint)].controller
    size = finding.parameters["coefficient"].numbers[0]
    return size / controller.kd if controller is not None and controller.kd else np.inf


def _excess(finding: Finding) -> float:
    """Relative excess of the torque per command over the modelled one [1]."""
    return float(finding.parameters["ratio"].numbers[0]) - 1.0
