"""What is physically impossible in given inertial parameters, in sentences."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from identification.estimators.consistent_bodies import Region, pseudo_inertia
from phantom_dyn.errors import ParameterError
from phantom_dyn.inertia import body_name, central_parameters
from phantom_dyn.robot import Robot

Array = np.ndarray

_ROUNDING = 1e-9  # of the largest entry: files carry about ten digits


def inconsistencies(
    robot: Robot, standard: Float[Array, " p"], regions: tuple[Region | None, ...] = ()
) -> tuple[str, ...]:
    """One sentence per body and law that its parameters break; empty if all bodies can exist.

    Args:
        robot: Gives the names of the bodies.
        standard: Ten parameters per body in the order of `phantom_dyn.inertia.STANDARD_NAMES`.
        regions: Where the mass of each body is, one per body; none by default.

    Raises:
        ParameterError: If there are not ten values per body or one region per body, or a value is not finite.
    """
    bodies = robot.model.njoints - 1
    if len(standard) != 10 * bodies:
        raise ParameterError(f"{len(standard)} values were given for {bodies} bodies: give ten for each.")
    if len(regions) not in (0, bodies):
        raise ParameterError(f"{len(regions)} regions were given for {bodies} bodies: give one for each, or none.")
    if not np.isfinite(standard).all():
        raise ParameterError("The parameters are not finite: give finite ones.")
    out: list[str] = []
    for at, values in enumerate(standard.reshape(bodies, 10)):
        name = body_name(robot, at + 1)
        out += [f"{name}: {why}" for why in body_inconsistencies(values, regions[at] if regions else None)]
    return tuple(out)


def body_inconsistencies(standard: Float[Array, " 10"], region: Region | None = None) -> tuple[str, ...]:
    """The laws that ten parameters of one body break, each as a sentence.

    Args:
        standard: In the order of `phantom_dyn.inertia.STANDARD_NAMES`.
        region: Where its mass is, or None.
    """
    mass, center, inertia = central_parameters(standard)
    size = np.abs(standard).max(initial=0.0)
    if mass < -_ROUNDING * size:
        return (f"its mass (m) is {mass:g} kg, below zero.",)
    if mass <= _ROUNDING * size:
        rest = np.abs(standard[1:]).max()
        return () if rest == 0 else ("it has no mass (m), but first moments or inertia (mx to Izz).",)
    out = []
    principal = np.linalg.eigvalsh(inertia)
    tolerance = _ROUNDING * max(np.abs(inertia).max(), float(np.abs(standard[4:]).max()), mass * 1e-8)
    if principal[0] < -tolerance:
        out.append(
            f"its smallest principal inertia about the centre of mass (Ixx to Izz, with m, mx, my, mz) is "
            f"{principal[0]:g} kg m^2, below zero."
        )
    elif principal[2] - principal[0] - principal[1] > tolerance:
        out.append(
            f"its largest principal inertia about the centre of mass (Ixx to Izz, with m, mx, my, mz) is "
            f"{principal[2]:g} kg m^2, more than the two others together, {principal[0] + principal[1]:g} kg m^2."
        )
    elif np.linalg.eigvalsh(pseudo_inertia(standard))[0] < -tolerance:
        out.append("its pseudo-inertia (all ten parameters) has an eigenvalue below zero.")
    if region is not None:
        out += _outside(mass, center, standard, region)
    return tuple(out)


def _outside(mass: float, center: Array, standard: Array, region: Region) -> list[str]:
    out = []
    room = region.rows() @ standard
    ellipsoids = 0 if region.center is None else 1
    where = ", ".join(f"{x:.4g}" for x in center)
    if ellipsoids and room[0] < -_ROUNDING * mass:
        out.append(
            "its centre and spread of mass (all ten parameters) need mass outside the ellipsoid about its shape; the "
            f"centre of mass is at ({where}) m."
        )
    faces = room[ellipsoids:]
    if len(faces) and faces.min() < -_ROUNDING * mass:
        out.append(
            f"its centre of mass (mx, my, mz over m) at ({where}) m is {-faces.min() / mass:.3g} m outside its shape."
        )
    return out
