"""Answers that count as the truth, because no data of that robot can distinguish them from it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

Claim = tuple[str, str | None]
FRICTION = ("coulomb_friction", "viscous_friction")


@dataclass(frozen=True)
class Explanation:
    """A set of effects that explains the case: all of ``needed``; those of ``allowed`` are no wrong extra claim."""

    needed: frozenset[Claim]
    allowed: frozenset[Claim] = frozenset()


def _one(*claims: Claim, allowed: tuple[Claim, ...] = ()) -> Explanation:
    return Explanation(frozenset(claims), frozenset(allowed))


# Joints whose rotor inertia regroups with a moment of their own link: the link turns about that axis with this joint
# alone (a first joint; a second one across it; BE and DF of the PHANToM, whose angles are counted from the base).
ROTOR_REGROUPS = {
    "pendulum": ("j1",),
    "planar2": ("j1",),
    "spatial3": ("j1", "j2"),
    "phantom": ("theta1", "theta2", "theta3"),
    "six": ("shoulder_pan_joint", "shoulder_lift_joint"),
    "panda": ("panda_joint1", "panda_joint2"),
    # Answers of the make `field` say by themselves what is alike.
    # Of the second make: also hinges across the one before them, and a carriage, whose rotor is mass that slides.
    "arm2": ("lift",),
    "arm3": ("waist", "shoulder"),
    "scara": ("inner",),
    "arm6": ("a1", "a2"),
    "gantry": ("carriage", "swing"),
    "pan_tilt": ("pan", "tilt"),
}
# Robots whose first joint is horizontal and carries the whole arm in one plane: a tilt is an offset of that joint.
TILTS_WITH_FIRST = ("pendulum", "planar2", "arm2")
PASSIVE = ("elbow", "crank")  # of the PHANToM: they turn at opposite speeds
COUPLED = ("joint_coupling", "theta2+theta3")  # what turns with the difference of their speeds, as a coupling


def _inertial_twins(name: str, joint: str | None, robot: str, joints: list[str]) -> list[Explanation]:
    """Payload, inertias of a link, its rotor and a torque constant, where they are one place."""
    single, out = robot == "pendulum", []
    if name == "inertial_parameters":
        # Without a joint it means the inertias of the whole robot: right, and less than could be said.
        out.append(_one((name, None)))
    if name == "payload" and single:
        out += [_one(("inertial_parameters", where)) for where in (joints[-1], None)]
        out.append(_one(("payload", joints[-1])))
    if name == "inertial_parameters" and single:
        out += [_one(("payload", where), allowed=(("rotor_inertia", joint),)) for where in (None, joint)]
    if name == "rotor_inertia" and joint in ROTOR_REGROUPS.get(robot, ()):
        out += [_one(("inertial_parameters", where)) for where in (joint, None)]
    if name == "torque_constant" and single:
        # It scales friction too, which the inertias cannot: friction beside them belongs to the same answer.
        beside = tuple((friction, joint) for friction in FRICTION)
        out += [_one(("inertial_parameters", where), allowed=beside) for where in (joint, None)]
        out += [_one(("payload", where), allowed=(*beside, ("rotor_inertia", joint))) for where in (None, joint)]
    return out


def explanations_of(effect: dict, robot: str, joints: list[str]) -> list[Explanation]:
    """The truth first, in the contract's words; then its twins on this robot.

    Args:
        effect: Entry of an answer: ``effect``, ``joint``, ``parameters``.
        robot: Name of the generator's robot.
        joints: Its active joints from the base outwards.
    """
    name, joint, p = effect["effect"], effect["joint"], effect["parameters"]
    out = [_one((name, joint)), *_inertial_twins(name, joint, robot, joints)]
    if name in ("input_delay", "actuator_lag") and len(joints) == 1:
        out.append(_one((name, joints[0] if joint is None else None)))
    if name == "base_tilt" and robot in TILTS_WITH_FIRST:
        out.append(_one(("encoder_offset", joints[0])))
    if name == "encoder_offset" and robot in TILTS_WITH_FIRST and joint == joints[0]:
        out.append(_one(("base_tilt", None)))
    # The same laws by the names of a catalogue: dry friction that grows with the way the joint has turned, and waves
    # over the position that grow with the load.
    if name == "cable_drag":
        out.append(_one(("position_dependent_friction", joint)))
    if name == "torque_ripple_with_load":
        out.append(_one(("torque_ripple", joint)))
    if name in FRICTION and joint in PASSIVE:
        out += [_one((name, other)) for other in PASSIVE if other != joint]
        out.append(_one(COUPLED))
    if name == "direction_dependent_friction" and p["coefficient_positive"] == p["coefficient_negative"]:
        viscous = (("viscous_friction", joint),) if p["coefficient_positive"] else ()
        out.append(_one(("coulomb_friction", joint), ("torque_offset", joint), *viscous))
    return out


def explanations(answer: dict) -> list[Explanation]:
    """All explanations of a case as right as the truth, the strict one first; none for a null case.

    Besides the table: what the generator found that this very recording cannot part from an effect (``alike``).
    """
    each = [explanations_of(effect, answer["robot"], answer["joints"]) for effect in answer["effects"]]
    if not each:
        return []
    for same in answer.get("alike", []):
        each[same.get("of", 0)].append(_one((same["effect"], same["joint"])))
    return [
        Explanation(
            frozenset().union(*(one.needed for one in chosen)), frozenset().union(*(one.allowed for one in chosen))
        )
        for chosen in product(*each)
    ]
