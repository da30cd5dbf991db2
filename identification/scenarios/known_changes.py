"""Gives effects of a single recording their names in the catalogue, and states how many times larger friction is there.

During the fit, an effect of a single recording has a name of its own (`OneRecordingEffect`). A finding states the
catalogue's effect and the recording instead.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from identification.diagnosis.columns.one_recording_effects import OneRecordingEffect
from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import EffectAt, Finding, Judgement, Value
from identification.diagnosis.result import Rival as RivalSet
from phantom_dyn.effects.catalogue import known_effect
from phantom_dyn.effects.support.rows import modelled_friction_of
from phantom_dyn.model.robot import Robot

# For each effect that adds to a modelled friction: index in `modelled_friction_of`, and name in `Adjusted.quantity`.
_MODELLED = {"viscous_friction": (0, "viscous friction"), "coulomb_friction": (1, "Coulomb friction")}
# A friction level below this number of its standard deviations is too uncertain for a ratio.
_LEAST_LEVEL = 2.0


def with_catalogue_names(judgement: Judgement, session: Session) -> Judgement:
    """The judgement with the catalogue's names for effects of single recordings.

    Args:
        judgement: The result of the fits.
        session: The recordings and their known differences.
    """
    own = {effect.name: effect for effect in session.differences.effects}
    if not own:
        return judgement
    return replace(
        judgement,
        findings=tuple(
            _renamed(finding, judgement, session.robot, own, session.known) for finding in judgement.findings
        ),
        bounds=tuple(bound for bound in judgement.bounds if bound.effect not in own),
        not_testable=tuple(entry for entry in judgement.not_testable if entry.effect not in own),
        ledger=tuple(
            replace(
                claim,
                effects=tuple(_with_catalogue_name(at, own) for at in claim.effects),
                instead=tuple(_with_catalogue_name(at, own) for at in claim.instead),
            )
            for claim in judgement.ledger
        ),
    )


def _renamed(
    finding: Finding,
    judgement: Judgement,
    robot: Robot,
    own: dict[str, OneRecordingEffect],
    known: tuple[KnownEffect, ...],
) -> Finding:
    """The finding with the catalogue's names, and for friction the ratio of its level to that in other recordings."""
    rivals = tuple(
        RivalSet(tuple(_with_catalogue_name(at, own) for at in rival.effects), rival.probability)
        for rival in finding.rivals
    )
    effect = own.get(finding.effect)
    if effect is None:
        return replace(finding, rivals=rivals)
    parameters = dict(finding.parameters)
    name = effect.inner.name
    if name in _MODELLED:
        difference = next(iter(parameters.values()))
        ratio = growth(difference, level_elsewhere(name, finding.joint, judgement, robot, known))
        parameters |= {} if ratio is None else {"ratio": ratio}
    return replace(finding, effect=name, recording=effect.file, parameters=parameters, rivals=rivals)


def _with_catalogue_name(at: EffectAt, own: dict[str, OneRecordingEffect]) -> EffectAt:
    effect = own.get(at.effect)
    return at if effect is None else EffectAt(effect.inner.name, at.joint, effect.file)


def level_elsewhere(
    name: str, joint: str | None, judgement: Judgement, robot: Robot, known: tuple[KnownEffect, ...] = ()
) -> Value:
    """Friction of one kind on one joint in all recordings: modelled and adjusted, plus known effects and findings."""
    kind, words = _MODELLED[name]
    modelled = modelled_friction_of(robot, joint)[kind]
    adjustment = sum(entry.change for entry in judgement.adjusted if entry.quantity == f"{joint} {words}")
    level, variance = modelled * (1.0 + adjustment), 0.0
    for effect in known:
        if effect.joint == joint:
            shares = _shares(robot, effect.effect, joint, kind)
            level += sum(share * effect.theta[k] for k, share in enumerate(shares.values()) if share)
    for finding in judgement.findings:
        if finding.joint == joint and finding.recording is None:
            for parameter, share in _shares(robot, finding.effect, joint, kind).items():
                if share:
                    size = finding.parameters[parameter]
                    level += share * size.numbers[0]
                    variance += (share * size.stds[0]) ** 2
    return Value(level, math.sqrt(variance), "")


def _shares(robot: Robot, effect: str, joint: str | None, kind: int) -> dict[str, float]:
    """Factor with which each parameter of an effect counts as viscous (0) or Coulomb (1) friction."""
    law = known_effect(effect, robot)
    if law is None:
        return {}
    names = [parameter.name for parameter in law.parameters(robot, joint)]
    numbers = [law.model_numbers(robot, joint, unit) for unit in np.eye(len(names))]
    return {name: (one.viscous, one.coulomb)[kind] for name, one in zip(names, numbers, strict=True)}


def growth(difference: Value, level: Value) -> Value | None:
    """Ratio of a level in one recording to that in the others; None if the level in the others is too uncertain.

    The variance of the level in the one recording is that of the difference minus that of the level in the others. As
    both are estimates, at least a quarter of the variance of the difference is used.
    """
    more, more_std = difference.numbers[0], difference.stds[0]
    base, base_std = level.numbers[0], level.stds[0]
    if base <= _LEAST_LEVEL * base_std:
        return None
    ratio = (base + more) / base
    variance = max(more_std**2 - base_std**2, 0.25 * more_std**2)
    return Value(ratio, math.sqrt(variance + (ratio * base_std) ** 2) / base, "1")
