"""A closed chain as data: a tree, the joints that drive it, and what the others follow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from phantom_dyn.motion import read_only

Array = np.ndarray


@dataclass(frozen=True)
class Anchor:
    """Two frames of the tree that a loop keeps together.

    Attributes:
        label: The loop's name for messages, such as ``loops[1] (a_pin to c_pin)``.
        kind: ``point`` keeps the origins together, ``frame`` the axes too.
        frame_a, frame_b: Indices of the frames in the model.
    """

    label: str
    kind: Literal["point", "frame"]
    frame_a: int
    frame_b: int


@dataclass(frozen=True)
class ClosedChain:
    r"""Joint positions of the tree as :math:`x = S\,(q, z) + o`, with ``z`` such that the anchors hold.

    ``nt`` joints of the tree, ``nv`` active ones ``q``, and ``nz`` unknowns ``z``: the passive joints that no linear
    expression gives. A chain of linear loops alone has no unknowns.

    Attributes:
        active: Places of the active joints among the tree's velocities, ascending.
        passive: Places of the others, ascending.
        passive_names: Their names.
        unknowns: Places of ``z`` among the tree's velocities, some of ``passive``.
        linear_map: ``S``, shape ``(nt, nv + nz)``.
        offset: ``o`` [rad or m], shape ``(nt,)``.
        anchors: Loops that are solved numerically.
        start: Tree positions [rad or m] at which every anchor holds, in the way of assembly that is meant.
        viscous_friction: Modelled viscous coefficients of the passive joints.
        coulomb_friction: Modelled Coulomb torques of the passive joints.
    """

    active: tuple[int, ...]
    passive: tuple[int, ...]
    passive_names: tuple[str, ...]
    unknowns: tuple[int, ...]
    linear_map: Float[Array, "nt ny"]
    offset: Float[Array, " nt"]
    anchors: tuple[Anchor, ...]
    start: Float[Array, " nt"]
    viscous_friction: Float[Array, " np"]
    coulomb_friction: Float[Array, " np"]

    def __post_init__(self):
        for name in ("linear_map", "offset", "start", "viscous_friction", "coulomb_friction"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def nv(self) -> int:
        """Number of active joints."""
        return len(self.active)
