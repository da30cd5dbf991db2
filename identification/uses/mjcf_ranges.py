"""Randomisation ranges as fields of the corrected MJCF: body mass, damping, frictionloss, armature, gear and so on."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from identification.corrected.mjcf_parts import corrected_mjcf
from identification.corrected.parts import parts_of
from identification.diagnosis.terms import KnownEffect
from identification.uses.randomisation import SIGMAS, Randomisation, unseen_effect, unseen_range
from phantom_dyn.errors import PhantomDynError

Array = np.ndarray

# Fields of MJCF are element, name, attribute and place among its numbers.
Field = tuple[str, str, str, int]
_DEFAULT = {("motor", "gear"): 1.0, ("general", "gear"): 1.0}
"""What a field is where it is not written; else zero."""


@dataclass(frozen=True)
class FieldRange:
    """Where one number of a MJCF file may lie.

    Attributes:
        element, name, attribute, index: The number.
        value: What the corrected model says.
        found: Range that what was found leaves.
        unseen: Range that what was not seen leaves, one such effect at a time.
    """

    element: str
    name: str
    attribute: str
    index: int
    value: float
    found: tuple[float, float]
    unseen: tuple[float, float]


def mjcf_ranges(randomisation: Randomisation, known: tuple[KnownEffect, ...] = ()) -> tuple[FieldRange, ...]:
    """Ranges of all numbers of the corrected MJCF that what is known of the robot leaves open.

    Deviations are carried through to first order, correlations included.

    Args:
        randomisation: What the robot may be.
        known: Effects that belong to the given model already.

    Raises:
        PhantomDynError: If the robot has no MJCF.
    """
    mean = randomisation.values
    base = _fields(randomisation, known, mean)
    std = randomisation.std
    slopes: dict[Field, Array] = {}
    for place in np.flatnonzero(std > 0):
        moved = mean.copy()
        moved[place] += std[place]
        for field, change in _changes(randomisation, known, moved, base, ()).items():
            slopes.setdefault(field, np.zeros(len(mean)))[place] = change / std[place]
    half = {f: SIGMAS * float(np.linalg.norm(s @ randomisation.loadings)) for f, s in slopes.items()}
    low: dict[Field, float] = {}
    high: dict[Field, float] = {}
    for bound in randomisation.unseen:
        for size in unseen_range(bound):
            effect = unseen_effect(randomisation.robot, bound, size / bound.below) if size else None
            if effect is None:
                continue
            for field, change in _changes(randomisation, known, mean, base, (effect,)).items():
                low[field] = min(low.get(field, 0.0), change)
                high[field] = max(high.get(field, 0.0), change)
    out = []
    for field in dict.fromkeys((*half, *low)):
        value = base.get(field, _DEFAULT.get((field[0], field[2]), 0.0))
        found = (value - half.get(field, 0.0), value + half.get(field, 0.0))
        unseen = (value + low.get(field, 0.0), value + high.get(field, 0.0))
        if field[2] in ("damping", "frictionloss", "armature", "stiffness", "mass", "delay"):
            found, unseen = (max(found[0], 0.0), found[1]), (max(unseen[0], 0.0), unseen[1])
        out.append(FieldRange(*field, value, found, unseen))
    return tuple(out)


def _changes(
    randomisation: Randomisation,
    known: tuple[KnownEffect, ...],
    values: Float[Array, " p"],
    base: dict[Field, float],
    more: tuple[KnownEffect, ...],
) -> dict[Field, float]:
    """How far fields move; of a robot that cannot be written none does."""
    try:
        fields = _fields(randomisation, known, values, more)
    except PhantomDynError:
        return {}
    out = {}
    for field in dict.fromkeys((*base, *fields)):
        usual = _DEFAULT.get((field[0], field[2]), 0.0)
        change = fields.get(field, usual) - base.get(field, usual)
        if change:
            out[field] = change
    return out


def _fields(
    randomisation: Randomisation,
    known: tuple[KnownEffect, ...],
    values: Float[Array, " p"],
    more: tuple[KnownEffect, ...] = (),
) -> dict[Field, float]:
    """All numbers of the MJCF of a robot with some effects."""
    effects, start = [], 0
    for effect in randomisation.found:
        stop = start + len(effect.theta)
        effects.append(KnownEffect(effect.effect, effect.joint, tuple(values[start:stop].tolist())))
        start = stop
    root = ElementTree.fromstring(corrected_mjcf(parts_of(randomisation.robot, (*known, *effects, *more))))
    return _numbers(root, "")


def _numbers(element: ElementTree.Element, owner: str) -> dict[Field, float]:
    """Numbers of an element and all below it; what has no name has its owner's."""
    name = element.get("name", owner)
    out: dict[Field, float] = {}
    tag = "motor" if element.tag == "general" else element.tag
    for attribute, text in element.attrib.items():
        for index, word in enumerate(text.split()):
            try:
                out[tag, name, attribute, index] = float(word)
            except ValueError:
                break
    # How many steps a delay is kept for is no property of the robot.
    out.pop((tag, name, "nsample", 0), None)
    for child in element:
        out |= _numbers(child, name)
    return out
