"""Motions as people record them: references of all joints at every step of the simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .robots import Robot
from .simulate import STEP

Array = np.ndarray
Rng = np.random.Generator
SHORTEST, LONGEST = 6.0, 40.0  # of a recording [s]
PACE = (0.35, 1.0)  # of the usual top speed
ROUNDING = 0.025  # corners of a reference are rounded by a bell of this deviation [s]


def _way(share: Array) -> Array:
    """Rest to rest with smooth acceleration, from 0 to 1."""
    s = np.clip(share, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def _along(t: Array, poses: Array, speed: Array, hold: Callable[[], float]) -> Array:
    """Goes through poses one after the other, all joints arriving together, with stops."""
    out, now, k = np.repeat(poses[:1], len(t), axis=0), 0.3, 0
    while now < t[-1]:
        here, there = poses[k % len(poses)], poses[(k + 1) % len(poses)]
        takes = max(float(np.max(1.9 * np.abs(there - here) / speed)), 0.25)
        later = t >= now
        out[later] = here + (there - here) * _way((t[later, None] - now) / takes)
        now += takes + hold()
        k += 1
    return out


def point_to_point(robot: Robot, t: Array, rng: Rng) -> Array:
    """Random postures with stops of a third of a second to a second."""
    home, swing = robot.each("home"), robot.each("swing")
    poses = home + swing * rng.uniform(-1.0, 1.0, (40, len(home)))
    return _along(t, poses, robot.each("speed"), lambda: float(rng.uniform(0.3, 1.0)))


def pick_and_place(robot: Robot, t: Array, rng: Rng) -> Array:
    """The same few postures again and again: above, down, above, over there, down, back."""
    home, swing = robot.each("home"), robot.each("swing")
    here, there = home + swing * rng.uniform(0.3, 0.9, (2, len(home))) * np.where(
        rng.random((2, len(home))) < 0.5, -1, 1
    )
    low = [pose + 0.25 * swing * rng.uniform(-1.0, 1.0, len(home)) for pose in (here, there)]
    poses = np.array([here, low[0], here, there, low[1], there])
    return _along(t, poses, robot.each("speed"), lambda: float(rng.uniform(0.15, 0.8)))


def slow_sweeps(robot: Robot, t: Array, rng: Rng) -> Array:
    """One joint after the other back and forth at a constant speed, with holds; faster each round."""
    home, swing, speed = (robot.each(x) for x in ("home", "swing", "speed"))
    out, now, k, n = np.repeat(home[None], len(t), axis=0), 0.2, 0, len(home)
    while now < t[-1]:
        j, fast = k % n, speed[k % n] * (0.15, 0.35, 0.7)[(k // n) % 3]
        far = min(swing[j], 0.7 * fast) * rng.uniform(0.7, 1.0)
        knots = np.cumsum([0.0, far / fast, 0.3, 2.0 * far / fast, 0.3, far / fast])
        out[:, j] += np.interp(t - now, knots, [0.0, far, far, -far, -far, 0.0])
        now += knots[-1] + 0.2
        k += 1
    return out


def chirps(robot: Robot, t: Array, rng: Rng) -> Array:
    """A sine on every joint whose frequency rises and falls, never faster than the joint likes."""
    home, swing, speed = (robot.each(x) for x in ("home", "swing", "speed"))
    out = np.zeros((len(t), len(home)))
    for j in range(len(home)):
        low, high = rng.uniform(0.08, 0.2), rng.uniform(0.8, 2.0)
        rise = 0.5 - 0.5 * np.cos(2.0 * np.pi * t / rng.uniform(8.0, 14.0))
        rate = low * (high / low) ** rise
        phase = 2.0 * np.pi * np.cumsum(rate) * STEP + rng.uniform(0.0, 2.0 * np.pi)
        out[:, j] = np.minimum(0.8 * swing[j], speed[j] / (2.0 * np.pi * rate)) * np.sin(phase)
    return home + out


def teleoperation(robot: Robot, t: Array, rng: Rng) -> Array:
    """A hand's motion: a filtered random walk with pauses."""
    home, swing, speed = (robot.each(x) for x in ("home", "swing", "speed"))
    coarse = np.arange(0.0, t[-1] + 1.0, 0.02)
    walk = gaussian_filter1d(rng.standard_normal((len(coarse), len(home))), 12.0, axis=0)
    walk -= gaussian_filter1d(walk, 150.0, axis=0)
    pause = gaussian_filter1d((rng.random(len(coarse) // 40 + 1).repeat(40)[: len(coarse)] > 0.25).astype(float), 8.0)
    pace = np.interp(np.cumsum(pause) * 0.02, coarse, np.arange(len(coarse)) * 1.0)
    walk = np.stack([np.interp(pace, np.arange(len(coarse)), one) for one in walk.T], axis=1)
    walk = gaussian_filter1d(walk, 6.0, axis=0)
    size = np.minimum(
        0.9 * swing / np.abs(walk).max(axis=0), 1.2 * speed / np.abs(np.gradient(walk, 0.02, axis=0)).max(axis=0)
    )
    return home + size * np.stack([np.interp(t, coarse, one) for one in walk.T], axis=1)


def sines(robot: Robot, t: Array, rng: Rng) -> Array:
    """A sum of five sines on every joint."""
    home, swing, speed = (robot.each(x) for x in ("home", "swing", "speed"))
    rates = 2.0 * np.pi * rng.uniform(0.08, 0.9, (5, len(home)))
    phases, heights = rng.uniform(0.0, 2.0 * np.pi, (2, 5, len(home)))
    wave = sum((h / r) * np.sin(r * t[:, None] + p) for h, r, p in zip(heights, rates, phases, strict=True))
    fastest = np.abs(np.gradient(wave, STEP, axis=0)).max(axis=0)
    return home + wave * np.minimum(0.9 * swing / np.abs(wave).max(axis=0), speed / fastest)


MOTIONS = (point_to_point, pick_and_place, slow_sweeps, chirps, teleoperation, sines)
SWEEP = 4.0  # that one joint of a slow sweep takes at most [s]
LEAST = {point_to_point: 9.0, pick_and_place: 9.0}  # stop-and-go needs more time than a chirp


def draw_motion(robot: Robot, which: int, rng: Rng) -> tuple[str, Array]:
    """Name of a motion and its reference at every step [rad or m], shape ``(K, n)``."""
    motion = MOTIONS[which % len(MOTIONS)]
    low = max(LEAST.get(motion, SHORTEST), len(robot.names) * SWEEP if motion is slow_sweeps else 0.0)
    duration = float(np.exp(rng.uniform(np.log(low), np.log(LONGEST))))
    t, pace = np.arange(0.0, duration, STEP), float(rng.uniform(*PACE))
    joints = tuple(replace(joint, speed=pace * joint.speed) for joint in robot.kind.joints)
    robot = replace(robot, kind=replace(robot.kind, joints=joints))
    return motion.__name__, gaussian_filter1d(motion(robot, t, rng), ROUNDING / STEP, axis=0, mode="nearest")
