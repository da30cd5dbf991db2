"""Cases of every make as robots that can be recorded again along any motion with new noise."""

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

# Imported on demand: a make must run without the libraries of another make.
MODULES = {
    "own": "benchmarks.next_experiment_cases",
    "field": "benchmarks.next_experiment_field",
    "drake": "benchmarks.next_experiment_drake",
}


class Again(Protocol):
    """Function that records the true robot of a case again; None if the robot does not follow the motion."""

    def __call__(self, motion: Motion, noise: int, payload: KnownPayload | None = None) -> Recording | None:
        """Record the robot.

        Args:
            motion: Reference, from rest to rest.
            noise: Number of the noise; each number gives other noise.
            payload: Known mass on the robot, or None.
        """
        ...


@dataclass(frozen=True)
class Case:
    """An ordinary recording of a robot with one effect, and a function that records the robot again.

    Attributes:
        name: Name of the robot.
        robot: Given model.
        truth: Effect that a diagnosis has to find.
        first: Ordinary recording.
        again: Function that records the true robot along another motion.
    """

    name: str
    robot: Robot
    truth: Place
    first: Recording
    again: Again


def cases_of(make: str) -> Callable[[int], Case | None]:
    """Function that gives the case of a development seed, or None."""
    return importlib.import_module(MODULES[make]).drawn_case
