"""Findings that each kind of file can contain, by the numbers of an effect that its format has."""

from __future__ import annotations

from dataclasses import dataclass, fields

from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_mjcf import compliances_in_mjcf, zeros_in_file
from identification.export.corrected.corrected_model import CorrectedModel, numbers_of_effect
from identification.export.corrected.given_drives import holds_reference_delay
from identification.export.uses.feedforward import OWN_LAWS
from phantom_dyn.effects.described import ModelNumbers

OF_DRIVES = frozenset({"gain", "limit", "delay", "lag", "reference_delay", "gap", "stiffness"})
"""Numbers of an effect that act on the command of the drive, and not as an added torque."""
_URDF = frozenset({"viscous", "coulomb", "robot", "turned", "zero", "limit"})
_DRIVES = frozenset({"rotor_inertia", "delay"})
_MJCF = _URDF | _DRIVES | {"offset", "spring", "gain", "lag", "gap", "stiffness", "waves", "coupling"}


@dataclass(frozen=True)
class Format:
    """Numbers and laws that one kind of file can contain.

    Attributes:
        numbers: Fields of `ModelNumbers`; None if it contains every effect by its law.
        laws: Effects that it contains by a law of its own.
    """

    numbers: frozenset[str] | None
    laws: tuple[str, ...] = ()


LAWS = Format(None)
URDF_FORMAT = Format(_URDF)
MJCF_FORMAT = Format(_MJCF)
ISAAC_FORMAT = Format(_URDF | _DRIVES | {"reference_delay"})
FEEDFORWARD_FORMAT = Format(_MJCF - {"gap", "stiffness", "lag"}, OWN_LAWS)
"""A feedforward treats a lag as a delay, which is only a part of its effect."""


def holds(kind: Format, corrected: CorrectedModel, effect: KnownEffect) -> bool:
    """True if a file of this kind contains an effect in full.

    Args:
        kind: Kind of the file.
        corrected: The model from which the file is made.
        effect: The effect, with the contract's parameters in order.
    """
    if kind.numbers is None or effect.effect in kind.laws:
        return True
    numbers = numbers_of_effect(corrected.given, effect)
    used = used_numbers(numbers)
    joint = str(effect.joint)
    if kind is MJCF_FORMAT and "reference_delay" in used:
        names = corrected.given.joint_names if effect.joint is None else (joint,)
        return all(holds_reference_delay(corrected, name) for name in names)
    if not numbers.whole or not used <= kind.numbers:
        return False
    if "zero" in used and kind is not FEEDFORWARD_FORMAT:
        return joint in zeros_in_file(corrected)
    return "stiffness" not in used or joint in compliances_in_mjcf(corrected)


def used_numbers(numbers: ModelNumbers) -> frozenset[str]:
    """Names of the numbers that an effect has."""
    values = {field.name: getattr(numbers, field.name) for field in fields(ModelNumbers) if field.name != "whole"}
    return frozenset(
        name
        for name, value in values.items()
        if value is not None and not (isinstance(value, float | tuple) and not value)
    )
