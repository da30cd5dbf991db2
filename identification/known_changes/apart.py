"""Recordings that are not alike, as fits see them: each with its own model, and effects that act in some of them."""

from __future__ import annotations

from dataclasses import dataclass

from identification.known_changes.change import Change
from identification.known_changes.loaded import robot_in
from identification.known_changes.own_effect import EFFECTS_OF, OwnEffect, own_effect
from phantom_dyn.errors import LogError
from phantom_dyn.robot import Robot


@dataclass(frozen=True)
class Apart:
    """How recordings differ.

    Attributes:
        robots: The model of each; empty if all have the given one.
        own: Effects that act in one recording only.
    """

    robots: tuple[Robot, ...] = ()
    own: tuple[OwnEffect, ...] = ()

    def robot(self, given: Robot, recording: int) -> Robot:
        """The model of one recording."""
        return self.robots[recording] if self.robots else given


ALIKE = Apart()


def apart_by(changes: tuple[Change, ...], robot: Robot, fitted: int) -> Apart:
    """What known and unknown changes make of the model.

    Of each kind of unknown change, the recordings that do not name it have one amount in common. Where all name it, the
    first one is what the others are compared with.

    Args:
        changes: One for each recording, those held out at the end; empty if nothing is known.
        robot: The given model.
        fitted: How many recordings fits see.

    Raises:
        LogError: If an unknown amount is asked for that no fit can see, or an unknown payload of one recording, whose
            place and mass fits do not hold apart.
    """
    if not changes:
        return ALIKE
    for change in changes[fitted:]:
        if change.unknown:
            raise LogError(
                f"{change.file} is held out, so no fit sees what changed in it: give it as LOG, or take "
                f"{', '.join(change.unknown)} out of what changed."
            )
    for change in changes:
        if "payload" in change.unknown:
            raise LogError(
                f"{change.file}: the payload that changed has no value: give its mass and center under payload, or "
                "diagnose that recording by itself."
            )
    if fitted == 1 and changes[0].unknown:
        raise LogError(
            f"{changes[0].file} is the only recording that fits see, so {', '.join(changes[0].unknown)} cannot have "
            "changed: give another LOG to compare it with, or leave changed out."
        )
    own = {}
    for kind, effects in EFFECTS_OF.items():
        stated = [k for k, change in enumerate(changes[:fitted]) if kind in change.unknown]
        for k in stated[1:] if len(stated) == fitted else stated:
            own.update({(name, k): own_effect(name, k, changes[k].file) for name in effects})
    return Apart(tuple(robot_in(robot, change) for change in changes), tuple(own.values()))
