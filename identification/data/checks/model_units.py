# pyright: reportAttributeAccessIssue=false
"""Checks the units of a robot file, as some CAD exporters write millimetres and grams for metres and kilograms.

No recording is needed. With lengths in mm a robot is hundreds of metres long and less dense than air; with masses in g
its bodies are denser than any metal. A fault is reported only if no robot, crane or antenna can have such a density.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identification.data.recording import Fault
from phantom_dyn.model.inertia import body_name
from phantom_dyn.model.robot import Robot

# Lengths [m] above this number may be in mm: robots of 20 m are rare, and 20 mm is the length of a finger's link.
_LONG = 20.0
# Length [m] that is too large for a machine even if it is in mm. The largest length that wrong units make is 30 km: the
# radius of gyration of a body whose inertia is in g mm^2.
_ENDLESS = 1e6
# Mass divided by the cube of the greatest length [kg/m^3] below which lengths are in mm: a hundredth of the density of
# air. Cranes are a hundred times above it; arms with lengths in mm are below it, with masses in kg or in g.
_THIN = 0.01
# Density of osmium, the densest of metals [kg/m^3].
_DENSEST = 22.6e3
# Masses are in g only if every body then has a density between those of foam and lead [kg/m^3].
_LIGHTEST, _USUAL = 10.0, 11.5e3
# Mass of a robot [kg] below which masses are not reported: small bodies may be of lead or tungsten.
_HEAVY = 100.0
# Radius of gyration [m] below which a body counts as a point mass.
_POINT = 1e-3
_GRAM = 1e-3
_SI = "lengths in m, masses in kg and inertias in kg m^2"


@dataclass(frozen=True)
class _Length:
    """A length of the model [m], and a clause that states it, as ``the joint j2 lies 300 m from the one before it``."""

    metres: float
    words: str


@dataclass(frozen=True)
class _Extended:
    """A body that is not a point mass: name, mass [kg], and the smallest density [kg/m^3] that its inertia allows."""

    name: str
    mass: float
    density: float


def wrong_units(robot: Robot) -> tuple[Fault, ...]:
    """The fault of a model with lengths or inertias in mm, or masses in g; empty if its units may be right.

    Args:
        robot: The given model.
    """
    bodies = list(robot.model.inertias)[1:]
    mass = sum(body.mass for body in bodies)
    if mass <= 0:
        return ()
    name = Path(robot.source).name if robot.source else robot.name
    longest = max(_lengths(robot), key=lambda length: length.metres)
    if longest.metres > _ENDLESS:
        return (
            Fault(
                f"a length, mass or inertia of {name} is that of no robot",
                longest.words,
                f"correct {name}: {_SI}",
            ),
        )
    if longest.metres > _LONG and mass / longest.metres / longest.metres / longest.metres < _THIN:
        return (
            Fault(
                f"the lengths or inertias of {name} are in mm and not in m",
                f"{longest.words} on a robot of {mass:.3g} kg in all, which would be thinner than air",
                f"correct {name}: {_SI}",
            ),
        )
    extended = _extended(robot)
    if mass > _HEAVY and extended and all(_in_grams(body) for body in extended):
        heaviest = max(extended, key=lambda body: body.mass)
        return (
            Fault(
                f"the masses of {name} are in g and not in kg",
                f"{heaviest.name} has {heaviest.mass:.4g} kg and an inertia that only a body of "
                f"{heaviest.density:.2g} kg/m^3 or more has, where the densest metal has {_DENSEST:.3g}",
                f"correct {name}: {_SI}",
            ),
        )
    return ()


def _lengths(robot: Robot) -> list[_Length]:
    """All lengths of the model: between joints, from joints to centres of mass, and radii of gyration."""
    out = []
    names, placements = list(robot.model.names), list(robot.model.jointPlacements)
    for j in range(1, robot.model.njoints):
        body, inertia = body_name(robot, j), robot.model.inertias[j]
        distance = float(np.linalg.norm(placements[j].translation))
        out.append(_Length(distance, f"the joint {names[j]} lies {distance:.3g} m from the one before it"))
        if inertia.mass > 0:
            lever = float(np.linalg.norm(inertia.lever))
            out.append(_Length(lever, f"the centre of mass of {body} lies {lever:.3g} m from its joint"))
            radius = _radius_of_gyration(inertia)
            out.append(_Length(radius, f"the inertia of {body} is that of a body {2 * radius:.3g} m wide"))
    return out


def _radius_of_gyration(inertia) -> float:
    """Largest radius of gyration [m] of a body, over all axes through its centre of mass."""
    # The roots are taken before the division, because division by a tiny mass could overflow.
    return float(np.sqrt(max(float(np.linalg.eigvalsh(inertia.inertia)[-1]), 0.0)) / np.sqrt(inertia.mass))


def _extended(robot: Robot) -> list[_Extended]:
    """Bodies that are not point masses.

    Their density is computed as that of a ball, which has the smallest density for a given mass and largest radius of
    gyration. The square of a ball's radius of gyration is two fifths of the square of its radius.
    """
    out = []
    for j in range(1, robot.model.njoints):
        inertia = robot.model.inertias[j]
        if inertia.mass > 0 and (gyration := _radius_of_gyration(inertia)) > _POINT:
            radius = float(np.sqrt(2.5) * gyration)
            out.append(_Extended(body_name(robot, j), inertia.mass, inertia.mass / (4 / 3 * math.pi * radius**3)))
    return out


def _in_grams(body: _Extended) -> bool:
    """True for a body that is denser than any metal if its mass is in kg, and has a usual density if it is in g."""
    return body.density > _DENSEST and _LIGHTEST < body.density * _GRAM < _USUAL
