"""Writes ``corrected.yaml`` (schema ``phantom-dyn-model/1``) with the corrections, and reads it as known effects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from identification.diagnosis.columns.known_geometry import POSE_EFFECTS
from identification.diagnosis.columns.operations import with_known_payloads
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Adjusted, Diagnosis, Value
from identification.export.corrected.found_effects import findings_in_all_recordings
from identification.geometry.pins import loops_of
from identification.geometry.terms import BASE_POSE, LINK, PARTS, PLACES, TOOL_POSE, ZERO
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Parameter
from phantom_dyn.errors import ParameterError, PhantomDynError, RobotError, UsageError, known_names, shortened
from phantom_dyn.model.files.settings_file import (
    LARGEST,
    describe,
    list_at,
    load_mapping,
    mapping_at,
    number_at,
    text_at,
)
from phantom_dyn.model.files.strict_yaml import settings_text
from phantom_dyn.model.robot import Robot

SCHEMA = "phantom-dyn-model/1"
ROBOT_KEYS = ("source", "sha256")
EFFECT_KEYS = ("effect", "joint", "parameters", "gap_closed")
VALUE_KEYS = ("value", "std", "unit")
_ROUNDING = 1e-9
"""Relative amount by which a value at a bound may exceed the bound because of rounding."""
ADJUSTED_KEYS = ("quantity", "change", "tolerance")


@dataclass(frozen=True)
class CorrectedEffect:
    """One effect to add to the model; `gap_closed` is the share of the gap that it closes, NaN if unknown."""

    effect: str
    joint: str | None
    parameters: Mapping[str, Value]
    gap_closed: float


@dataclass(frozen=True)
class ModelError:
    """Root mean square error of the corrected model on a joint, without noise. It is not a torque to add to the model.

    Attributes:
        joint: Name of the joint.
        slow: Error while the joint moves slowly or reverses.
        moving: Error at all other times.
        unit: Unit of both errors.
    """

    joint: str
    slow: float
    moving: float
    unit: str


@dataclass(frozen=True)
class Corrected:
    """Content of a ``corrected.yaml``.

    Attributes:
        robot: File or name of the robot that was diagnosed.
        sha256: Hash of the robot file.
        effects: Effects to add to the robot.
        adjusted: Changes of the robot within its tolerances.
        model_error: Remaining errors of the corrected model.
    """

    robot: str
    sha256: str
    effects: tuple[CorrectedEffect, ...]
    adjusted: tuple[Adjusted, ...]
    model_error: tuple[ModelError, ...] = ()


def write_corrected(diagnosis: Diagnosis, robot_source: str, sha256: str) -> str:
    """The text of ``corrected.yaml`` with all findings, except those that act in one recording only.

    An encoder zero that was found from both torques and poses is written once, with the value from the torques.

    Args:
        diagnosis: The diagnosis.
        robot_source: File or name of the robot that was diagnosed.
        sha256: Hash of the robot file.

    Raises:
        ParameterError: If the value of a parameter is not finite.
    """
    effects = tuple(
        CorrectedEffect(f.effect, f.joint, f.parameters, f.gap_closed) for f in findings_in_all_recordings(diagnosis)
    )
    effects = (*effects, *_by_poses(diagnosis, {one.joint for one in effects if one.effect == ZERO}))
    wrong = tuple(
        ModelError(one.joint, *one.left, one.unit) for one in diagnosis.joints if one.left is not None and any(one.left)
    )
    return corrected_text(Corrected(robot_source, sha256, effects, diagnosis.adjusted, wrong))


def _by_poses(diagnosis: Diagnosis, known_zeros: set[str | None]) -> tuple[CorrectedEffect, ...]:
    """Findings of measured poses as effects, without zeros that are already known from the torques."""
    found = () if diagnosis.geometry is None else diagnosis.geometry.findings
    return tuple(
        CorrectedEffect(
            one.effect,
            one.joint,
            {name: Value(number.value, number.std, number.unit) for name, number in one.parameters.items()},
            one.gap_closed,
        )
        for one in found
        if not (one.effect == ZERO and one.joint in known_zeros)
    )


def corrected_text(corrected: Corrected) -> str:
    """The text of a ``corrected.yaml``; nothing is rounded.

    Raises:
        ParameterError: If the value of a parameter is not finite.
    """
    content = {
        "schema": SCHEMA,
        "robot": {"source": corrected.robot, "sha256": corrected.sha256},
        "effects": [_effect_entry(effect) for effect in corrected.effects],
        "adjusted": [
            {"quantity": a.quantity, "change": float(a.change), "tolerance": float(a.tolerance)}
            for a in corrected.adjusted
        ],
    }
    if corrected.model_error:
        content["model_error"] = [asdict(one) for one in corrected.model_error]
    return settings_text(content)


def read_corrected(path: str | Path) -> Corrected:
    """The content of a ``corrected.yaml``.

    Raises:
        RobotError: If the file cannot be read or is not YAML.
        ParameterError: If a key is missing or unknown, or a value is of the wrong kind.
    """
    content = load_mapping(Path(path), RobotError)
    file = str(path)
    if content.get("schema") != SCHEMA:
        given = f"schema is {describe(content['schema'])}" if "schema" in content else "there is no key schema"
        raise ParameterError(f"{file}: {given}, wanted {SCHEMA}: give the corrected.yaml of a diagnosis.")
    # The key is optional: files of earlier versions do not have it, nor files whose residual is only noise.
    errors = list_at(content.get("model_error", []), file, "model_error")
    required_content = {key: value for key, value in content.items() if key != "model_error"}
    top = mapping_at(required_content, file, "", ("schema", "robot", "effects", "adjusted"))
    robot = mapping_at(top["robot"], file, "robot", ROBOT_KEYS)
    return Corrected(
        robot=text_at(robot["source"], file, "robot.source"),
        sha256=text_at(robot["sha256"], file, "robot.sha256"),
        effects=tuple(
            _effect(entry, file, f"effects[{k}]") for k, entry in enumerate(list_at(top["effects"], file, "effects"))
        ),
        adjusted=tuple(
            _adjusted(entry, file, f"adjusted[{k}]")
            for k, entry in enumerate(list_at(top["adjusted"], file, "adjusted"))
        ),
        model_error=tuple(_model_error(entry, file, f"model_error[{k}]") for k, entry in enumerate(errors)),
    )


def _model_error(entry: Any, file: str, key: str) -> ModelError:
    error = mapping_at(entry, file, key, ("joint", "slow", "moving", "unit"))
    slow, moving = (number_at(error[name], file, f"{key}.{name}") for name in ("slow", "moving"))
    if min(slow, moving) < 0:
        raise ParameterError(f"{file}: {key} is {min(slow, moving):g}, wanted a root mean square of 0 or more.")
    return ModelError(text_at(error["joint"], file, f"{key}.joint"), slow, moving, text_at(error["unit"], file, key))


def _effect_entry(effect: CorrectedEffect) -> dict[str, object]:
    return {
        "effect": effect.effect,
        "joint": effect.joint,
        "parameters": {name: _value_entry(effect.effect, name, value) for name, value in effect.parameters.items()},
        "gap_closed": _finite_or_none(effect.gap_closed),
    }


def _value_entry(effect: str, name: str, value: Value) -> dict[str, object]:
    if not all(map(math.isfinite, value.numbers)):
        raise ParameterError(
            f"{name} of {effect} is {value.value}, wanted a finite number: it cannot be added to a model."
        )
    numbers, stds = [float(x) for x in value.numbers], [_finite_or_none(std) for std in value.stds]
    if isinstance(value.value, list):
        return {"value": numbers, "std": stds, "unit": value.unit}
    return {"value": numbers[0], "std": stds[0], "unit": value.unit}


def _finite_or_none(number: float) -> float | None:
    return float(number) if math.isfinite(number) else None


def _effect(entry: Any, file: str, key: str) -> CorrectedEffect:
    effect = mapping_at(entry, file, key, EFFECT_KEYS)
    parameters = mapping_at(effect["parameters"], file, f"{key}.parameters", None)
    return CorrectedEffect(
        effect=text_at(effect["effect"], file, f"{key}.effect"),
        joint=None if effect["joint"] is None else text_at(effect["joint"], file, f"{key}.joint"),
        parameters={name: _value(value, file, f"{key}.parameters.{name}") for name, value in parameters.items()},
        gap_closed=number_at(effect["gap_closed"], file, f"{key}.gap_closed", unknown=True),
    )


def _value(entry: Any, file: str, key: str) -> Value:
    value = mapping_at(entry, file, key, VALUE_KEYS)
    if not isinstance(value["value"], list):
        std = number_at(value["std"], file, f"{key}.std", unknown=True)
        return Value(number_at(value["value"], file, f"{key}.value"), std, text_at(value["unit"], file, f"{key}.unit"))
    values = [number_at(v, file, f"{key}.value[{k}]") for k, v in enumerate(value["value"])]
    stds = value["std"] if isinstance(value["std"], list) else None
    if stds is None or len(stds) != len(values):
        raise ParameterError(
            f"{file}: {key}.std is {describe(value['std'])}, wanted a list of {len(values)} numbers, one for each "
            "value."
        )
    std = [number_at(s, file, f"{key}.std[{k}]", unknown=True) for k, s in enumerate(stds)]
    return Value(values, std, text_at(value["unit"], file, f"{key}.unit"))


def _adjusted(entry: Any, file: str, key: str) -> Adjusted:
    adjusted = mapping_at(entry, file, key, ADJUSTED_KEYS)
    return Adjusted(
        text_at(adjusted["quantity"], file, f"{key}.quantity"),
        number_at(adjusted["change"], file, f"{key}.change"),
        number_at(adjusted["tolerance"], file, f"{key}.tolerance"),
    )


def known_effects(files: tuple[Path, ...], robot: Robot) -> tuple[KnownEffect, ...]:
    """The effects of several ``corrected.yaml``, in their order.

    Raises:
        ParameterError: If a file names an unknown effect, joint or parameter, or lacks a parameter.
        UsageError: If a file is given twice, so that its effects would be added twice.
    """
    places = [file.resolve() for file in files]
    for k, file in enumerate(files):
        if places[k] in places[:k]:
            raise UsageError(f"{file} is given twice, and its effects would be added twice: give each file once.")
    out: list[KnownEffect] = []
    for file in files:
        for entry in read_corrected(file).effects:
            # The robot carries the loads of earlier entries, because a later file may remove such a load.
            out.append(known_effect(entry, with_known_payloads(robot, out), file))
    return tuple(out)


def known_effect(entry: CorrectedEffect, robot: Robot, file: Path) -> KnownEffect:
    """One effect with its parameters in the order of the catalogue, checked against the robot.

    Args:
        entry: Entry of the file, not checked yet.
        robot: The robot to which the effect is to be added.
        file: The file, for messages.

    Raises:
        ParameterError: If the effect, its joint or a parameter is unknown, or a parameter is missing.
    """
    if entry.effect in POSE_EFFECTS:
        return _known_by_poses(entry, robot, file)
    try:
        effect = effect_named(entry.effect, robot)
    except PhantomDynError as error:
        raise ParameterError(f"{file}: {error}") from error
    if entry.joint is None and not effect.can_sit(robot, None):
        raise ParameterError(
            f"{file}: effect {entry.effect} has no joint, wanted one of {', '.join(robot.joint_names)}."
        )
    # An effect on the whole robot may name the joint of the link on which it acts.
    if not effect.can_sit(robot, entry.joint) and (effect.scope == "pair" or entry.joint not in robot.joint_names):
        raise ParameterError(
            f"{file}: effect {entry.effect} is on joint '{shortened(entry.joint or '')}', which this robot does not "
            f"have: {known_names(entry.joint or '', robot.joint_names, 'joints')}"
        )
    known = effect.parameters(robot, entry.joint)
    names = [parameter.name for parameter in known]
    _require_lengths(entry, file, lists=effect.takes_lists(robot, entry.joint))
    stated = effect.from_stated(robot, {name: value.value for name, value in entry.parameters.items()})
    unknown = sorted(set(stated) - set(names))
    # Changes of inertial parameters that the file does not name are zero.
    needed = {parameter.name for parameter in known if parameter.default is None}
    missing = [] if effect.inertial == "free" else sorted(needed - set(stated))
    if unknown or missing:
        raise ParameterError(
            f"{file}: effect {entry.effect} has parameters {shortened(', '.join(entry.parameters), 200)}, wanted "
            f"{', '.join(names)}: correct the file or diagnose again."
        )
    theta: list[float] = []
    for parameter in known:
        value = stated.get(parameter.name, parameter.default or 0.0)
        numbers = [float(x) for x in value] if isinstance(value, list) else [float(value)]
        _require_possible(parameter, numbers, f"{file}: {parameter.name} of {entry.effect}")
        theta += numbers
    return KnownEffect(entry.effect, entry.joint, tuple(theta))


def _known_by_poses(entry: CorrectedEffect, robot: Robot, file: Path) -> KnownEffect:
    """An effect of measured poses: a compliance, or a change of a pose, whose missing components are zero."""
    _require_carrier(entry, robot, file)
    wanted = PARTS if entry.effect in PLACES else ("compliance",)
    given = set(entry.parameters)
    if not given or not given <= set(wanted):
        raise ParameterError(
            f"{file}: effect {entry.effect} has parameters {shortened(', '.join(entry.parameters), 200)}, wanted "
            f"{' or '.join(wanted)}: correct the file or diagnose again."
        )
    theta = []
    for name in wanted:
        value = entry.parameters[name].value if name in given else 0.0
        if isinstance(value, list) or not abs(value) <= LARGEST:
            raise ParameterError(
                f"{file}: {name} of {entry.effect} is {value}, wanted a number of at most {LARGEST:g}."
            )
        theta.append(float(value))
    return KnownEffect(entry.effect, entry.joint, tuple(theta))


def _require_carrier(entry: CorrectedEffect, robot: Robot, file: Path) -> None:
    """Refuse a joint or frame that the robot does not have; the pose of the base must have no joint."""
    if entry.effect == BASE_POSE:
        if entry.joint is not None:
            raise ParameterError(
                f"{file}: {BASE_POSE} is on '{shortened(entry.joint)}', wanted null: it is the base's."
            )
        return
    what, names = "joint", robot.joint_names
    if entry.effect == TOOL_POSE:
        what, names = "frame", tuple(frame.name for frame in robot.model.frames)
    elif entry.effect == LINK and (loops := loops_of(robot)) is not None:
        names = (*names, *robot.passive_names, *loops.names)
    if entry.joint not in names:
        raise ParameterError(
            f"{file}: effect {entry.effect} is on {what} '{shortened(entry.joint or '')}', which this robot does not "
            f"have: {known_names(entry.joint or '', names, f'{what}s')}"
        )


def _require_lengths(entry: CorrectedEffect, file: Path, *, lists: bool) -> None:
    """Refuse lists for an effect that takes numbers, and lists of unequal length for an effect that takes lists."""
    values = {name: value.value for name, value in entry.parameters.items()}
    if not lists:
        wrong = [name for name, value in values.items() if isinstance(value, list)]
        if wrong:
            raise ParameterError(f"{file}: {wrong[0]} of {entry.effect} is a list, wanted a number: give one.")
        return
    # A number counts as a list with one entry: files that were written by hand or by earlier versions contain it.
    lengths = {name: len(value) if isinstance(value, list) else 1 for name, value in values.items()}
    if len(set(lengths.values())) > 1 or not all(lengths.values()):
        found = ", ".join(
            f"{name} {f'{lengths[name]} numbers' if isinstance(value, list) else 'one number'}"
            for name, value in values.items()
        )
        raise ParameterError(
            f"{file}: {entry.effect} has {found}, wanted lists of equal length with an entry for each wave: correct "
            "them."
        )


def _require_possible(parameter: Parameter, numbers: list[float], where: str) -> None:
    """Refuse a value outside the range of its parameter."""
    lower, upper = parameter.lower, parameter.upper
    for number in numbers:
        if not abs(number) <= LARGEST:
            raise ParameterError(f"{where} is {number:g} {parameter.unit}, wanted at most {LARGEST:g}: correct it.")
        low, high = (end + sign * _ROUNDING * max(1.0, abs(end)) for sign, end in ((-1, lower), (1, upper)))
        if not low <= number <= high or (parameter.above_zero and number == 0):
            raise ParameterError(
                f"{where} is {number:g} {parameter.unit}, wanted a value from {lower:g} to "
                f"{upper:g}{', not 0' if parameter.above_zero else ''}: correct the file."
            )
