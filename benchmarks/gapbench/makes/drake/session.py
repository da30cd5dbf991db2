"""Draws what a recording is made of: the robot and its wrong model, the motion, the controller and the noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from . import motions
from .contacts import Fine
from .motions import Plan
from .plant import Plant
from .robots import KINDS, Robot, Tolerance, drawn_robot, true_robot, with_drives
from .simulate import Session

RATES = (250.0, 400.0, 500.0, 1000.0)  # of the joint controllers [Hz]
LEAD = 0.3  # the first part of a run is not logged [s]


@dataclass(frozen=True)
class Setup:
    """A robot, the model that is given of it, and the session that it is recorded in."""

    given: Robot
    truth: Robot
    tolerance: Tolerance
    session: Session
    rate: float
    reference: str


def uneven_ticks(rng: np.random.Generator, duration: float, rate: float, jitter: float) -> np.ndarray:
    """Times of the controller: a clock of this rate, each tick late or early by a share of the period."""
    clock = np.arange(0.0, duration, 1.0 / rate)
    shift = np.clip(rng.normal(0.0, jitter, len(clock)), -0.3, 0.3) / rate
    shift[0] = 0.0
    return clock + shift


def coloured(rng: np.random.Generator, t: np.ndarray, rms: np.ndarray, rate: float) -> np.ndarray:
    """White noise with noise of a first-order colour, held from tick to tick [N m], shape ``(N, n)``."""
    shape = (len(t), len(rms))
    share, corner = rng.uniform(0.1, 0.6), rng.uniform(4.0, 40.0)
    fade = np.exp(-2.0 * np.pi * corner / rate)
    slow = lfilter([np.sqrt(1.0 - fade**2)], [1.0, -fade], rng.normal(size=shape), axis=0)
    return rms * (np.sqrt(1.0 - share) * rng.normal(size=shape) + np.sqrt(share) * slow)


def _fine(rng: np.random.Generator, robot: Robot) -> Fine:
    n = len(robot.parts)
    speed = robot.array("speed")
    return Fine(
        bend=robot.array("reach") * np.exp(rng.uniform(np.log(2e-5), np.log(2e-4), n)),
        excess=rng.uniform(0.0, 0.06, n),
        stribeck=speed * rng.uniform(0.005, 0.03, n),
        loop=np.full(n, rng.uniform(1e-3, 3e-3)),
    )


def feedforward(given: Robot, plant: Plant, motion: motions.Motion) -> np.ndarray:
    """Torque of the given model for a motion [N m], shape ``(N, n)``; ``plant`` is its links in Drake."""
    dry, wet, rotor = (given.array(name) for name in ("dry", "wet", "rotor"))
    # Friction of the wanted speed, rounded off where the speed is nearly nothing.
    torque = plant.torque(motion.q, motion.v, motion.a) + rotor * motion.a + wet * motion.v
    return torque + dry * np.tanh(motion.v / (0.02 * given.array("speed")))


def drawn_setup(seed: int, kind: int, attempt: int) -> Setup:
    """A pure function of its numbers. Robots take turns with the seed."""
    rng = np.random.default_rng([0xD8A6E, seed, kind, attempt])
    given = drawn_robot(rng, KINDS[(seed + attempt // 3) % len(KINDS)])
    reference = str(rng.choice(motions.KINDS))
    duration, rate = float(rng.uniform(10.0, 20.0)), float(rng.choice(RATES))
    plan = Plan(reference, (0xA11, seed, kind, attempt), duration)
    motion = plan.at(given, uneven_ticks(rng, duration, rate, rng.uniform(0.0, 0.05)))
    plant = Plant(given)
    every = slice(None, None, 5)
    rigid = plant.torque(motion.q[every], motion.v[every], motion.a[every])
    mass = plant.equation(motion.q[0], 0.0 * motion.v[0])[0]
    moved = np.diag(mass)
    given = with_drives(rng, given, moved, np.sqrt((rigid**2).mean(axis=0)))
    truth = true_robot(rng, given, Tolerance(), even=bool(rng.random() < 0.25))
    known = feedforward(given, plant, motion)
    # What one joint feels with all others free: gains for more than that would shake a long arm.
    inertia = 1.0 / np.diag(np.linalg.inv(mass + np.diag(given.array("rotor"))))
    bandwidth = 2.0 * np.pi * rng.uniform(3.0, 7.0)
    level = rng.uniform(0.005, 0.03) * np.sqrt((known**2).mean(axis=0))
    session = Session(
        motion=motion,
        feedforward=known,
        stiffness=inertia * bandwidth**2,
        damping=2.0 * rng.uniform(0.5, 0.9) * inertia * bandwidth,
        noise=coloured(rng, motion.t, level, rate),
        fine=_fine(rng, given),
    )
    return Setup(given, truth, Tolerance(), session, rate, reference)


def with_fine(setup: Setup, friction: np.ndarray, loop: np.ndarray) -> Setup:
    """The same with less of what the friction and the current loops of a null have, shares of shape ``(n,)``."""
    return replace(setup, session=replace(setup.session, fine=setup.session.fine.times(friction, loop)))
