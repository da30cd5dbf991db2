"""Tests ("gates") that a claim has to pass, in the order in which they are applied; each gate is one function.

A claim says that an effect of the catalogue is present in the recordings. A gate gets numbers that were computed for a
claim. It returns the number that it tests, the number that is needed, and whether the claim passes. The first line of
its docstring is its question; its thresholds are in the same file. ``python benchmarks/same_answers.py record --rule
FILE.NAME=VALUE`` diagnoses forty recordings with another threshold, such as ``above_chance.LEAST_GAIN=30``.
"""

from __future__ import annotations

from collections.abc import Callable

from identification.engine.claims import GateResult
from identification.gates.above_chance import more_than_chance
from identification.gates.coarse_reading import coarser_than_others, coarser_than_stated, rounding_matters
from identification.gates.controller_gain import beyond_the_gain
from identification.gates.exchange import explains_more_than_others, worth_its_numbers
from identification.gates.existing_bodies import bodies_can_exist
from identification.gates.fair_part import fair_part_of_the_gap
from identification.gates.in_band import closes_for_sure, torque_is_there
from identification.gates.least_size import large_enough
from identification.gates.moved_joints import shown_above_noise, shown_by_motion
from identification.gates.over_blocks import in_enough_blocks
from identification.gates.possible import possible_size
from identification.gates.rivalry import likelier_than_rivals, plausible_size
from identification.gates.special_case import both_are_there, differs_from_simpler, more_than_a_missing_part

GATES: tuple[Callable[..., GateResult], ...] = (
    possible_size,
    bodies_can_exist,
    more_than_chance,
    fair_part_of_the_gap,
    in_enough_blocks,
    explains_more_than_others,
    worth_its_numbers,
    torque_is_there,
    shown_by_motion,
    closes_for_sure,
    shown_above_noise,
    differs_from_simpler,
    both_are_there,
    more_than_a_missing_part,
    plausible_size,
    likelier_than_rivals,
    coarser_than_stated,
    coarser_than_others,
    rounding_matters,
    large_enough,
    beyond_the_gain,
)
"""All gates in the order in which they are applied: those of the search, of the judged band, of rivals, of size. The
judged band holds the frequencies, from zero to a cutoff, in which the found effects are tested once more."""


def gate_name(gate: Callable[..., GateResult]) -> str:
    """Name of a gate in a ledger, such as ``more than chance``."""
    return gate.__name__.replace("_", " ")


ORDER: dict[str, int] = {gate_name(gate): place for place, gate in enumerate(GATES)}
"""Place of each gate by its name."""
