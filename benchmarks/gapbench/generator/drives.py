"""Robots by name, with modelled friction and rotors of a few per cent of what each joint has to move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .arms import ARMS, arm, phantom
from .inverse import mass_matrix, rigid_torque
from .reference import AMPLITUDES
from .robots import Table, drawn_chain

ROBOTS = ("pendulum", "planar2", "spatial3", "phantom", "six", "panda")
MASS_SPREAD = 0.2  # of the arms' and the PHANToM's masses from case to case: the owner's model then differs too


def _bare(rng: np.random.Generator, name: str) -> Table:
    if name not in (*ARMS, "phantom"):
        return drawn_chain(rng, name)
    table = phantom() if name == "phantom" else arm(name)
    factors = rng.uniform(1.0 - MASS_SPREAD, 1.0 + MASS_SPREAD, size=len(table.links))
    links = tuple(
        replace(link, mass=link.mass * float(f), inertia=tuple(float(f) * x for x in link.inertia))
        for link, f in zip(table.links, factors, strict=True)
    )
    return replace(table, links=links)


def draw_table(rng: np.random.Generator, name: str) -> Table:
    """The model of a robot as its owner knows it."""
    if name not in ROBOTS:
        raise ValueError(f"No robot {name!r}: the generator has {', '.join(ROBOTS)}.")
    table = _bare(rng, name)
    reach = np.array([high for _, high in AMPLITUDES[name]])
    postures = np.array(table.posture or np.zeros(len(reach))) + reach * rng.uniform(-1.0, 1.0, size=(40, len(reach)))
    inertia = np.diag(mass_matrix(table, postures))
    still = np.zeros_like(postures)
    weight = np.sqrt(np.mean(rigid_torque(table, postures, still, still) ** 2, axis=0))
    links = list(table.links)
    for j, i in enumerate(table.active):
        scale = 4.0 * inertia[j] + 0.8 * weight[j]
        links[i] = replace(
            links[i],
            viscous=float(scale * rng.uniform(0.01, 0.04)),
            coulomb=float(scale * rng.uniform(0.02, 0.06)),
            rotor_inertia=links[i].rotor_inertia or float(inertia[j] * rng.uniform(0.03, 0.25)),
        )
    return replace(table, links=tuple(links))
