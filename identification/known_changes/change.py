"""What is known to be different in one of several recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from phantom_dyn.robot import Controller

# What may have changed by an amount that nobody knows.
Kind = Literal["payload", "friction", "temperature", "controller"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class KnownPayload:
    """A point mass [kg] and its centre [m] in the axes of ``payload_frame``, else of the joint that moves the link."""

    mass: float
    center: tuple[float, float, float]


@dataclass(frozen=True)
class Change:
    """One recording as it differs from the others.

    Attributes:
        file: Name of the recording, for messages.
        payload: A mass that the robot carries there, besides what the model has.
        controllers: Position controllers by joint, where they are not those of the robot.
        changed: What is different there by an amount that is to be found.
        exclude: Stretches of its time [s] to leave out of every fit.
    """

    file: str
    payload: KnownPayload | None = None
    controllers: Mapping[str, Controller] = field(default_factory=dict)
    changed: tuple[Kind, ...] = ()
    exclude: tuple[tuple[float, float], ...] = ()

    @property
    def unknown(self) -> tuple[Kind, ...]:
        """What has changed and has no known value."""
        known = {"payload": self.payload is not None, "controller": bool(self.controllers)}
        return tuple(kind for kind in self.changed if not known.get(kind, False))
