"""Writes findings on drives into the existing actuators of an MJCF.

- An actuator whose torque is its command times its gear (``motor``, or ``general`` without a bias) can express all
  findings except a delay of references.
- A servo, whose command is a reference, can express a delay of references and a torque limit. Other findings would
  change its feedback.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from identification.export.corrected.corrected_mjcf import set_delay
from identification.export.corrected.corrected_model import CorrectedModel
from identification.export.corrected.mjcf_defaults import GivenMjcf, given_mjcf
from identification.export.model_files.urdf_file import attribute_text
from identification.notes import Code, Note
from phantom_dyn.model.robot_xml import Element

_REFERENCES = "delay of references"


def can_delay_references(corrected: CorrectedModel, joint: str) -> bool:
    """True if the given file is an MJCF with a servo on a joint: the servo's command is a reference and can be delayed.

    Args:
        corrected: The corrected model.
        joint: Name of the joint.
    """
    file = Path(corrected.given.source)
    if not file.is_file() or file.suffix != ".xml":
        return False
    given = given_mjcf(ElementTree.parse(file).getroot())
    actuators = _actuators_of(given, joint)
    return len(actuators) == 1 and _is_servo(given, actuators[0])


def _actuators_of(given: GivenMjcf, name: str) -> list[Element]:
    """The actuators of a joint."""
    return [
        actuator
        for group in given.root.iter("actuator")
        for actuator in group
        if name in (actuator.get("joint"), actuator.get("jointinparent"))
    ]


def _is_servo(given: GivenMjcf, actuator: Element) -> bool:
    """True if the command of an actuator is a reference position."""
    if actuator.tag == "position":
        return True
    return actuator.tag == "general" and given.attribute(actuator, "biastype") == "affine"


def set_drives(given: GivenMjcf, corrected: CorrectedModel) -> dict[str, Note]:
    """Write torque constants, limits, constant torques, lags and delays into the actuators of the file.

    Args:
        given: The file; changed.
        corrected: The corrected model.

    Returns:
        Notes on the numbers that cannot be written, by joint.
    """
    out: dict[str, Note] = {}
    for name in corrected.robot.joint_names:
        found = _numbers_of(corrected, name)
        if not found:
            continue
        actuators = _actuators_of(given, name)
        if len(actuators) != 1:
            out[name] = Note(Code.NO_PLACE_FOR_DRIVE, name, {"values": found, "actuators": len(actuators)})
        elif _is_torque_times_gear(given, actuators[0]):
            _set_torque_drive(given, actuators[0], corrected, name)
            if _REFERENCES in found:
                numbers = {"quantity": "reference_delay", "values": {name: found[_REFERENCES]}}
                out[name] = Note(Code.NO_PLACE, None, numbers)
        else:
            if _is_servo(given, actuators[0]) and _REFERENCES in found:
                set_delay(actuators[0], found.pop(_REFERENCES))
            limit = found.pop("limit", None)
            if limit is not None:
                _set_limit(given, actuators[0], limit, 0.0)
            if found:
                numbers = {"values": found, "actuators": 1, "kind": actuators[0].tag}
                out[name] = Note(Code.NO_PLACE_FOR_DRIVE, name, numbers)
    return out


def _numbers_of(corrected: CorrectedModel, name: str) -> dict[str, float]:
    """The findings on a drive as numbers, by name; a torque limit only if it differs from the given one."""
    stated = corrected.given.actuators[corrected.given.joint_names.index(name)].torque_limit
    limit, gain = corrected.limits.get(name), corrected.gains.get(name, 1.0)
    numbers = {
        "torque constant": None if gain == 1.0 else gain,
        "limit": None if limit is None or limit == stated else limit,
        "constant torque": corrected.offsets.get(name),
        "lag": corrected.lags.get(name),
        "delay": corrected.delays.get(name),
        _REFERENCES: corrected.reference_delays.get(name),
    }
    return {what: value for what, value in numbers.items() if value}


def _is_torque_times_gear(given: GivenMjcf, actuator: Element) -> bool:
    """True if the torque of an actuator is its command times its gear, without bias or dynamics."""
    if actuator.tag == "motor":
        return True
    usual = (("gaintype", "fixed"), ("biastype", "none"), ("dyntype", "none"))
    return actuator.tag == "general" and all(given.attribute(actuator, key) in (None, word) for key, word in usual)


def _gear(given: GivenMjcf, actuator: Element) -> list[float]:
    return [float(x) for x in (given.attribute(actuator, "gear") or "1").split()]


def _set_limit(given: GivenMjcf, actuator: Element, limit: float, bias: float) -> None:
    """Write a limit of the joint torque; the actuator states it on the motor side of its gear."""
    force = limit / abs(_gear(given, actuator)[0])
    actuator.set("forcerange", attribute_text([bias - force, bias + force]))
    actuator.set("forcelimited", "true")


def _set_torque_drive(given: GivenMjcf, actuator: Element, corrected: CorrectedModel, name: str) -> None:
    """Write all findings on a drive into an actuator whose torque is command times gear."""
    found, gear = _numbers_of(corrected, name), _gear(given, actuator)
    gain = corrected.gains.get(name, 1.0)
    bias = corrected.offsets.get(name, 0.0) / (gear[0] * gain) if gain * gear[0] else 0.0
    if "limit" in found:
        _set_limit(given, actuator, found["limit"], bias)
    if gain != 1.0:
        actuator.set("gear", attribute_text([gear[0] * gain, *gear[1:]]))
    if bias or found.get("lag"):
        _as_general(given, actuator)
    if bias:
        actuator.set("biastype", "affine")
        actuator.set("biasprm", repr(bias))
    if found.get("lag"):
        actuator.set("dyntype", "filterexact")
        actuator.set("dynprm", repr(found["lag"]))
    if found.get("delay"):
        set_delay(actuator, found["delay"])


def _as_general(given: GivenMjcf, actuator: Element) -> None:
    """Change a ``motor`` to an equivalent ``general`` element that states its attributes and inherits no defaults."""
    if actuator.tag != "motor":
        return
    stated = {key: text for key in ("ctrlrange", "forcerange") if (text := given.attribute(actuator, key)) is not None}
    actuator.tag = "general"
    for key, word in ({"gaintype": "fixed", "gainprm": "1", "biastype": "none", "dyntype": "none"} | stated).items():
        actuator.set(key, word)
