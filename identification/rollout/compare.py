"""Given and corrected model shot from the same states: errors, horizon and what to say of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.rollout.errors import Errors, horizon_of, possible_horizons
from identification.rollout.limits import limit_warnings
from identification.rollout.models import Model
from identification.rollout.shots import Shot
from identification.rollout.windows import Window
from phantom_dyn.robot import Robot

Array = np.ndarray
# Readings of one window by one model, from a start that is moved by (position, velocity).
Shoot = Callable[[Shot, Model, Float[Array, "2 nv"] | None], Float[Array, "n nv"]]

# A window with what a model makes of the hidden states before it.
Settle = Callable[[Shot, Model], Shot]


def unsettled(shot: Shot, model: Model) -> Shot:
    """The window as it is."""
    return shot


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


def compared(
    robot: Robot,
    models: Callable[[Window], tuple[Model, Model]],
    shots: tuple[Shot, ...],
    shoot: Shoot,
    horizons: tuple[float, ...],
    drive: str,
    settle: Settle = unsettled,
) -> Rollout:
    """Errors of both models over the longest horizon that the noise of the starts allows.

    Args:
        robot: Gives joints and their limits.
        models: The given model and the corrected one that has not seen a window.
        shots: At least one window, as long as the longest horizon.
        shoot: Simulates a window.
        horizons: To choose from [s], the longest first.
        drive: What moves the joints, in words.
        settle: Adds what the corrected model makes of hidden states before a window; the given one starts as smoothed.

    Raises:
        ParameterError: If a motion leaves all bounds.
    """
    rng = np.random.default_rng(20260107)
    before, after, noise = [], [], []
    for plain in shots:
        given, model = models(plain.window)
        shot = settle(plain, model)
        signs = rng.choice([-1.0, 1.0], (2, robot.nv))
        moved = shoot(shot, model, None)
        before.append(shoot(shot, given, None) - shot.read)
        after.append(moved - shot.read)
        noise.append(shoot(shot, model, signs * np.array([shot.states.q_std, shot.states.v_std])) - moved)
    read = tuple(shot.read for shot in shots)
    travel = tuple(q - q[0] for q in read)
    errors = Errors(tuple(shot.t for shot in shots), tuple(before), tuple(after), tuple(noise), travel)
    horizon = horizon_of(errors, horizons)
    notes = () if horizon >= possible_horizons(errors, horizons)[0] else (_shortened(horizon, drive),)
    kept = _within(errors, read, horizon)
    warnings = limit_warnings(robot, kept[0], kept[1])
    names = robot.joint_names
    sizes = [dict(zip(names, errors.rms(x, horizon).tolist(), strict=True)) for x in (errors.before, errors.after)]
    return Rollout(horizon, sizes[0], sizes[1], warnings, notes)


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
