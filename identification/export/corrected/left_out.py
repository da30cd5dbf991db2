"""What URDF and MJCF cannot say of a corrected model, in sentences."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from identification.export.corrected.corrected_mjcf import SHORTEST_STEP, said_compliances, said_zeros
from identification.export.corrected.parts import Parts
from phantom_dyn.effects import catalogue
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.loading import CONFIG_NAME

_GRAVITY = (0.0, 0.0, -9.81)


def urdf_left_out(parts: Parts, file: Path) -> tuple[str, ...]:
    """Sentences on what a URDF lacks.

    Args:
        parts: The corrected model.
        file: The robot's file.
    """
    robot, given = parts.robot, parts.given
    places = zip(robot.joint_names, robot.rotor_inertia, given.rotor_inertia, strict=True)
    # A URDF that is made of another file has no rotors at all.
    other = file.suffix != ".urdf"
    moved = {name: float(new) for name, new, old in places if new != old or (other and new > 0)}
    out = [*_in_part(parts), *_nowhere(parts)]
    out += _missing("rotor inertias: put them into " + CONFIG_NAME + " (rotor_inertia [kg m^2 or kg])", moved)
    out += _missing("springs (stiffness)", {name: k for name, (k, _) in parts.springs.items()})
    out += _missing("constant torques [N m or N]", parts.offsets)
    out += _missing("torque constants (true over logged torque)", parts.gains)
    out += _missing("delays [s]", parts.delays)
    out += _missing("lags [s]", parts.lags)
    out += _missing("play (gap [rad or m])", parts.plays)
    out += _missing("springs of transmissions (stiffness)", parts.compliances)
    out += _missing("cogging (largest amplitude)", _largest(parts))
    out += _missing("couplings (ratio)", {f"{c.first}+{c.second}": c.ratio for c in parts.couplings})
    if given.chain is not None:
        what = f"state them under loops in a {CONFIG_NAME}" if other else f"keep {CONFIG_NAME} beside it"
        out.append(f"It has no place for closed loops: {what}.")
    if given.locked and not other:
        out.append(
            f"{', '.join(given.locked)} can move in it: hold them fixed under lock in a {CONFIG_NAME} beside it."
        )
    gravity = given.model.gravity.linear
    if not np.allclose(gravity, _GRAVITY):
        numbers = ", ".join(f"{x:g}" for x in gravity)
        out.append(f"It has no place for gravity: state gravity: [{numbers}] in a {CONFIG_NAME} beside it.")
    if other:
        out.append("The given file is no URDF, so this one has bodies, joints and frames, and no shapes.")
    return tuple(out)


def mjcf_left_out(parts: Parts, file: Path) -> tuple[str, ...]:
    """Sentences on what the MJCF file lacks.

    Args:
        parts: The corrected model.
        file: The robot's file.
    """
    out = [*_in_part(parts), *_nowhere(parts)]
    behind = {name: k for name, k in parts.compliances.items() if name not in said_compliances(parts)}
    out += _missing("a spring behind a play (stiffness)", behind)
    loose = [name for name in (*parts.plays, *said_compliances(parts)) if not _rotor(parts, name)]
    if loose:
        out.append(
            f"The rotor inertia of {', '.join(loose)} is not known, so it is a hundredth of what the joint moves: "
            f"state rotor_inertia in {CONFIG_NAME}."
        )
    late = [delay for delay in parts.delays.values() if delay > 0]
    if parts.cogging or late:
        out.append("Delays and cogging (dcmotor) need MuJoCo 4.0 or newer; cogging takes no command: leave ctrl at 0.")
    if late:
        out.append(f"Its delays are cut short where the timestep is below {SHORTEST_STEP:g} s: raise nsample there.")
    chain = parts.robot.chain
    if chain is not None and set(chain.passive) - set(chain.unknowns):
        out.append("Joints that follow others by a formula move freely in it.")
    drives = f"limits of torque and speed that {CONFIG_NAME} does not state" if file.suffix == ".urdf" else "actuators"
    return (*out, f"Shapes, sensors and {drives} of the given file are not in it: a motor drives each joint.")


def _rotor(parts: Parts, joint: str) -> float:
    return float(parts.robot.rotor_inertia[parts.robot.joint_names.index(joint)])


def _in_part(parts: Parts) -> list[str]:
    words = [(effect_named(effect.effect).words, effect.joint) for effect in parts.others]
    return [f"It has, {said.kept}: {joint}." for said, joint in words if said.kept]


def _nowhere(parts: Parts) -> list[str]:
    out = []
    for effect in catalogue.EFFECTS:
        lost = [other for other in parts.others if other.effect == effect.name and not effect.words.kept]
        if lost:
            size = effect.parameters(parts.given, lost[0].joint)[0].name.replace("_", " ")
            what = f"{effect.words.lost or effect.words.name} ({size})"
            out += _missing(what, {str(other.joint): other.theta[0] for other in lost})
    if not said_zeros(parts):
        out += _missing("the zeros of encoders in a closed chain [rad or m]", parts.zeros)
    return out


def _largest(parts: Parts) -> dict[str, float]:
    return {name: max((wave[1] for wave in waves), default=0.0) for name, waves in parts.cogging.items()}


def _missing(what: str, values: dict[str, float]) -> list[str]:
    if not values:
        return []
    return [f"It has no place for {what}: {', '.join(f'{name} {value:.4g}' for name, value in values.items())}."]
