"""A robot, its model and a session, before anything is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from .drives import ROBOTS, draw_table
from .effects import Effect, plant_with
from .outside import prepared
from .plant import Outside
from .reference import KINDS, SLOW, draw_reference
from .robots import Table, Tolerance, perturbed
from .simulate import Run, Session, feedforward, simulate
from .sizing import BAND

NOISE = (0.01, 0.03)  # disturbance over the torque of the motion, drawn evenly in the logarithm
SECONDS = (12.0, 15.0)
FAST_SHARE = {"six": 0.25, "panda": 0.25}  # of recordings at 1000 Hz, not 500; of the others half
CODES = {"null": 0, "single": 1, "pair": 2, "outside": 3}
TRIES_PER_ROBOT = 3


@dataclass(frozen=True)
class Setup:
    """A robot, its model and a session, before any effect.

    Attributes:
        owner: The model that the diagnosis is given.
        truth: The robot that moves.
        tolerance: What the model states about itself.
        torque_hold: ``zoh`` or ``instant``, as the log is written.
        reference_kind: Of the motion.
        session: Reference, noise and encoder.
    """

    owner: Table
    truth: Table
    tolerance: Tolerance
    torque_hold: str
    reference_kind: str
    session: Session


def _disturbance(rng: np.random.Generator, n: int, rate: float, level: np.ndarray) -> np.ndarray:
    """Torque noise, white and first-order coloured in equal parts within the band, ``(n, nv)`` [N m]."""
    white = rng.normal(size=(n, len(level))) * np.sqrt(0.5 * rate / (2.0 * BAND))
    keep = np.exp(-2.0 * np.pi * rng.uniform(5.0, 15.0) / rate)
    coloured = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.normal(size=(n, len(level))), axis=0)
    return level * np.sqrt(0.5) * (white + coloured)


def generators(seed: int, kind: str, attempt: int, *names: str) -> dict[str, np.random.Generator]:
    """Independent random numbers for each purpose."""
    return {name: np.random.default_rng([seed, CODES[kind], attempt, i]) for i, name in enumerate(names)}


def draw_setup(
    seed: int,
    attempt: int = 0,
    *,
    kind: str = "single",
    robot: str | None = None,
    tolerance: Tolerance | None = None,
    full: bool = False,
    outside: str = "",
    slow: bool = False,
) -> Setup:
    """Robot, truth, motion and noise of a seed.

    Args:
        seed: Of the case; the robot follows from it too, so that a block of seeds holds every robot equally often.
        attempt: Counts redraws of an impossible motion or effect; another robot after `TRIES_PER_ROBOT`.
        kind: Of the case.
        robot: In place of the seed's.
        tolerance: In place of the default.
        full: Draws the truth evenly over the whole tolerance.
        outside: Cause outside the catalogue that is to come.
        slow: Moves as people record them by hand, see `reference.SLOW`.
    """
    rng = generators(seed, kind, attempt, "robot", "truth", "motion", "noise")
    tolerance = tolerance or Tolerance()
    name = robot or ROBOTS[(seed + attempt // TRIES_PER_ROBOT) % len(ROBOTS)]
    owner = prepared(draw_table(rng["robot"], name), outside)
    fast = FAST_SHARE.get(name, 0.5)
    rate = float(rng["motion"].choice((500.0, 1000.0), p=(1.0 - fast, fast)))
    n = round(rate * rng["motion"].uniform(*SECONDS))
    motion = str(rng["motion"].choice(SLOW) if slow else rng["motion"].choice(KINDS, p=(0.1, 0.15, 0.75)))
    reference = draw_reference(rng["motion"], owner, motion, np.arange(n) / rate)
    noise = rng["noise"]
    level = np.exp(noise.uniform(*np.log(NOISE))) * np.sqrt(np.mean(feedforward(owner, reference, rate) ** 2, axis=0))
    counts = 4096 * int(np.exp(noise.uniform(np.log(4), np.log(128.999))))
    hold = str(noise.choice(("zoh", "instant"), p=(0.75, 0.25)))
    dither = noise.normal(size=reference.shape) * 0.2 * 2.0 * np.pi / counts
    session = Session(
        rate, reference, _disturbance(noise, n, rate, level), counts, dither, float(noise.uniform(3.0, 6.0))
    )
    return Setup(owner, perturbed(rng["truth"], owner, tolerance, full=full), tolerance, hold, motion, session)


def quiet(setup: Setup) -> Setup:
    """The same setup without any noise and with an ideal encoder."""
    session, none = setup.session, np.zeros_like(setup.session.reference)
    return replace(setup, session=replace(session, disturbance=none, dither=none, encoder_counts=0))


def run_of(setup: Setup, *effects: Effect, outside: Outside | None = None) -> Run:
    """The recording of the setup with the effects in the robot."""
    plant = replace(plant_with(effects, setup.truth), outside=outside)
    return simulate(plant, setup.owner, setup.session)


def logged_torque(run: Run, torque_hold: str) -> np.ndarray:
    """The torque column: the held value, or at the sample itself the mean of the holds on both sides of it."""
    if torque_hold == "zoh":
        return run.command
    before = np.vstack([run.command[:1], run.command[:-1]])
    return 0.5 * (before + run.command)


def tracks(run: Run, setup: Setup) -> bool:
    """The robot went where it was sent, and not through its joint limits."""
    error = np.abs(run.seen - setup.session.reference)
    return bool(np.isfinite(run.q).all() and error.max() < 0.6 and np.abs(run.q).max() < 3.8)
