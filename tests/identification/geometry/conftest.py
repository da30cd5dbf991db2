"""Recordings of a UR10 whose poses were measured."""

from tests.common.tracked_ur10 import slow_motion, tracked, ur10, ur10_text

__all__ = ["slow_motion", "tracked", "ur10", "ur10_text"]
