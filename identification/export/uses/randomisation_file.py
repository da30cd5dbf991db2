"""Writes ``randomisation.yaml`` (schema ``phantom-dyn-randomisation/2``): ranges for training in simulation.

The file has two kinds of ranges. Ranges of effects' parameters are relative to the given model. Ranges of numbers in
the corrected MJCF (body mass, damping, frictionloss, armature, gear and so on) are absolute. The first lines of the
file explain this to its users. Parameters have the same meaning for found and for unseen effects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np

from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Adjusted, Bound
from identification.export.corrected.corrected_mjcf import corrected_elements
from identification.export.corrected.corrected_model import CorrectedModel, corrected_model, with_effects
from identification.export.uses.randomisation import (
    SIGMAS,
    Randomisation,
    found_range,
    parameters_of,
    unseen_effect,
    unseen_range,
    unseen_sizes,
)
from phantom_dyn.array_types import Array
from phantom_dyn.errors import EstimationError, PhantomDynError
from phantom_dyn.model.files.strict_yaml import settings_text

# Position of one number in an MJCF: element, name, attribute, and index among the numbers of the attribute.
Field = tuple[str, str, str, int]
_DEFAULT = {("motor", "gear"): 1.0}
"""Defaults of MJCF attributes, by element and attribute; zero without an entry."""
_DRIVE_TAGS = "motor", "general"
"""Elements for a drive; the drive's properties determine which of them a file has."""

SCHEMA = "phantom-dyn-randomisation/2"
_ON_TOP, _ABSOLUTE = "on top of the given model", "absolute"
_HEAD = f"""\
# Ranges for training in simulation, from a diagnosis. All numbers are in SI units.
#
# found:  effects that the diagnosis found. They count {_ON_TOP} after the relative changes under adjusted,
#         which are within its tolerances: a friction of 0.8 is 0.8 more than the model states. A range is two
#         standard deviations to either side of the value.
# unseen: effects that were not seen; they also count {_ON_TOP}. A range goes from no effect to the size from
#         which the recordings would have shown it. A parameter means the same as under found: a ratio of torque is a
#         factor, for example. nothing is its value without the effect, which is 1 for a factor. Draw few of them at a
#         time, as together they would have been seen. If a range ends at .inf (an infinite stiffness is no effect),
#         draw the quantity under drawn_as uniformly from its range.
# mjcf:   the same as numbers of corrected.xml, {_ABSOLUTE}: with 0.6 in the given model and 0.8 found, value is 1.4.
#         range follows from found, and unseen_range from unseen.
# Use found and unseen, or mjcf: with both, everything counts twice.
"""
_TIME_PARAMETERS = ("delay", "time_constant")


@dataclass(frozen=True)
class FieldRange:
    """Range of one number of an MJCF.

    Attributes:
        element: Element that contains the number.
        name: Name of the element; that of its parent if the element has none.
        attribute: Attribute that contains the number.
        index: Index among the numbers of the attribute.
        value: Value in the corrected model.
        found: Lower and upper end of the range that follows from the standard deviations of the findings.
        unseen: Lower and upper end of the range that follows from effects that were not seen, one at a time.
        needs: Other attributes that the element must have, as MuJoCo ignores the number without them. The key
            ``element`` states another element that must replace the one in the file.
    """

    element: str
    name: str
    attribute: str
    index: int
    value: float
    found: tuple[float, float]
    unseen: tuple[float, float]
    needs: Mapping[str, str] = field(default_factory=dict)


def mjcf_ranges(
    randomisation: Randomisation, known: tuple[KnownEffect, ...] = ()
) -> tuple[tuple[FieldRange, ...], tuple[Bound, ...]]:
    """Ranges of all numbers of the corrected MJCF that are uncertain.

    Standard deviations are propagated to first order, with correlations.

    Args:
        randomisation: Distribution of the robot.
        known: Effects that the given model already contains.

    Returns:
        The ranges, and the unseen effects that change no number of the file, such as backlash, which needs an
        additional element.

    Raises:
        PhantomDynError: If the robot cannot be written as an MJCF.
    """
    given = corrected_model(randomisation.robot, known)
    corrected = with_effects(given, randomisation.with_values(randomisation.values))
    base = _File.of(corrected_elements(corrected))
    half = _half_widths(randomisation, given, base)
    low: dict[Field, float] = {}
    high: dict[Field, float] = {}
    needs: dict[Field, dict[str, str]] = {}
    without: list[Bound] = []
    for bound in randomisation.unseen:
        changes: dict[Field, float] = {}
        # The upper end comes last, so that ``changes`` after the loop are those of the largest size.
        for size in unseen_sizes(randomisation.robot, bound):
            effect = unseen_effect(randomisation, bound, size / bound.below) if size else None
            changed = None if effect is None else _file_with(corrected, (effect,))
            changes = _changes(changed, base)
            for at, change in changes.items():
                low[at] = min(low.get(at, 0.0), change)
                high[at] = max(high.get(at, 0.0), change)
                if changed is not None:
                    needs.setdefault(at, {}).update(_needs(at, changed.root, base.root))
        if not changes:
            without.append(bound)
    out = []
    for at in dict.fromkeys((*half, *low)):
        value = base.numbers.get(at, _DEFAULT.get((at[0], at[2]), 0.0))
        found = (value - half.get(at, 0.0), value + half.get(at, 0.0))
        unseen = (value + low.get(at, 0.0), value + high.get(at, 0.0))
        if at[2] in ("damping", "frictionloss", "armature", "stiffness", "mass", "delay"):
            found, unseen = (max(found[0], 0.0), found[1]), (max(unseen[0], 0.0), unseen[1])
        out.append(FieldRange(*at, value, found, unseen, needs.get(at, {})))
    return tuple(out), tuple(without)


def _half_widths(randomisation: Randomisation, given: CorrectedModel, base: _File) -> dict[Field, float]:
    """Half the width of the range of each number that depends on a found parameter, by finite differences.

    Args:
        randomisation: Distribution of the robot.
        given: The given model with its known effects.
        base: The MJCF with the values that were found.
    """
    mean, std = randomisation.values, randomisation.std
    slopes: dict[Field, Array] = {}
    for place in np.flatnonzero(std > 0):
        shifted = mean.copy()
        shifted[place] += std[place]
        for at, change in _changes(_file_with(given, randomisation.with_values(shifted)), base).items():
            slopes.setdefault(at, np.zeros(len(mean)))[place] = change / std[place]
    return {at: SIGMAS * float(np.linalg.norm(slope @ randomisation.loadings)) for at, slope in slopes.items()}


@dataclass(frozen=True)
class _File:
    """An MJCF with its numbers.

    Attributes:
        root: Root element.
        numbers: All numbers in attributes, by their position.
        elements: Number of elements.
    """

    root: ElementTree.Element
    numbers: dict[Field, float]
    elements: int

    @classmethod
    def of(cls, root: ElementTree.Element) -> _File:
        """Reads the numbers below a root element."""
        return cls(root, _numbers(root, ""), sum(1 for _ in root.iter()))


def _changes(changed: _File | None, base: _File) -> dict[Field, float]:
    """Changes of the numbers of a file relative to ``base``; none if ``changed`` is None or has other elements.

    An element that an effect adds, such as the joint of a backlash, is either in the file or not, so it has no range.
    """
    if changed is None or changed.elements != base.elements:
        return {}
    out = {}
    for at in dict.fromkeys((*base.numbers, *changed.numbers)):
        usual = _DEFAULT.get((at[0], at[2]), 0.0)
        change = changed.numbers.get(at, usual) - base.numbers.get(at, usual)
        if change:
            out[at] = change
    return out


def _needs(at: Field, changed: ElementTree.Element, root: ElementTree.Element) -> dict[str, str]:
    """Other attributes that a number of ``changed`` needs: for example, ``biasprm`` needs ``biastype``.

    Empty if the element in ``root`` already has the number.
    """
    new, old = (_element(tree, at) for tree in (changed, root))
    if new is None or old is None or at[2] in old.attrib:
        return {}
    texts = {key: text for key, text in new.attrib.items() if old.get(key) != text and key != at[2]}
    return texts | ({"element": new.tag} if new.tag != old.tag else {})


def _element(root: ElementTree.Element, at: Field) -> ElementTree.Element | None:
    """The element that contains a number; None if the file has none."""
    tags = _DRIVE_TAGS if at[0] in _DRIVE_TAGS else (at[0],)
    return next((e for tag in tags for e in root.iter(tag) if e.get("name") == at[1]), None)


def _file_with(corrected: CorrectedModel, more: tuple[KnownEffect, ...]) -> _File | None:
    """The MJCF of the corrected robot with additional effects; None if this robot cannot be written."""
    try:
        return _File.of(corrected_elements(with_effects(corrected, more)))
    except PhantomDynError:
        return None


def _numbers(element: ElementTree.Element, owner: str) -> dict[Field, float]:
    """Numbers of an element and of all elements below it.

    Args:
        element: The element.
        owner: Name of the parent, which replaces the name of an element without one.
    """
    name = element.get("name", owner)
    out: dict[Field, float] = {}
    tag = "motor" if element.tag in _DRIVE_TAGS else element.tag
    for attribute, text in element.attrib.items():
        for index, word in enumerate(text.split()):
            try:
                number = float(word)
            except ValueError:
                break
            # ``float`` also reads words such as nan and 1e400, which are names here.
            if math.isfinite(number):
                out[tag, name, attribute, index] = number
    # The length of a delay's buffer is not a property of the robot.
    out.pop((tag, name, "nsample", 0), None)
    for child in element:
        out |= _numbers(child, name)
    return out


def randomisation_text(
    randomisation: Randomisation,
    known: tuple[KnownEffect, ...] = (),
    *,
    adjusted: tuple[Adjusted, ...] = (),
    with_mjcf: bool = True,
) -> str:
    """The text of ``randomisation.yaml``, with an explanation in its first lines and all digits of the numbers.

    Args:
        randomisation: Distribution of the robot.
        known: Effects that the given model already contains.
        adjusted: Changes of the given model within its tolerances, which the distribution's robot includes.
        with_mjcf: False if there is no corrected MJCF.
    """
    try:
        if not with_mjcf:
            raise EstimationError("corrected.xml was not written, so there are no ranges of its numbers.")
        ranges, without = mjcf_ranges(randomisation, known)
        fields, note = [_field_entry(field) for field in ranges], _note(without)
    except PhantomDynError as error:
        fields, note = [], {"mjcf_note": str(error)}
    content = {
        "schema": SCHEMA,
        "robot": randomisation.robot.name,
        "control_step": randomisation.control_step,
        "counts": {"adjusted": _ON_TOP, "found": _ON_TOP, "unseen": _ON_TOP, "mjcf": _ABSOLUTE},
        "adjusted": [{"quantity": one.quantity, "change": float(one.change)} for one in adjusted],
        "found": _found_entries(randomisation),
        "correlation": randomisation.correlation.tolist(),
        "unseen": [_unseen_entry(randomisation, bound) for bound in randomisation.unseen],
        "mjcf": fields,
        **note,
    }
    return _HEAD + settings_text(content)


def _unseen_entry(randomisation: Randomisation, bound: Bound) -> dict[str, object]:
    """Entry of an effect that was not seen."""
    found = unseen_range(randomisation.robot, bound)
    entry: dict[str, object] = {
        "effect": bound.effect,
        "joint": bound.joint,
        "parameter": found.parameter,
        "unit": found.unit,
        "range": [found.low, found.high],
        "nothing": found.nothing,
        **_steps(randomisation, found.parameter, found.low, found.high),
    }
    if not math.isfinite(found.nothing):
        sizes = list(unseen_sizes(randomisation.robot, bound))
        entry["drawn_as"] = {"quantity": f"1/{found.parameter}", "unit": bound.unit, "range": sizes}
    return entry


def _found_entries(randomisation: Randomisation) -> list[dict[str, object]]:
    """One entry for each parameter of the found effects."""
    out, place = [], 0
    for finding, effect in zip(randomisation.findings, randomisation.found, strict=True):
        named = parameters_of(randomisation.robot, effect)
        for (name, parameter), value in zip(named, effect.theta, strict=True):
            low, high = found_range(randomisation, place)
            out.append(
                {
                    "effect": effect.effect,
                    "joint": effect.joint,
                    "parameter": name,
                    "unit": parameter.unit,
                    "value": float(value),
                    "std": float(randomisation.std[place]),
                    "range": [low, high],
                    "probability": float(finding.probability) if np.isfinite(finding.probability) else None,
                    **_steps(randomisation, parameter.name, low, high),
                }
            )
            place += 1
    return out


def _steps(randomisation: Randomisation, parameter: str, low: float, high: float) -> dict[str, object]:
    """The range of a delay or time constant in control steps; empty for other parameters."""
    if parameter not in _TIME_PARAMETERS or randomisation.control_step is None:
        return {}
    return {"control_steps": [low / randomisation.control_step, high / randomisation.control_step]}


def _field_entry(field: FieldRange) -> dict[str, object]:
    return {
        "element": field.element,
        "name": field.name,
        "attribute": field.attribute,
        "index": field.index,
        "value": field.value,
        "range": list(field.found),
        "unseen_range": list(field.unseen),
        **({"needs": dict(field.needs)} if field.needs else {}),
    }


def _note(bounds: tuple[Bound, ...]) -> dict[str, str]:
    """A note that names the unseen effects for which the MJCF has no number; empty if there are none."""
    if not bounds:
        return {}
    names = dict.fromkeys(b.effect if b.joint is None else f"{b.effect} on {b.joint}" for b in bounds)
    return {"mjcf_note": f"No number of corrected.xml expresses these effects under unseen: {', '.join(names)}."}
