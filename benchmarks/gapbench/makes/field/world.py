"""Everything true of one run, and how bodies are put together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .dynamics import Chain
from .plant import Plant
from .simulate import STEP, Run, Task, run

Array = np.ndarray


@dataclass(frozen=True)
class World:
    """A true robot and what acts on it.

    Attributes:
        plant: Drives, friction, encoders.
        chain: Links and gravity.
        quantum: Step of each encoder [rad or m], shape ``(n,)``.
        loaded: Links while a load is held, or None.
        held: When that is, shape ``(K,)``.
        pushed: Torques from outside [N m or N], shape ``(K, n)``.
    """

    plant: Plant
    chain: Chain
    quantum: Array
    loaded: Chain | None
    held: Array
    pushed: Array


@dataclass(frozen=True)
class Scale:
    """What is ordinary for a robot on a motion, one a joint, shape ``(n,)``.

    Attributes:
        torque: Root mean square of the drive torque [N m or N]; ``most``: its largest.
        speed: Largest speed [rad/s or m/s].
        middle: Middle of the motion [rad or m]; ``reach``: half of its range.
        inertia: Of the joint with all that hangs on it, rotor included.
        moving: Share of the time that the joint moves.
        seconds: Length of the recording.
    """

    torque: Array
    most: Array
    speed: Array
    middle: Array
    reach: Array
    inertia: Array
    moving: Array
    seconds: float


def moved(world: World, task: Task) -> Run:
    """Runs a world through a task."""
    task = replace(task, extra=task.extra + world.pushed, held=world.held)
    return run(world.plant, world.chain, task, world.loaded)


def scale_of(run: Run, inertia: Array, usual: Array) -> Scale:
    """What a run without any effect shows; ``usual`` is each joint's top speed in its data sheet."""
    low, high = run.reading.min(axis=0), run.reading.max(axis=0)
    speed = np.abs(run.speed).max(axis=0)
    return Scale(
        torque=np.sqrt(np.mean(run.command**2, axis=0)),
        most=np.abs(run.command).max(axis=0),
        speed=speed,
        middle=0.5 * (low + high),
        reach=0.5 * (high - low),
        inertia=inertia,
        moving=np.mean(np.abs(run.speed) > 0.02 * np.maximum(speed, 0.3 * usual), axis=0),
        seconds=len(run.reading) * STEP,
    )


def with_body(chain: Chain, link: int, mass: float, center: Array, inertia: Array) -> Chain:
    """The chain with a body (centre in the joint's frame, inertia about it) fixed to a link."""
    m, c, i = chain.mass.copy(), chain.center.copy(), chain.inertia.copy()
    total = m[link] + mass
    both = (m[link] * c[link] + mass * center) / total

    def about(weight: float, at: Array) -> Array:
        r = at - both
        return weight * (r @ r * np.eye(3) - np.outer(r, r))

    i[link] = i[link] + about(m[link], c[link]) + inertia + about(mass, center)
    m[link], c[link] = total, both
    return replace(chain, mass=m, center=c, inertia=i)


def with_link(chain: Chain, link: int, mass: float, shift: Array, inertia: float) -> Chain:
    """The chain with one link's mass and inertia multiplied and its centre moved [m]."""
    m, c, i = chain.mass.copy(), chain.center.copy(), chain.inertia.copy()
    m[link] *= mass
    c[link] += shift
    i[link] *= inertia
    return replace(chain, mass=m, center=c, inertia=i)


def tilted(chain: Chain, r: Array) -> Chain:
    """The chain with gravity turned by the rotation vector ``r`` in the base frame."""
    angle = float(np.linalg.norm(r))
    k = r / max(angle, 1e-12)
    g = chain.gravity
    return replace(
        chain, gravity=g * np.cos(angle) + np.cross(k, g) * np.sin(angle) + k * (k @ g) * (1.0 - np.cos(angle))
    )
