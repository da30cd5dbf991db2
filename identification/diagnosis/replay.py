"""Recordings of a diagnosis on which exported models and friction laws are checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.data.changes import Change, robot_in
from identification.data.log import Log
from identification.data.signals import narrowed
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion, joined_bases


@dataclass(frozen=True)
class Replay:
    """Motion and measured torque of all recordings, and the samples on which residuals are computed.

    Attributes:
        robot: The given model.
        logs: The recordings.
        changes: Known change of the robot in each recording, such as a load; empty if there are none.
        cutoff_hz: Edge of the band in which residuals are judged.
        parts: Held-out blocks: index of the log, then first sample and end (exclusive) at the reduced rate.
        weights: Weights of the samples of each log at the reduced rate, ``(n, nv)``, lower where static friction may
            hold a joint.
    """

    robot: Robot
    logs: tuple[Log, ...]
    changes: tuple[Change, ...]
    cutoff_hz: float
    parts: tuple[tuple[int, int, int], ...]
    weights: tuple[Float[Array, "_ nv"], ...]

    @property
    def base(self) -> BaseMotion | None:
        """Motion of the base at the reduced rate, for all logs in succession; None for a fixed base."""
        return joined_bases([log.motion.at(log.samples).base for log in self.logs])

    def robot_in(self, robot: Robot, log: int) -> Robot:
        """A model with the known load of one recording."""
        return robot_in(robot, self.changes[log]) if self.changes else robot

    def in_band(self, series: Float[Array, "N nv"], log: int) -> Float[Array, "n nv"]:
        """A series of one log at the full rate, filtered into the judged band and sampled at the reduced rate."""
        band = self.logs[log].band
        return narrowed(band(series), self.logs[log].valid_in_band, band, self.cutoff_hz)

    def squares(self, torque: Callable[[int], Float[Array, "N nv"]]) -> Float[Array, "2 B nv"]:
        """Weighted squared residuals in the judged band, and weights, both summed over the samples of each block.

        Args:
            torque: Gives the drive torque [N m or N] of a model for a log of given index, at the full rate.
        """
        judged = sorted({log for log, _, _ in self.parts})
        residuals = {k: self.in_band(self.logs[k].tau - torque(k), k) ** 2 * self.weights[k] for k in judged}
        sums = [
            (residuals[k][start:stop].sum(axis=0), self.weights[k][start:stop].sum(axis=0))
            for k, start, stop in self.parts
        ]
        return np.array(sums).swapaxes(0, 1)

    def largest_torque(self) -> Float[Array, " nv"]:
        """Largest measured torque of each joint [N m or N], over all valid samples."""
        return np.array([np.abs(log.tau[log.valid]).max(axis=0, initial=0.0) for log in self.logs]).max(axis=0)
