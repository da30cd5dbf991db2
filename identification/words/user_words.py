"""Copies the texts of a user's own effects into the result of a diagnosis, from which alone a report is written."""

from __future__ import annotations

from dataclasses import replace

from identification.diagnosis.result import EffectAt, Finding, Judgement, Rival
from phantom_dyn.effects.catalogue import known_effect
from phantom_dyn.effects.described import EffectWords
from phantom_dyn.model.robot import Robot


def user_words(effect: str, robot: Robot) -> EffectWords | None:
    """Words of an effect that the user wrote for a robot; None for any other name."""
    if effect not in {own.name for own in robot.user_effects}:
        return None
    found = known_effect(effect, robot)
    return None if found is None else found.words


def with_user_words(judgement: Judgement, robot: Robot) -> Judgement:
    """The judgement with words for every effect that the user wrote; the same object if there are none.

    Args:
        judgement: Judgement with the names of effects.
        robot: Robot with the user's effects.
    """
    if not robot.user_effects:
        return judgement

    def words(effect: str) -> EffectWords | None:
        return user_words(effect, robot)

    def at(place: EffectAt) -> EffectAt:
        return replace(place, words=words(place.effect))

    def with_words(finding: Finding) -> Finding:
        rivals = tuple(Rival(tuple(map(at, rival.effects)), rival.probability) for rival in finding.rivals)
        return replace(finding, rivals=rivals, words=words(finding.effect))

    return replace(
        judgement,
        findings=tuple(map(with_words, judgement.findings)),
        minor=tuple(map(with_words, judgement.minor)),
        bounds=tuple(replace(bound, words=words(bound.effect)) for bound in judgement.bounds),
        not_testable=tuple(replace(entry, words=words(entry.effect)) for entry in judgement.not_testable),
        ledger=tuple(
            replace(claim, effects=tuple(map(at, claim.effects)), instead=tuple(map(at, claim.instead)))
            for claim in judgement.ledger
        ),
    )
