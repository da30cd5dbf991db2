"""Other laws that the contract's words for an effect fit as well: how far its parameters depend on the law chosen.

"A bristle with an initial stiffness that saturates" is one that slips at once or one that gives way more and more, and
the play of a link under a load that is known up to some frequency is none that is known exactly. Nothing in a
recording of a few floors' gap tells which it is, so that a parameter is known no better than both laws agree on it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from phantom_dyn.effects.effect import Rival
from phantom_dyn.effects.friction.presliding_friction import PreslidingFriction
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.displaced import change_by_link, load_and_inertia
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.effects.transmission.backlash import Backlash, play

Array = np.ndarray
# (operation, joint, coefficients, shape) -> drive torque more, ``(N, nv)``.
OtherLaw = Callable[[Operation, str | None, Array, Array], Array]


def other_law(effect: Rival) -> OtherLaw | None:
    """Another law of the same parameters, if there is one."""
    if isinstance(effect, PreslidingFriction):
        return _dahl
    return _play_under_all_load if isinstance(effect, Backlash) else None


def dahl(q: Float[Array, " N"], displacement: float) -> Float[Array, " N"]:
    r"""Share of its largest torque that a bristle gives which yields more and more (Dahl, 1968), 0 at the first sample.

    :math:`dz/dq = (1 - z\,\mathrm{sign}\,dq) / d`, solved exactly from sample to sample. Each step is ``z -> r z + c``;
    two of them one after the other are again one, so that all are put together in ``log2(N)`` passes.

    Args:
        q: Positions [rad or m].
        displacement: d, over which it builds up from rest.
    """
    moved = np.diff(q, prepend=q[:1])
    ratio = np.exp(-np.abs(moved) / displacement)
    constant = np.sign(moved) * (1.0 - ratio)
    reach = 1
    while reach < len(q):
        constant = np.concatenate([constant[:reach], ratio[reach:] * constant[:-reach] + constant[reach:]])
        ratio = np.concatenate([ratio[:reach], ratio[reach:] * ratio[:-reach]])
        reach *= 2
    return constant


def _dahl(operation: Operation, joint: str | None, own: Array, shape: Array) -> Float[Array, "N nv"]:
    out = np.zeros_like(operation.tau)
    row = row_of(operation.robot, joint)
    out[:, row] = own[0] * dahl(operation.q[:, row], float(shape[0]))
    return out


def _play_under_all_load(operation: Operation, joint: str | None, own: Array, shape: Array) -> Float[Array, "N nv"]:
    """Play under the load as computed, the noise of the encoder with it."""
    row = row_of(operation.robot, joint)
    load, inertia = load_and_inertia(operation, row)
    moved = play(operation.t, load / inertia, float(shape[0]))
    gained = moved.impact - load / inertia * moved.loose
    change = change_by_link(operation, row, -moved.lead, -moved.rate, gained)
    free = moved.loose > 0
    change[free, row] = (inertia * gained)[free]
    return own[0] * change
