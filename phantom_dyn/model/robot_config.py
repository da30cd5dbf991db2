"""Read and check ``robot.yaml``: drives, gravity, loops and tolerances, which a URDF cannot state.

This module does not import Pinocchio.
"""

from __future__ import annotations

import re
import types
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from phantom_dyn.errors import RobotError, known_names, shortened
from phantom_dyn.model.files.settings_file import describe, read_settings

# The limits are far beyond any robot in SI units; squares and quotients of such numbers still fit into a float.
NonNegative = Annotated[float, Meta(ge=0, le=1e12, description="a number of 0 or more, at most 1e12")]
Positive = Annotated[float, Meta(ge=1e-12, le=1e12, description="a number above 0, from 1e-12 to 1e12")]
RelativeDeviation = Annotated[float, Meta(ge=0, le=100, description="a number of 0 or more, at most 100")]
Share = Annotated[float, Meta(ge=0, le=1, description="a share from 0 to 1")]
Delay = Annotated[float, Meta(ge=0, le=10, description="a number of 0 or more, at most 10 s")]
Ratio = Annotated[float, Meta(ge=-1e6, le=1e6, description="a number other than 0, from -1e6 to 1e6")]
Place = Annotated[float, Meta(ge=-1e6, le=1e6)]
Vector = Annotated[tuple[Place, Place, Place], Meta(description="three numbers such as [0, 0, -9.81], none beyond 1e6")]
Names = Annotated[list[str], Meta(description="a list of joint names")]
Table = Annotated[dict[str, dict[str, Any]], Meta(description="joint names, each with its keys")]
# Smallest magnitude of a gear ratio.
_LEAST_RATIO = 1e-6
_S = TypeVar("_S", bound=msgspec.Struct)


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of robot.yaml, in which an unknown key is an error."""


class ControllerConfig(_Strict, frozen=True):
    """Position controller of a joint: ``pd`` has gains on the joint side, ``duty`` has shares of the supply voltage.

    Attributes:
        kind: ``pd`` or ``duty``.
        kp: Gain on the position error [N m/rad or N/m], of ``pd``.
        kd: Gain on the velocity [N m s/rad or N s/m], of ``pd``.
        delay: Delay of the whole torque [s].
        reference_delay: Additional delay of the reference [s].
        gain: Share of the supply voltage per rad or m of position error, of ``duty``.
        limit: Largest share; None: the whole supply.
        drops_beyond: Position error [rad or m] beyond which the limit drops to ``drops_to``.
        drops_to: Largest share beyond that error.
    """

    kind: Literal["pd", "duty"] = "pd"
    kp: NonNegative | None = None
    kd: NonNegative | None = None
    delay: Delay = 0.0
    reference_delay: Delay = 0.0
    gain: Positive | None = None
    limit: Share | None = None
    drops_beyond: Positive | None = None
    drops_to: Share | None = None


class JointConfig(_Strict, frozen=True):
    """Drive of a joint; None for values that the file does not state.

    ``drive: unknown`` states that the torque that moves the joint is unknown: the motion of the joint is used, and its
    torque is not judged.
    """

    rotor_inertia: NonNegative | None = None
    gear_ratio: Ratio = 1.0
    torque_constant: Positive | None = None
    torque_limit: Positive | None = None
    encoder_counts: Positive | None = None
    encoder_side: Literal["motor", "link"] = "motor"
    actuated: bool = True
    drive: Literal["unknown"] | None = None
    resistance: Positive | None = None
    voltage_limit: Positive | None = None
    controller: ControllerConfig | None = None


class ToleranceConfig(_Strict, frozen=True):
    """Relative standard deviations of the model's values; 0 means exact."""

    inertia: RelativeDeviation = 0.05
    friction: RelativeDeviation = 0.05
    rotor_inertia: RelativeDeviation = 0.10


class LinearLoop(_Strict, frozen=True):
    """Closed chain whose passive joints are linear in the active ones."""

    kind: Literal["linear"]
    active: Names
    passive: Annotated[dict[str, str], Meta(description='joint names, each with a formula such as "j5 - j2"')]


class _AnchorLoop(_Strict, frozen=True):
    """Closed chain that keeps two frames together.

    Of the joints between the frames, those in ``active`` are driven and the others are passive. Without ``active``,
    those with ``actuated: false`` are passive. The loop is assembled near the positions in ``start``; a joint that is
    not in ``start`` starts at 0.
    """

    frame_a: Annotated[str, Meta(description="the name of a frame")]
    frame_b: Annotated[str, Meta(description="the name of a frame")]
    active: Names | None = None
    start: Annotated[dict[str, Place], Meta(description="joint names, each with a position")] | None = None


class PointLoop(_AnchorLoop, frozen=True, kw_only=True):
    """Closed chain that keeps the origins of two frames together."""

    kind: Literal["point"] = "point"


class FrameLoop(_AnchorLoop, frozen=True, kw_only=True):
    """Closed chain that keeps the origins and the axes of two frames together."""

    kind: Literal["frame"] = "frame"


class RobotConfig(_Strict, frozen=True):
    """Content of a ``robot.yaml``. Names of joints and frames are not checked here, because this needs the robot.

    With ``torque_hold: zoh`` a logged torque acts until the next sample; with ``instant`` it was read at its sample.
    ``reference_hold`` states the same of logged references; with None the recording decides between the two.
    """

    gravity: Vector | None = None
    base: Literal["fixed", "floating"] | None = None
    torque_hold: Literal["zoh", "instant"] = "instant"
    reference_hold: Literal["zoh", "instant"] | None = None
    torque_source: Literal["command", "current", "sensor"] = "command"
    tolerance: ToleranceConfig = ToleranceConfig()
    joints: Annotated[dict[str, JointConfig], Meta(description="joint names, each with its keys")] = {}
    lock: Names = []
    payload_frame: Annotated[str, Meta(description="the name of a frame")] | None = None
    loops: Annotated[list[LinearLoop | PointLoop | FrameLoop], Meta(description="a list of loops")] = []


class _File(RobotConfig, frozen=True):
    """`RobotConfig` with unchecked joints and loops.

    They are checked one by one, because msgspec does not report in which joint or loop it found a mistake.
    """

    joints: Table = {}  # pyright: ignore[reportIncompatibleVariableOverride]
    loops: Annotated[list[dict[str, Any]], Meta(description="a list of loops")] = []  # pyright: ignore[reportIncompatibleVariableOverride]


def read_robot_config(path: Path) -> RobotConfig:
    """Read a ``robot.yaml``.

    Raises:
        RobotError: If the file cannot be read, is broken, or a key or value is unknown.
    """
    raw = read_settings(path, RobotError)
    content = _convert(raw, _File, path, "")
    joints = {name: _convert(keys, JointConfig, path, f"joints.{name}.") for name, keys in content.joints.items()}
    for name, joint in joints.items():
        if abs(joint.gear_ratio) < _LEAST_RATIO:
            wanted = wanted_value(JointConfig, ["gear_ratio"])
            raise RobotError(f"{path}: joints.{name}.gear_ratio is {joint.gear_ratio:g}, wanted {wanted}.")
        if joint.controller is not None:
            _check_controller(joint, joint.controller, path, f"joints.{name}")
    loops = [_loop(loop, path, f"loops[{index}].") for index, loop in enumerate(content.loops)]
    values = {field: getattr(content, field) for field in content.__struct_fields__}
    return RobotConfig(**(values | {"joints": joints, "loops": loops}))


def _check_controller(joint: JointConfig, stated: ControllerConfig, path: Path, key: str) -> None:
    """Refuse keys of the other kind of controller, and a ``duty`` controller whose torque cannot be computed."""
    gains, shares = ("kp", "kd"), ("gain", "limit", "drops_beyond", "drops_to")
    of_other_kind = shares if stated.kind == "pd" else gains
    wrong = [name for name in of_other_kind if getattr(stated, name) is not None]
    if wrong:
        wanted = "kp and kd" if stated.kind == "pd" else "gain, limit, drops_beyond and drops_to"
        raise RobotError(f"{path}: {key}.controller.{wrong[0]} is no key of kind {stated.kind}, which has {wanted}.")
    if stated.kind == "pd":
        return
    if stated.gain is None:
        raise RobotError(f"{path}: {key}.controller.gain is missing, wanted the share of the supply per rad of error.")
    lacking = [name for name in ("torque_constant", "resistance", "voltage_limit") if getattr(joint, name) is None]
    if lacking:
        raise RobotError(
            f"{path}: {key}.{lacking[0]} is missing: a controller of kind duty gives a share of the supply "
            "(voltage_limit), and resistance and torque_constant make a torque of it."
        )
    if (stated.drops_beyond is None) != (stated.drops_to is None):
        raise RobotError(f"{path}: {key}.controller has one of drops_beyond and drops_to; give both, or neither.")


def _loop(raw: dict[str, Any], path: Path, prefix: str) -> LinearLoop | PointLoop | FrameLoop:
    """One checked loop; ``prefix`` is its key in the file, for messages."""
    kinds = {"linear": LinearLoop, "point": PointLoop, "frame": FrameLoop}
    kind = raw.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise RobotError(f"{path}: {prefix}kind is {describe(kind)}, wanted one of {', '.join(kinds)}.")
    return _convert(raw, kinds[kind], path, prefix)


def _convert(raw: dict[str, Any], struct: type[_S], path: Path, prefix: str) -> _S:
    """Convert ``raw`` to ``struct``; every error message names the file, the key, the value and what was wanted."""
    try:
        return msgspec.convert(raw, struct)
    except msgspec.ValidationError as problem:
        place = re.search(r"\$((?:\.\w+)+)", str(problem))
        keys = place.group(1).strip(".").split(".") if place else []
        field = re.search(r"(unknown|required) field `(.+?)`", str(problem))
        raise RobotError(f"{path}: {_refusal(raw, struct, keys, field and field.groups(), prefix)}") from problem


def _refusal(
    raw: Any, struct: type[msgspec.Struct], keys: list[str], field: tuple[str, ...] | None, prefix: str
) -> str:
    """Error message for the value under ``keys``, or for its ``field`` that is unknown or missing."""
    if field is not None:
        kind, name = field
        full = prefix + ".".join([*keys, name])
        if kind == "unknown":
            return f"there is no key {shortened(full)}, {known_names(name, _fields(struct, keys), 'keys')}"
        return f"{full} is missing, wanted {wanted_value(struct, [*keys, name])}."
    value = raw
    for key in keys:
        value = value[key]
    place = (prefix + ".".join(keys)).strip(".") or "the file"
    return f"{place} is {describe(value)}, wanted {wanted_value(struct, keys)}."


def _fields(struct: type[msgspec.Struct], keys: list[str]) -> tuple[str, ...]:
    """Keys that the table under ``keys`` may have."""
    for key in keys:
        struct = next(t for t in _alternatives(get_type_hints(struct)[key]) if issubclass(t, msgspec.Struct))
    return struct.__struct_fields__


def _alternatives(annotation: Any) -> tuple[Any, ...]:
    """Members of a union without None; any other type alone."""
    if get_origin(annotation) in (Union, types.UnionType):
        return tuple(member for member in get_args(annotation) if member is not type(None))
    return (annotation,)


def wanted_value(struct: type[msgspec.Struct], keys: list[str]) -> str:
    """Words for the values that the key path ``keys`` of ``struct`` takes."""
    annotation: Any = struct
    for key in keys:
        if not (isinstance(annotation, type) and issubclass(annotation, msgspec.Struct)):
            break
        annotation = _alternatives(get_type_hints(annotation, include_extras=True)[key])[0]
    if get_origin(annotation) is Annotated:
        return annotation.__metadata__[0].description
    if get_origin(annotation) is Literal:
        return f"one of {', '.join(get_args(annotation))}"
    if annotation is bool:
        return "true or false"
    return f"a table with some of the keys {', '.join(annotation.__struct_fields__)}"
