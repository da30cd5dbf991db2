"""The gap in motion: given and corrected model simulated from many recorded states, and how far they stray."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.diagnosis.fitted import Fitted
from identification.diagnosis.gap import judged_blocks
from identification.diagnosis.problem import Problem
from identification.diagnosis.search import ordered
from identification.diagnosis.terms import KnownEffect, Term
from identification.log import Log
from identification.rollout.drives import given_torque
from identification.rollout.errors import HORIZONS, Errors, horizon_of
from identification.rollout.limits import limit_warnings
from identification.rollout.models import Model, corrected_model, known_causes, model_of
from identification.rollout.shots import STEP, Shot, controlled, under_control, under_torque
from identification.rollout.starts import states_of
from identification.rollout.windows import windows_in
from phantom_dyn.errors import ParameterError, PhantomDynError, RobotError
from phantom_dyn.kernels.jit import compiles
from phantom_dyn.robot import Robot

Array = np.ndarray
# Readings of one window by one model, from a start that is moved by (position, velocity).
Shoot = Callable[[Shot, Model, Float[Array, "2 nv"] | None], Float[Array, "n nv"]]

_MOST, _FEWEST = 36, 6  # windows
_STEPS = 60_000  # joint steps of one model over all windows: about a third of a second where steps are compiled
_SLOWER = 40  # how many times as long a step takes where Python has to do it
_LEAD = 0.15  # [s] before a window, in which hidden states settle
_CONTROLLED = (2.0, 1.0, 0.5, 0.25)  # [s] under controllers, which hold a motion together


@dataclass(frozen=True)
class Rollout:
    """What simulated motion says of both models.

    Attributes:
        horizon_s: How long each window was followed [s]; None where no motion could be simulated.
        rms_before: Error of the given model by joint [rad or m].
        rms_after: Of the corrected model.
        warnings: Sentences on joint limits.
        notes: Sentences: a horizon that was shortened, or why there is none at all.
    """

    horizon_s: float | None
    rms_before: dict[str, float]
    rms_after: dict[str, float]
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def json(self) -> dict | None:
        """The contract's ``rollout``."""
        if self.horizon_s is None:
            return None
        return {"horizon_s": self.horizon_s, "rms_before": self.rms_before, "rms_after": self.rms_after}


@dataclass(frozen=True)
class Explained:
    """What a diagnosis has made of recordings, as far as rollouts need it.

    Attributes:
        robot: The given model.
        known: Effects that belong to it.
        logs: Recordings, ready for fitting.
        cutoff_hz: Edge of the judged band.
        problem: Blocks and folds.
        terms: Effects that were found.
        found: Their fit, with the fits that have not seen each fold.
    """

    robot: Robot
    known: tuple[KnownEffect, ...]
    logs: tuple[Log, ...]
    cutoff_hz: float
    problem: Problem
    terms: frozenset[Term]
    found: Fitted

    def theta(self, fold: int) -> Float[Array, " K"]:
        """Coefficients of the fit that has not seen a fold."""
        return self.found.theta if fold < 0 else self.found.fold_theta[fold]


def rollout_of(explained: Explained) -> Rollout:
    """Rollouts under the recorded torque, from smoothed states, on windows that the fit in use has not seen.

    Args:
        explained: A diagnosis as far as it has come.
    """
    torques: dict[tuple[Model, int], Array] = {}

    def shoot(shot: Shot, model: Model, nudge: Float[Array, "2 nv"] | None) -> Float[Array, "n nv"]:
        key = (model, shot.window.log)
        if key not in torques:
            torques[key] = given_torque(model, shot.log.motion.t, shot.log.tau)
        return under_torque(shot, model, torques[key], nudge)

    return _tried(explained, shoot, HORIZONS, "the recorded torque")


def controlled_rollout_of(explained: Explained) -> Rollout | None:
    """The same under controllers and references; None where one of them is not known.

    Args:
        explained: A diagnosis as far as it has come.
    """
    if not controlled(explained.robot) or any(log.q_ref is None for log in explained.logs):
        return None
    return _tried(explained, under_control, _CONTROLLED, "the stated controllers")


def _tried(explained: Explained, shoot: Shoot, horizons: tuple[float, ...], drive: str) -> Rollout:
    """Rollouts over the longest horizon at which no model leaves all bounds."""
    problem: PhantomDynError = ParameterError("there is no stretch of valid samples long enough")
    for horizon in horizons:
        try:
            return _rolled(explained, shoot, tuple(h for h in horizons if h <= horizon), drive)
        except RobotError as error:
            problem = error
            break
        except PhantomDynError as error:
            problem = error
    return Rollout(None, {}, {}, notes=(f"No motion was simulated under {drive}: {_begun(str(problem))}",))


def _rolled(explained: Explained, shoot: Shoot, horizons: tuple[float, ...], drive: str) -> Rollout:
    robot = explained.robot
    given = model_of(robot, known_causes(explained.known))
    shots = _shots(explained, horizons[0])
    if not shots:
        raise ParameterError("there is no stretch of valid samples long enough.")
    terms = ordered(explained.terms)
    folds = {shot.window.fold for shot in shots}
    models = {fold: corrected_model(robot, explained.known, terms, explained.theta(fold)) for fold in folds}
    rng = np.random.default_rng(20260107)
    before, after, noise = [], [], []
    for shot in shots:
        model = models[shot.window.fold]
        signs = rng.choice([-1.0, 1.0], (2, robot.nv))
        nudge = signs * np.array([shot.states.q_std, shot.states.v_std])
        moved = shoot(shot, model, None)
        before.append(shoot(shot, given, None) - shot.read)
        after.append(moved - shot.read)
        noise.append(shoot(shot, model, nudge) - moved)
    read = tuple(shot.read for shot in shots)
    travel = tuple(q - q[0] for q in read)
    errors = Errors(tuple(shot.t for shot in shots), tuple(before), tuple(after), tuple(noise), travel)
    horizon = horizon_of(errors, horizons)
    notes = () if horizon >= max(horizons) else (_shortened(horizon, drive),)
    warnings = limit_warnings(robot, *_within(errors, read, horizon))
    rms = [
        dict(zip(robot.joint_names, errors.rms(s, horizon).tolist(), strict=True))
        for s in (errors.before, errors.after)
    ]
    return Rollout(horizon, *rms, warnings, notes)


def _shots(explained: Explained, seconds: float) -> tuple[Shot, ...]:
    problem, logs = explained.problem, explained.logs
    chain = explained.robot.chain
    slow = 1 if compiles() and not (chain is not None and chain.anchors) else _SLOWER
    # A sample takes a step at least.
    step = min(STEP, *(1.0 / log.band.rate_hz for log in logs))
    count = int(np.clip(_STEPS * step / (seconds * explained.robot.nv * slow), _FEWEST, _MOST))
    windows = windows_in(
        logs, problem.blocks, problem.grams.fold, judged_blocks(problem), seconds=seconds, lead=_LEAD, count=count
    )
    states = {k: states_of(logs[k], explained.cutoff_hz) for k in {window.log for window in windows}}
    return tuple(Shot(logs[window.log], states[window.log], window) for window in windows)


def _within(
    errors: Errors, read: tuple[Float[Array, "_ nv"], ...], horizon: float
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Recorded and simulated positions of each window up to the horizon."""
    keep = [t <= horizon + 1e-9 for t in errors.t]
    return (
        tuple(q[k] for q, k in zip(read, keep, strict=True)),
        tuple((q + e)[k] for q, e, k in zip(read, errors.after, keep, strict=True)),
    )


def _shortened(horizon: float, drive: str) -> str:
    return (
        f"Simulated motion under {drive} is compared over {horizon:g} s: over longer times the noise of the start "
        "would grow into a large part of the error."
    )


def _begun(text: str) -> str:
    return text[:1].lower() + text[1:]
