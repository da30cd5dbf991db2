"""``randomisation.yaml`` (schema ``phantom-dyn-randomisation/2``): ranges for training in simulation.

Ranges are stated of the parameters of effects, which count on top of the given model, and of the fields of the
corrected MJCF (body mass, damping, frictionloss, armature, gear and so on) that these parameters move, which are
absolute. The file says so itself. A parameter means the same in what was found and in what was not seen.
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
    unseen_effect,
    unseen_range,
    unseen_sizes,
)
from phantom_dyn.array_types import Array
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import EstimationError, PhantomDynError
from phantom_dyn.model.files.strict_yaml import settings_text

# Fields of MJCF are element, name, attribute and place among its numbers.
Field = tuple[str, str, str, int]
_DEFAULT = {("motor", "gear"): 1.0}
"""What a field is where it is not written; else zero."""
_OF_DRIVES = "motor", "general"
"""Elements that are the same drive: which of them depends on what the drive has."""

SCHEMA = "phantom-dyn-randomisation/2"
_ON_TOP, _ABSOLUTE = "on top of the given model", "absolute"
_HEAD = f"""\
# Ranges for training in simulation, from a diagnosis. All numbers are in SI units.
#
# found:  effects that the diagnosis found, counted {_ON_TOP} after the relative changes under adjusted,
#         which are within its tolerances: a friction of 0.8 is 0.8 more than the model states. A range is two
#         deviations to either side of the value.
# unseen: effects that were not seen, also counted {_ON_TOP}, each from nothing to the size from which the
#         recordings would have shown it. A parameter means the same as under found: a ratio of torque is a factor, of
#         which 1 is nothing. Draw few of them at a time, as together they would have been seen. A range that ends at
#         .inf (a stiffness: nothing is infinitely stiff) is drawn as drawn_as says, evenly from nothing on.
# mjcf:   the same as numbers of corrected.xml, {_ABSOLUTE}: with 0.6 in the given model and 0.8 found, 1.4 stands here.
#         range is what found leaves open, unseen_range what unseen does.
# Use found and unseen, or mjcf: with both everything is counted twice.
"""
_TIMES = ("delay", "time_constant")


@dataclass(frozen=True)
class FieldRange:
    """Where one number of a MJCF file may lie.

    Attributes:
        element, name, attribute, index: The number.
        value: What the corrected model says.
        found: Range within the deviations of the findings.
        unseen: Range within what would not have been seen, one such effect at a time.
        needs: Other attributes without which MuJoCo ignores a number that is not zero, and ``element`` where it has to
            be another one than in the file.
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
    """Ranges of all numbers of the corrected MJCF that the distribution of the robot leaves open.

    Deviations are carried through to first order, correlations included.

    Args:
        randomisation: Distribution of the robot.
        known: Effects that belong to the given model already.

    Returns:
        The ranges, and the unseen effects without such a number, as a play, which takes an element of its own.

    Raises:
        PhantomDynError: If the robot has no MJCF.
    """
    mean, std, given = randomisation.values, randomisation.std, corrected_model(randomisation.robot, known)
    corrected = with_effects(given, randomisation.with_values(mean))
    base = _File.of(corrected_elements(corrected))
    slopes: dict[Field, Array] = {}
    for place in np.flatnonzero(std > 0):
        moved = mean.copy()
        moved[place] += std[place]
        for at, change in _changes(_written(given, randomisation.with_values(moved)), base).items():
            slopes.setdefault(at, np.zeros(len(mean)))[place] = change / std[place]
    half = {at: SIGMAS * float(np.linalg.norm(s @ randomisation.loadings)) for at, s in slopes.items()}
    low: dict[Field, float] = {}
    high: dict[Field, float] = {}
    needs: dict[Field, dict[str, str]] = {}
    without: list[Bound] = []
    for bound in randomisation.unseen:
        changes: dict[Field, float] = {}
        # The upper end, the size that would have been seen, comes last.
        for size in unseen_sizes(randomisation.robot, bound):
            effect = unseen_effect(randomisation, bound, size / bound.below) if size else None
            there = None if effect is None else _written(corrected, (effect,))
            changes = _changes(there, base)
            for at, change in changes.items():
                low[at] = min(low.get(at, 0.0), change)
                high[at] = max(high.get(at, 0.0), change)
                if there is not None:
                    needs.setdefault(at, {}).update(_needs(at, there.root, base.root))
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


@dataclass(frozen=True)
class _File:
    """A MJCF file with its numbers.

    Attributes:
        root: Its first element.
        numbers: By field.
        elements: How many there are.
    """

    root: ElementTree.Element
    numbers: dict[Field, float]
    elements: int

    @classmethod
    def of(cls, root: ElementTree.Element) -> _File:
        """The file with this first element."""
        return cls(root, _numbers(root, ""), sum(1 for _ in root.iter()))


def _changes(there: _File | None, base: _File) -> dict[Field, float]:
    """How far numbers of elements that are in the file move; of a robot that cannot be written none does.

    A joint for a play or a spring that is not in the file has no range there: nothing is one end of it, and stiff is
    the other.
    """
    if there is None or there.elements != base.elements:
        return {}
    out = {}
    for at in dict.fromkeys((*base.numbers, *there.numbers)):
        usual = _DEFAULT.get((at[0], at[2]), 0.0)
        change = there.numbers.get(at, usual) - base.numbers.get(at, usual)
        if change:
            out[at] = change
    return out


def _needs(at: Field, there: ElementTree.Element, root: ElementTree.Element) -> dict[str, str]:
    """Words that come with a number, ``biastype`` with ``biasprm``, and ``nsample`` with a delay."""
    one, other = (_element(tree, at) for tree in (there, root))
    if one is None or other is None or at[2] in other.attrib:
        return {}
    words = {key: text for key, text in one.attrib.items() if other.get(key) != text and key != at[2]}
    return words | ({"element": one.tag} if one.tag != other.tag else {})


def _element(root: ElementTree.Element, at: Field) -> ElementTree.Element | None:
    tags = _OF_DRIVES if at[0] in _OF_DRIVES else (at[0],)
    return next((e for tag in tags for e in root.iter(tag) if e.get("name") == at[1]), None)


def _written(corrected: CorrectedModel, more: tuple[KnownEffect, ...]) -> _File | None:
    """The MJCF of a corrected robot with more effects; None of one that cannot be."""
    try:
        return _File.of(corrected_elements(with_effects(corrected, more)))
    except PhantomDynError:
        return None


def _numbers(element: ElementTree.Element, owner: str) -> dict[Field, float]:
    """Numbers of an element and all below it; what has no name has its owner's."""
    name = element.get("name", owner)
    out: dict[Field, float] = {}
    tag = "motor" if element.tag in _OF_DRIVES else element.tag
    for attribute, text in element.attrib.items():
        for index, word in enumerate(text.split()):
            try:
                number = float(word)
            except ValueError:
                break
            # A name such as 1e400 or nan reads as a number, and would be another one in every file.
            if math.isfinite(number):
                out[tag, name, attribute, index] = number
    # How many steps a delay is kept for is no property of the robot.
    out.pop((tag, name, "nsample", 0), None)
    for child in element:
        out |= _numbers(child, name)
    return out


def randomisation_text(
    randomisation: Randomisation,
    known: tuple[KnownEffect, ...] = (),
    *,
    moves: tuple[Adjusted, ...] = (),
    with_mjcf: bool = True,
) -> str:
    """The text of ``randomisation.yaml``, with what its numbers count from in its first lines; nothing is rounded.

    Args:
        randomisation: Distribution of the robot.
        known: Effects that belong to the given model already.
        moves: Changes of the given model within its tolerances that the robot of the distribution has.
        with_mjcf: False where there is no corrected MJCF.
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
        "adjusted": [{"quantity": move.quantity, "change": float(move.change)} for move in moves],
        "found": _found_entries(randomisation),
        "correlation": randomisation.correlation.tolist(),
        "unseen": [_unseen_entry(randomisation, bound) for bound in randomisation.unseen],
        "mjcf": fields,
        **note,
    }
    return _HEAD + settings_text(content)


def _unseen_entry(randomisation: Randomisation, bound: Bound) -> dict[str, object]:
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
    out, place = [], 0
    for finding, effect in zip(randomisation.findings, randomisation.found, strict=True):
        parameters = effect_named(effect.effect, randomisation.robot).parameters(randomisation.robot, effect.joint)
        each = max(len(effect.theta) // len(parameters), 1)
        for k in range(len(effect.theta)):
            parameter = parameters[k // each]
            name = parameter.name + (f"[{k % each}]" if each > 1 else "")
            low, high = found_range(randomisation, place)
            out.append(
                {
                    "effect": effect.effect,
                    "joint": effect.joint,
                    "parameter": name,
                    "unit": parameter.unit,
                    "value": float(effect.theta[k]),
                    "std": float(randomisation.std[place]),
                    "range": [low, high],
                    "probability": float(finding.probability) if np.isfinite(finding.probability) else None,
                    **_steps(randomisation, parameter.name, low, high),
                }
            )
            place += 1
    return out


def _steps(randomisation: Randomisation, parameter: str, low: float, high: float) -> dict[str, object]:
    """A range of times in control steps."""
    if parameter not in _TIMES or randomisation.control_step is None:
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
    if not bounds:
        return {}
    names = dict.fromkeys(b.effect if b.joint is None else f"{b.effect} on {b.joint}" for b in bounds)
    return {"mjcf_note": f"Not seen and no number of corrected.xml, see unseen: {', '.join(names)}."}
