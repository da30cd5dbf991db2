"""Cases of every make as robots that can be recorded again, along any motion and with fresh noise."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from identification.data.changes import KnownPayload
from identification.data.recording import Recording
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

Place = tuple[str, str | None]

# Imported when they are asked for: a make must run where what another one is built on is missing.
MODULES = {
    "own": "benchmarks.next_experiment_cases",
    "field": "benchmarks.next_experiment_field",
    "drake": "benchmarks.next_experiment_drake",
}


class Again(Protocol):
    """Records the true robot of a case once more; None if it does not follow the motion."""

    def __call__(self, motion: Motion, noise: int, payload: KnownPayload | None = None) -> Recording | None:
        """A recording.

        Args:
            motion: The reference, from rest to rest.
            noise: Number of a noise; each is drawn anew.
            payload: A known mass that the robot carries then.
        """
        ...


@dataclass(frozen=True)
class Case:
    """An ordinary recording of a robot with one effect, and the robot to be recorded again.

    Attributes:
        name: Of the robot.
        robot: The model that is given.
        truth: What a diagnosis has to name.
        first: The ordinary recording.
        again: Records the true robot along another motion.
    """

    name: str
    robot: Robot
    truth: Place
    first: Recording
    again: Again


def cases_of(make: str) -> Callable[[int], Case | None]:
    """What gives the case of a development seed, None where it has none."""
    return importlib.import_module(MODULES[make]).drawn_case
