"""Builds a new MJCF of a corrected model, with all findings that MuJoCo can express.

- Springs at joints: ``stiffness`` and ``springref`` of the joint. Encoder zeros: ``ref`` of the joint.
- Backlash and springs of transmissions: a second joint on the same axis. Couplings: fixed tendons.
- Actuators: constant torques are the bias, torque constants ``gear``, limits ``forcerange``, delays ``delay``, lags
  ``dyntype``.
- Cogging: a ``dcmotor`` without a command.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from identification.export.corrected.corrected_model import CorrectedModel
from identification.export.model_files.mjcf_file import mjcf_text
from identification.export.model_files.urdf_file import attribute_text
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.effects.simulated import SPRING_DAMPING
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.model.robot_xml import Element

PLAY, SPRING, COGGING, COUPLING = "{}_play", "{}_spring", "{}_cogging_{}", "{}_{}_coupling"
"""Names of the elements that are added for a joint, or for two."""

SHORTEST_STEP = 1e-4
"""Shortest step of a simulation [s] for which the buffers of past commands are long enough for the delays."""
# Motor constant [N m/A] of a motor without torque. MuJoCo needs a positive one; with one ohm its torque is negligible.
_NO_MOTOR = 1e-9
# A rotor behind backlash or a spring needs an inertia. If it is unknown, this share of the link's inertia is used.
_LEAST_ROTOR = 0.01
# Time constant [s] of the contact at the ends of backlash: twice MuJoCo's usual step, the stiffest possible contact.
_STOP = 0.004


def corrected_mjcf(corrected: CorrectedModel) -> str:
    """The text of an MJCF with one actuator for each driven joint, followed by the actuators for cogging.

    Raises:
        ParameterError: If a body cannot exist, or MuJoCo does not accept it.
    """
    root = corrected_elements(corrected)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def corrected_elements(corrected: CorrectedModel) -> ElementTree.Element:
    """The root element of `corrected_mjcf`, which raises the same errors."""
    root = ElementTree.fromstring(mjcf_text(corrected.robot))
    joints = {str(joint.get("name")): joint for joint in root.iter("joint")}
    bodies = {str(joint.get("name")): body for body in root.iter("body") for joint in body.findall("joint")}
    for name, (stiffness, rest) in corrected.springs.items():
        joints[name].set("stiffness", repr(stiffness))
        joints[name].set("springref", repr(rest))
    for name, zero in zeros_in_file(corrected).items():
        _move_zero(joints[name], zero)
    for name in (*corrected.plays, *compliances_in_mjcf(corrected)):
        _second_joint(bodies[name], joints[name], corrected, name)
    for motor in root.findall("actuator/motor"):
        _set_drive(motor, corrected, str(motor.get("joint")))
    add_cogging(root, corrected)
    add_couplings(root, corrected)
    return root


def zeros_in_file(corrected: CorrectedModel) -> dict[str, float]:
    """Encoder zeros that a URDF or MJCF can state; without those of joints in a loop, which would change the loop."""
    chain = corrected.robot.chain
    if chain is None:
        return corrected.zeros
    if chain.anchors:
        return {}
    # A column of the map has a number other than zero for each joint that the active joint moves, itself included.
    moves_no_other = np.count_nonzero(chain.linear_map, axis=0) == 1
    names = [name for name, alone in zip(corrected.robot.joint_names, moves_no_other, strict=True) if alone]
    return {name: zero for name, zero in corrected.zeros.items() if name in names}


def compliances_in_mjcf(corrected: CorrectedModel) -> dict[str, float]:
    """Springs of transmissions in the MJCF; those on joints with backlash are left out.

    The body between a spring and a backlash would have no inertia, which MuJoCo refuses.
    """
    return {name: stiffness for name, stiffness in corrected.compliances.items() if name not in corrected.plays}


def rotor_of(corrected: CorrectedModel, joint: str) -> float:
    """Rotor inertia on the motor's side of backlash or a spring [kg m^2 or kg]; if unknown, a share of the link's."""
    row = row_of(corrected.robot, joint)
    known = float(corrected.robot.rotor_inertia[row])
    return known if known > 0 else _LEAST_ROTOR * _moved_inertia(corrected, row)


def _moved_inertia(corrected: CorrectedModel, row: int) -> float:
    """Inertia that a joint moves in the zero posture, without its rotor."""
    mass = mass_matrix(corrected.robot, np.zeros((1, corrected.robot.nv)))
    return float(mass[0, row, row] - corrected.robot.rotor_inertia[row])


def _move_zero(joint: Element, zero: float) -> None:
    """Shift the zero of a joint and its limits."""
    joint.set("ref", repr(zero))
    limits = joint.get("range")
    if limits is not None:
        joint.set("range", attribute_text([float(limit) + zero for limit in limits.split()]))


def _second_joint(body: Element, joint: Element, corrected: CorrectedModel, name: str) -> None:
    """Add a joint on the same axis, between motor and link."""
    joint.set("armature", repr(rotor_of(corrected, name)))
    place = {"type": str(joint.get("type")), "axis": str(joint.get("axis"))}
    element = ElementTree.Element("joint", second_joint(corrected, name) | place)
    body.insert(list(body).index(joint) + 1, element)


def second_joint(corrected: CorrectedModel, name: str) -> dict[str, str]:
    """Attributes of the joint between motor and link: with a range for backlash, with a spring for compliance.

    Args:
        corrected: The corrected model.
        name: Name of the joint that has backlash or a spring.
    """
    if name in corrected.plays:
        half = 0.5 * corrected.plays[name]
        return {"name": PLAY.format(name), "range": attribute_text([-half, half]), "solreflimit": f"{_STOP} 1"}
    stiffness, rotor = corrected.compliances[name], rotor_of(corrected, name)
    link = _moved_inertia(corrected, row_of(corrected.robot, name))
    # Rotor and link oscillate against each other with the inertia rotor * link / (rotor + link).
    damping = 2.0 * SPRING_DAMPING * np.sqrt(stiffness * rotor * link / (rotor + link))
    return {"name": SPRING.format(name), "stiffness": repr(stiffness), "damping": repr(float(damping))}


def _set_drive(motor: Element, corrected: CorrectedModel, name: str) -> None:
    """Write the findings on the drive of a joint into its actuator."""
    gain = corrected.gains.get(name, 1.0)
    bias = corrected.offsets.get(name, 0.0) / gain if gain else 0.0
    if gain != 1.0:
        motor.set("gear", repr(gain))
    if name in corrected.limits:
        # The limit is one of the command. MuJoCo limits command plus bias, so the range is shifted by the bias.
        motor.set("forcerange", attribute_text([bias - corrected.limits[name], bias + corrected.limits[name]]))
    if bias:
        motor.tag = "general"
        motor.set("biastype", "affine")
        motor.set("biasprm", repr(bias))
    if corrected.lags.get(name, 0.0) > 0:
        motor.tag = "general"
        motor.set("dyntype", "filterexact")
        motor.set("dynprm", repr(corrected.lags[name]))
    delay = corrected.delays.get(name, 0.0)
    if delay > 0:
        set_delay(motor, delay)


def set_delay(actuator: Element, delay: float) -> None:
    """Delay the command of an actuator by a time [s], with a buffer that is long enough for `SHORTEST_STEP`."""
    actuator.set("delay", repr(delay))
    actuator.set("nsample", str(int(np.ceil(delay / SHORTEST_STEP)) + 2))
    actuator.set("interp", "linear")


def add_cogging(root: Element, corrected: CorrectedModel) -> None:
    """Add an actuator without a command for each wave, after all others.

    Args:
        root: Root element of the MJCF; changed.
        corrected: The corrected model.
    """
    if not corrected.cogging:
        return
    groups = root.findall("actuator")
    actuators = groups[-1] if groups else ElementTree.SubElement(root, "actuator")
    for name, waves in corrected.cogging.items():
        for k, (order, amplitude, phase) in enumerate(waves):
            wave = {
                "name": COGGING.format(name, k + 1),
                "joint": name,
                "cogging": attribute_text([amplitude, order, phase]),
            }
            no_command = {"motorconst": f"{_NO_MOTOR} 0", "resistance": "1", "ctrlrange": "0 0"}
            ElementTree.SubElement(actuators, "dcmotor", wave | no_command)


def add_couplings(root: Element, corrected: CorrectedModel) -> None:
    """Add a tendon for each coupling of two joints.

    Args:
        root: Root element of the MJCF; changed.
        corrected: The corrected model.
    """
    if not corrected.couplings:
        return
    tendons = ElementTree.SubElement(root, "tendon")
    for coupling in corrected.couplings:
        sizes = {"frictionloss": coupling.coulomb_torque, "damping": coupling.coefficient, "armature": coupling.inertia}
        texts = {key: repr(max(value, 0.0)) for key, value in sizes.items()}
        name = COUPLING.format(coupling.first, coupling.second)
        tendon = ElementTree.SubElement(tendons, "fixed", {"name": name, **texts})
        for joint, share in ((coupling.first, 1.0), (coupling.second, coupling.ratio)):
            ElementTree.SubElement(tendon, "joint", joint=joint, coef=repr(share))
