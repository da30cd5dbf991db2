"""Robots with one effect that Drake simulates, recorded as in that make and then along another motion."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.fresh_noise import fresh_noise
from benchmarks.gapbench.makes.drake.case import draw_open, write_case
from benchmarks.gapbench.makes.drake.files import write_log
from benchmarks.gapbench.makes.drake.motions import Motion as Reference
from benchmarks.gapbench.makes.drake.plant import Plant
from benchmarks.gapbench.makes.drake.session import LEAD, Setup, feedforward, uneven_ticks
from benchmarks.gapbench.makes.drake.sizing import Found, run_with
from benchmarks.next_experiment_makes import Case
from identification.data.changes import KnownPayload
from identification.data.reading import read_recording
from identification.data.recording import Recording
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def drawn_case(seed: int) -> Case | None:
    """The single case of a development seed with its ordinary recording, or None."""
    drawn = draw_open(seed)
    if drawn is None:
        return None
    case, measure, found = drawn
    with tempfile.TemporaryDirectory() as folder:
        place = write_case(case, Path(folder))
        robot = load_robot(str(place / "robot.urdf"))
        first = read_recording(place / "log.csv", robot)
    effect, setup = found.effects[0], measure.setup
    name = f"{setup.given.kind}, {setup.reference}"
    return Case(name, robot, (effect.name, effect.joint), first, Repeated(seed, setup, found, robot))


@dataclass(frozen=True)
class Repeated:
    """Records the robot of a case along other motions with the same controller, drives and encoders.

    Attributes:
        seed: Seed of the case.
        setup: Everything except the effect.
        found: Effect with its size.
        given: Given model.
    """

    seed: int
    setup: Setup
    found: Found
    given: Robot

    def __call__(self, motion: Motion, noise: int, payload: KnownPayload | None = None) -> Recording | None:
        """Record a motion, see `Again`."""
        setup = along(self.setup, motion, np.random.default_rng([self.seed, 713, noise]))
        if payload is not None:
            setup = replace(setup, truth=replace(setup.truth, carried=(payload.mass, payload.center)))
        run = run_with(setup, list(zip(self.found.effects, self.found.magnitudes, strict=True)))
        if run is None:
            return None
        kept = run.t >= LEAD
        log = np.column_stack([run.t[kept] - run.t[kept][0], run.reading[kept], run.command[kept]])
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "next.csv"
            write_log(path, setup.given.joints, log)
            return read_recording(path, self.given)


def along(setup: Setup, motion: Motion, rng: np.random.Generator) -> Setup:
    """The same controller and robot on another reference, with new sampling times and noise."""
    session, rate = setup.session, setup.rate
    jitter = float(np.std(session.motion.t * rate - np.arange(len(session.motion.t))))
    t = uneven_ticks(rng, LEAD + float(motion.t[-1]), rate, jitter)
    at = np.clip(t - LEAD, 0.0, motion.t[-1])
    spline = CubicSpline(motion.t, motion.q, bc_type="clamped")
    # At rest before the motion.
    moving = (t > LEAD)[:, None]
    wanted = Reference(t, spline(at), moving * spline(at, 1), moving * spline(at, 2))
    known = feedforward(setup.given, Plant(setup.given), wanted)
    noise = fresh_noise(session.noise, len(t), rng)
    return replace(setup, session=replace(session, motion=wanted, feedforward=known, noise=noise))
