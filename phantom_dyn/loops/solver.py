# pyright: reportAttributeAccessIssue=false
"""Computes the positions of all joints of a closed chain along a trajectory of the active joints, by Newton's method.

The search for each sample starts from the solution of the sample before. A step is accepted only if its result is near
the linear prediction, so that the chain stays in the assembly mode of its start. `close_loops` of
`phantom_dyn._kernels.loop_closing` is the compiled search; if it fails, this module finds which loop fails and why.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from phantom_dyn._kernels.loop_closing import AnchoredTree, Closed, Limits, anchors_of, close_loops, drift_loop
from phantom_dyn._kernels.loop_closure_state import LoopClosureState, initial_loop_closure, rewind
from phantom_dyn._kernels.rigid_body import announce, ready
from phantom_dyn._kernels.tree_arrays import TreeArrays
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError
from phantom_dyn.loops.chain import (
    ClosedChain,
    Constraints,
    constraints_of,
    error_and_jacobian,
    nearest,
    widest_open_anchor,
)

CLOSED = 1e-6
"""Largest distance [m, rad] between two frames that count as coincident: robot files have about six digits."""
SINGULAR = 1e-5
"""The chain counts as singular if the smallest singular value of the constraints' derivative by the unknowns is below
this share of the largest one: then Newton's steps are only rounding errors and do not determine the unknowns."""
# Newton's method ends at a step below this [rad or m]. It converges quadratically, so that then only rounding errors
# remain.
_STEP = 1e-11
# Largest number of iterations of Newton's method; from a distance of `REACH` it needs four or five.
_ITERATIONS = 12
REACH = 0.3
"""Longest step of a joint between two solutions [rad or m]."""
# A step is refused if Newton's method corrects the linear prediction by more than this share of the step's length: the
# chain may then have changed its assembly mode.
_LARGEST_CORRECTION = 0.5
# Smallest share of the distance to the next sample that is tried as one step.
_SHORTEST = 1e-7
# Number of stored solutions: of a motion, of its two neighbours in a central difference, and of one more motion.
_REMEMBERED = 4
_LIMITS = Limits(
    closed=CLOSED,
    singular=SINGULAR,
    last_step=_STEP,
    reach=REACH,
    correction=_LARGEST_CORRECTION,
    shortest=_SHORTEST,
    iterations=_ITERATIONS,
)


@dataclass(frozen=True)
class _State:
    """One solution: active and unknown positions, and the derivatives ``slopes`` and ``inverses`` of `Closed`."""

    q: Float[Array, " nv"]
    z: Float[Array, " nz"]
    slope: Float[Array, "nz nv"]
    inverse: Float[Array, "nz m"]


@dataclass(frozen=True)
class Solution:
    """Positions of the tree for N samples, and their derivatives. Arrays are read-only if the chain has anchors.

    Sizes: ``nt`` joints of the tree, ``nv`` active joints, ``nz`` unknowns, ``m`` constraint rows.

    Attributes:
        x: Positions [rad or m], shape ``(N, nt)``.
        G: Derivative of the positions by the active ones, shape ``(N, nt, nv)``.
        inverse: Inverse of the constraints' derivative by the unknowns, ``(N, nz, m)``; ``nz`` is 0 without anchors.
    """

    x: Float[Array, "N nt"]
    G: Float[Array, "N nt nv"]
    inverse: Float[Array, "N nz m"]


def solve(
    model: pin.Model,
    chain: ClosedChain,
    q: Float[Array, "N nv"],
    near: Float[Array, " nt"] | None = None,
    *,
    arrays: TreeArrays,
) -> Solution:
    """Positions of all joints of the tree, and their derivatives by the active ones, for N samples.

    Args:
        model: The tree.
        chain: The loops of the tree.
        q: Positions of the active joints [rad or m].
        near: Positions of the tree that close its loops, from which the search for the first sample starts; by default
            the start of the chain.
        arrays: Arrays of the tree for compiled loops.

    Raises:
        ChainError: If a loop cannot be closed or is singular at a sample, or a position is not finite.
    """
    S, nv = chain.linear_map, chain.nv
    if not chain.anchors:
        G = np.broadcast_to(S, (len(q), *S.shape))
        return Solution(q @ S.T + chain.offset, G, np.zeros((len(q), 0, 0)))
    at = constraints_of(model, chain.anchors)
    state = _start_state(chain, at, chain.start if near is None else near)
    _require_finite(q)
    z, slopes, inverses = _followed(chain, at, state, q, anchors_of(model, chain.anchors, arrays))
    found = Solution(np.hstack([q, z]) @ S.T + chain.offset, S[:, :nv] + S[:, nv:] @ slopes, inverses)
    for array in (found.x, found.G, found.inverse):
        array.flags.writeable = False
    return found


def _require_finite(q: Float[Array, "N nv"]) -> None:
    """Refuse positions that are not finite."""
    bad = np.argwhere(~np.isfinite(q))
    if len(bad):
        raise ChainError(
            f"The position of active joint number {bad[0, 1]} is not finite at sample {bad[0, 0]}: "
            "give finite positions."
        )


def _followed(
    chain: ClosedChain, at: Constraints, state: _State, q: Float[Array, "N nv"], tree: AnchoredTree
) -> tuple[Float[Array, "N nz"], Float[Array, "N nz nv"], Float[Array, "N nz m"]]:
    """Solutions along a trajectory, as arrays of `Closed`; the search for the first sample starts from ``state``."""
    rows = len(q) + 1
    z, slopes = np.empty((rows, *state.z.shape)), np.empty((rows, *state.slope.shape))
    inverses = np.empty((rows, *state.inverse.shape))
    # The last row holds the solution before the first sample.
    z[-1], slopes[-1], inverses[-1] = state.z, state.slope, state.inverse
    announce(close_loops)
    closed = Closed(z, slopes, inverses)
    k = close_loops(tree, chain.linear_map, chain.offset, _LIMITS, ready(q), ready(state.q), closed)
    if k < len(q):
        raise ChainError(_why(chain, at, q[k], z[k - 1], f"sample {k}"))
    return z[:-1], slopes[:-1], inverses[:-1]


def loop_closure_of(model: pin.Model, chain: ClosedChain, arrays: TreeArrays) -> LoopClosureState | None:
    """State of the loops for compiled simulations; None if no loop is closed numerically.

    Args:
        model: The tree.
        chain: The loops of the tree, which are closed at the start.
        arrays: Arrays of the tree for compiled loops.
    """
    if not chain.anchors:
        return None
    state = _start_state(chain, constraints_of(model, chain.anchors), chain.start)
    started = Closed(*(ready(part[None]) for part in (state.z, state.slope, state.inverse)))
    return initial_loop_closure(anchors_of(model, chain.anchors, arrays), chain.linear_map, _LIMITS, state.q, started)


def closed_each(
    model: pin.Model, chain: ClosedChain, q: Float[Array, "N nv"], arrays: TreeArrays
) -> Float[Array, "N nz m"]:
    """`Solution.inverse` for separate postures, each of which is searched from the start of the chain.

    Args:
        model: The tree.
        chain: The loops of the tree, some of them anchors.
        q: Positions of the active joints [rad or m].
        arrays: Arrays of the tree for compiled loops.

    Returns:
        Shape ``(N, nz, m)``; NaN where a loop cannot be closed or is singular, or a position is not finite.
    """
    rows = sum(6 if anchor.kind == "frame" else 3 for anchor in chain.anchors)
    out = np.full((len(q), len(chain.unknowns), rows), np.nan)
    loops = loop_closure_of(model, chain, arrays)
    offset = np.array(chain.offset)
    for k, posture in enumerate(q):
        if loops is not None and np.isfinite(posture).all():
            rewind(loops)
            loops.wanted[0] = posture
            if close_loops(loops.tree, loops.linear_map, offset, _LIMITS, loops.wanted, loops.q, loops.last):
                out[k] = loops.last.inverses[0]
    return out


class RecentSolutions:
    """Cache of the latest solutions of one chain.

    Torque, friction, regressor and mass matrix need the same solution. A solution depends on the positions only, so
    that the cache changes no result.
    """

    def __init__(self, model: pin.Model, chain: ClosedChain, arrays: TreeArrays):
        self._model, self._chain, self._arrays = model, chain, arrays
        self._kept: tuple[tuple[Array, Solution], ...] = ()

    def at(self, q: Float[Array, "N nv"]) -> Solution:
        """Solution from the start of the chain, see `solve`.

        Raises:
            ChainError: If a loop cannot be closed or is singular at a sample.
        """
        for positions, solution in self._kept:
            if np.array_equal(positions, q):
                return solution
        found = solve(self._model, self._chain, q, arrays=self._arrays)
        if self._chain.anchors:
            # A single assignment is safe if threads share a robot.
            self._kept = (*self._kept[1 - _REMEMBERED :], (np.array(q), found))
        return found

    def __getstate__(self) -> dict[str, Any]:
        """State for a copy in another process, without the solutions."""
        return self.__dict__ | {"_kept": ()}


def tree_positions(
    model: pin.Model, chain: ClosedChain, q: Float[Array, "N nv"], *, arrays: TreeArrays
) -> Float[Array, "N nt"]:
    """Positions of all joints of the tree [rad or m], see `solve`."""
    return solve(model, chain, q, arrays=arrays).x


def drift(
    model: pin.Model,
    chain: ClosedChain,
    solution: Solution,
    v: Float[Array, "N nt"],
    *,
    arrays: TreeArrays,
) -> Float[Array, "N nt"]:
    """Accelerations of the tree [rad/s^2 or m/s^2] while no active joint accelerates.

    Args:
        model: The tree.
        chain: The loops of the tree.
        solution: Result of `solve`.
        v: Velocities of the tree.
        arrays: Arrays of the tree for compiled loops.
    """
    out = np.zeros_like(v)
    if not (chain.anchors and v.any()):
        return out
    tree, to_tree = anchors_of(model, chain.anchors, arrays), ready(chain.linear_map[:, chain.nv :])
    drift_loop(tree, to_tree, ready(solution.x), ready(v), ready(solution.inverse), out)
    return out


def _start_state(chain: ClosedChain, at: Constraints, begin: Float[Array, " nt"]) -> _State:
    """The solution at the positions ``begin`` of the tree.

    Raises:
        ChainError: If the loops cannot be closed there, or are singular.
    """
    q, z = begin[list(chain.active)], begin[list(chain.unknowns)]
    state = _newton(chain, at, q, z)
    if state is None:
        raise ChainError(_why(chain, at, q, z, "the start"))
    return state


def _newton(chain: ClosedChain, at: Constraints, q: Float[Array, " nv"], z: Float[Array, " nz"]) -> _State | None:
    """The solution at ``q`` near ``z``; None if there is none or the constraints are singular."""
    S, nv = chain.linear_map, chain.nv
    fixed = S[:, :nv] @ q + chain.offset
    for _ in range(_ITERATIONS):
        error, slope = error_and_jacobian(at, fixed + S[:, nv:] @ z)
        slope = slope @ S
        inverse = _inverse(slope[:, nv:])
        if inverse is None:
            return None
        step = -inverse @ error
        z = z + step
        if np.abs(step).max() <= _STEP:
            return _State(q, z, -inverse @ slope[:, :nv], inverse) if np.abs(error).max() <= CLOSED else None
    return None


def _inverse(slope: Float[Array, "m nz"]) -> Float[Array, "nz m"] | None:
    """Pseudo-inverse, or None if the unknowns are not determined. Planar loops have more rows than unknowns."""
    left, values, right = np.linalg.svd(slope, full_matrices=False)
    if len(values) < slope.shape[1] or not values[-1] > SINGULAR * values[0]:
        return None
    return (right.T / values) @ left.T


def _why(chain: ClosedChain, at: Constraints, q: Float[Array, " nv"], z: Float[Array, " nz"], where: str) -> str:
    """Sentence on the loop that fails: it is open if its smallest distance is not zero, otherwise singular."""
    z, error, slope = nearest(chain, at, q, z)
    label, apart = widest_open_anchor(chain, at, error)
    if np.abs(error).max() > CLOSED:
        return (
            f"The loop {label} cannot be closed at {where}: its frames stay {apart} apart; "
            "give positions that the linkage reaches."
        )
    return (
        f"The loop {label} is singular at or before {where} (residual {apart}, smallest singular value "
        f"{np.linalg.svd(slope, compute_uv=False)[-1]:.2g}): there the passive joints do not follow from the active "
        "ones; keep the motion away from it."
    )


def distance_from_singularity(inverse: Float[Array, "N nz m"]) -> Float[Array, " N"]:
    r"""Distance from a singularity of each sample, from 0 (singular) to 1, shape ``(N,)``; infinite without loops.

    The distance is the smallest singular value of the constraints' derivative by the unknowns, after its columns are
    scaled to unit length. It measures how independently the passive joints move the frames that the loops keep
    together. For a four-bar linkage with the transmission angle :math:`\mu` between coupler and rocker it is
    :math:`\sqrt{1 - |\cos\mu|}`.

    Args:
        inverse: Inverse of the constraints' derivative by the unknowns, see `Solution`; where it is NaN, the distance
            is NaN.
    """
    if not inverse.shape[1]:
        return np.full(len(inverse), np.inf)
    out, known = np.full(len(inverse), np.nan), np.isfinite(inverse).all(axis=(1, 2))
    slope = np.linalg.pinv(inverse[known])
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    columns = np.divide(slope, length, out=np.zeros_like(slope), where=length > 0)
    out[known] = np.linalg.svd(columns, compute_uv=False)[:, -1]
    return out
