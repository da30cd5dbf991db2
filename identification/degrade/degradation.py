"""One effect that makes a device cheaper: checked for its place and the bounds of its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot

Values = Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Degradation:
    """An effect that the cheaper device has and the recorded one has not.

    Attributes:
        effect: Of the catalogue.
        joint: Where it sits; None is the whole robot.
        theta: The contract's parameters in order.
    """

    effect: Effect
    joint: str | None
    theta: tuple[float, ...]


def degradation(robot: Robot, effect: str, joint: str | None, values: Values) -> Degradation:
    """An effect in its place, checked.

    Args:
        robot: The robot that was recorded.
        effect: Name of the catalogue.
        joint: Joint, two joints joined by ``+``, or None for the whole robot.
        values: Numbers of each parameter by name; several of one name for an effect that takes lists.

    Raises:
        ParameterError: If effect, joint or a parameter is unknown, missing or out of bounds; the text lists what there
            is, with units and bounds.
    """
    found = effect_named(effect, robot)
    _require_place(robot, found, joint)
    known, optional = found.parameters(robot, joint), found.optional_parameters(robot, joint)
    names = [parameter.name for parameter in (*known, *optional)]
    for name in values:
        if name not in names:
            raise ParameterError(f"{effect} has no parameter '{name}': {_listed(effect, (*known, *optional))}")
    taken = known if not any(parameter.name in values for parameter in optional) else (*known, *optional)
    theta: list[float] = []
    for parameter in taken:
        given = values.get(parameter.name, None if parameter.default is None else (parameter.default,))
        if given is None:
            raise ParameterError(f"{effect} lacks its parameter {parameter.name}: {_listed(effect, taken)}")
        _require_bounds(effect, parameter, given)
        theta += given
    _require_counts(effect, values, lists=found.takes_lists(robot, joint))
    return Degradation(found, joint, tuple(theta))


def _require_place(robot: Robot, effect: Effect, joint: str | None) -> None:
    places = effect.places(robot)
    if effect.can_sit(robot, joint):
        return
    if places == (None,):
        raise ParameterError(f"{effect.name} is of the whole robot, not of joint '{joint}': leave the joint out.")
    names = ", ".join(place for place in places if place is not None)
    if not names:
        raise ParameterError(f"{effect.name} has no place on {robot.name} of one joint: choose another effect.")
    where = "no joint was given" if joint is None else f"'{joint}' was given"
    raise ParameterError(f"{effect.name} needs a place and {where}: give one of {names}.")


def _require_bounds(effect: str, parameter: Parameter, given: tuple[float, ...]) -> None:
    for value in given:
        if not (np.isfinite(value) and parameter.lower <= value <= parameter.upper):
            raise ParameterError(
                f"{parameter.name}={value:g} of {effect} is out of bounds: wanted {_words(parameter)}."
            )
        if value == 0 and parameter.above_zero:
            raise ParameterError(f"{parameter.name}=0 of {effect} is out of bounds: wanted a number above 0.")


def _require_counts(effect: str, values: Values, *, lists: bool) -> None:
    counts = {name: len(given) for name, given in values.items()}
    if lists:
        if len(set(counts.values())) > 1:
            given = ", ".join(f"{count} of {name}" for name, count in counts.items())
            raise ParameterError(f"{effect} was given {given}: give as many numbers of each, separated by commas.")
        return
    for name, count in counts.items():
        if count != 1:
            raise ParameterError(f"{name} of {effect} was given {count} numbers: it takes one.")


def _listed(effect: str, parameters: tuple[Parameter, ...]) -> str:
    return f"the parameters of {effect} are {', '.join(_words(parameter) for parameter in parameters)}."


def _words(parameter: Parameter) -> str:
    """A parameter with its bounds, as in ``torque [N m] of 0 or more``."""
    low, high = parameter.lower, parameter.upper
    unit = "" if parameter.unit == "1" else f" [{parameter.unit}]"
    if np.isfinite(low) and np.isfinite(high):
        return f"{parameter.name}{unit} from {low:.4g} to {high:.4g}"
    if np.isfinite(low):
        return f"{parameter.name}{unit} of {low:.4g} or more"
    return f"{parameter.name}{unit} of any size"
