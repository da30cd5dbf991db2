"""Choice between a higher controller gain and a lighter robot, which positions alone do not separate.

Without torque and stated gains, the gain of a controller is estimated from the masses of the model. If the robot
carries a load that the model lacks, the estimated gain is too low, and so is the estimated friction, by more than an
error of the damping gain could explain. With gains scaled so that the friction is as modelled, the load becomes
visible. Recordings are diagnosed with both gains, and held-out samples decide between the results if they can.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis, EffectAt, Finding, Rival
from identification.engine import contract_levels
from identification.engine.resampling import probabilities
from identification.notes import Code, Note
from identification.scenarios.motion_only import limited_controller_torque
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.support.rows import stiffness_unit
from phantom_dyn.model.robot import Robot

_LARGEST_FACTOR = 10.0  # of the gains: a load of more than this many times the robot's masses is implausible
_BLOCKS = 30  # number of time blocks of a bootstrap, because neighbouring samples are not independent


def scales_by_friction(
    robot: Robot, recordings: tuple[Recording, ...], findings: tuple[Finding, ...]
) -> dict[str, float]:
    """Factor for the estimated gains of each joint whose found friction is too low, with which it is as modelled.

    Args:
        robot: The robot with the estimated gains.
        recordings: Recordings with the names of the joints whose gains were estimated.
        findings: Findings of the diagnosis with the estimated gains.
    """
    estimated = {joint for recording in recordings for joint in recording.gains_estimated}
    out: dict[str, float] = {}
    # Viscous friction comes last, so that its factor is used where both have one.
    for effect, modelled in (
        ("coulomb_friction", robot.coulomb_friction),
        ("viscous_friction", robot.viscous_friction),
    ):
        for finding in findings:
            if finding.effect != effect or finding.joint not in estimated or finding.joint is None:
                continue
            row = robot.joint_names.index(finding.joint)
            controller = robot.actuators[row].controller
            damping = controller.kd if controller is not None and effect == "viscous_friction" else 0.0
            change = next(iter(finding.parameters.values())).numbers[0]
            found_friction = float(modelled[row]) + damping + change
            if found_friction < modelled[row] and found_friction * _LARGEST_FACTOR > modelled[row]:
                out[finding.joint] = float(modelled[row]) / found_friction
    return out


def with_scaled_gains(
    robot: Robot, recordings: tuple[Recording, ...], scales: Mapping[str, float]
) -> tuple[Robot, tuple[Recording, ...]]:
    """The robot with higher position gains and no damping gains, and recordings with the torque that these command.

    Args:
        robot: The robot with the estimated gains.
        recordings: Recordings with references.
        scales: Factor of each joint, see `scales_by_friction`.
    """
    actuators = list(robot.actuators)
    higher = []
    for joint, scale in scales.items():
        row = robot.joint_names.index(joint)
        controller = actuators[row].controller
        assert controller is not None
        actuators[row] = replace(actuators[row], controller=replace(controller, kp=scale * controller.kp, kd=0.0))
        numbers = {"kp": controller.kp, "scale": scale, "unit": stiffness_unit(robot, joint)}
        higher.append(Note(Code.GAIN_BY_FRICTION, joint, numbers))
    driven = replace(robot, actuators=tuple(actuators))
    out = []
    for k, one in enumerate(recordings):
        other_notes = tuple(n for n in one.notes if n.code is not Code.GAINS_ESTIMATED or n.joint not in scales)
        notes = (*other_notes, *higher) if k == 0 else other_notes
        out.append(replace(one, tau=limited_controller_torque(one, driven), notes=notes))
    return driven, tuple(out)


def preferred_diagnosis(first: Diagnosis, second: Diagnosis, scales: Mapping[str, float]) -> tuple[bool, Diagnosis]:
    """Whether the diagnosis with higher gains is preferred, and the preferred one with the other's findings as rivals.

    If the residuals of both are only noise, both are equally probable, and the one with fewer findings is preferred.
    Otherwise the held-out losses determine the probabilities.

    Args:
        first: Diagnosis with the gains as they were estimated.
        second: Diagnosis with higher gains and thus larger torques.
        scales: Factor on the gains of each joint.
    """
    by_losses = _probability_of_second(first, second, scales)
    only_noise_left = _residual_is_noise(first) and _residual_is_noise(second)
    probability = 0.5 if only_noise_left else by_losses
    second_leads = probability > 0.5
    if only_noise_left:
        counts = len(second.findings), len(first.findings)
        second_leads = counts[0] < counts[1] or (counts[0] == counts[1] and by_losses > 0.5)
    found, other = (second, first) if second_leads else (first, second)
    found_probability = probability if second_leads else 1.0 - probability
    shared = {finding.effect_at for finding in found.findings} & {finding.effect_at for finding in other.findings}
    rivals = tuple(finding.effect_at for finding in other.findings if finding.effect_at not in shared)
    if 1.0 - found_probability < contract_levels.LISTED or not rivals:
        return second_leads, found
    findings = tuple(
        finding if finding.effect_at in shared else _with_rival(finding, rivals, found_probability)
        for finding in found.findings
    )
    return second_leads, replace(found, findings=findings)


def _probability_of_second(first: Diagnosis, second: Diagnosis, scales: Mapping[str, float]) -> float:
    """Probability of the second diagnosis by the held-out losses of both, see `engine.resampling`."""
    if second.evidence.t.shape != first.evidence.t.shape or not len(first.evidence.t):
        return 0.5
    scale = np.array([scales.get(gap.joint, 1.0) for gap in first.joints])
    floor = np.array([gap.noise_floor for gap in first.joints])
    both = np.column_stack([_losses(first, floor), _losses(second, floor * scale)])
    losses = np.array([part.sum(axis=0) for part in np.array_split(both, _BLOCKS)])
    return float(probabilities(losses, (np.zeros(2),))[1])


def _residual_is_noise(diagnosis: Diagnosis) -> bool:
    """True if the residual of every joint is small enough to be noise."""
    return all(gap.rms_after <= contract_levels.FLOORS_LEFT * gap.noise_floor for gap in diagnosis.joints)


def _with_rival(finding: Finding, effects: tuple[EffectAt, ...], found_probability: float) -> Finding:
    """A finding with the other diagnosis's effects as rivals, and its probabilities times ``found_probability``.

    Rivals that are too improbable to be listed are removed, and the finding gets their probability.
    """
    rivals = [Rival(rival.effects, found_probability * rival.probability) for rival in finding.rivals]
    rivals = [
        rival
        for rival in (*rivals, Rival(effects, 1.0 - found_probability))
        if rival.probability >= contract_levels.LISTED
    ]
    rivals.sort(key=lambda rival: -rival.probability)
    unlisted = 1.0 - finding.probability - sum(rival.probability for rival in finding.rivals)
    probability = 1.0 - found_probability * unlisted - sum(rival.probability for rival in rivals)
    return replace(finding, probability=probability, rivals=tuple(rivals), verdict="one_of")


def _losses(diagnosis: Diagnosis, floor: Float[Array, " nv"]) -> Float[Array, " N"]:
    """Squared residual of each sample in units of the noise floors, summed over the joints."""
    evidence = diagnosis.evidence
    return (((evidence.tau_measured - evidence.tau_after) / np.maximum(floor, 1e-300)) ** 2).sum(axis=1)
