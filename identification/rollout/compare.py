"""Computes the simulation errors of the given and the corrected model, started from the recorded states of windows.

The prediction horizon is the longest time over which the noise of the starting state causes only small errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field

import numpy as np

from identification.notes import Code, Note
from identification.rollout.joint_limits import EngagedLimit, Simulated, limit_notes, limits_engaged
from identification.rollout.rollout_starts import Window
from identification.rollout.shots import Shot
from identification.rollout.simulated_models import Model
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.model.robot import Robot
from phantom_dyn.random_streams import random_stream

HORIZONS = (0.5, 0.35, 0.25, 0.15, 0.1, 0.06, 0.04)  # [s], the longest first
# Largest allowed error by noise of the starting state: this share of the given model's error, or of the joints' travel.
_SHARE_OF_ERROR, _SHARE_OF_TRAVEL = 0.33, 0.05
# Function that simulates one window with one model and returns the simulated encoder readings. The third argument is
# added to position and velocity at the start.
Shoot = Callable[[Shot, Model, Float[Array, "2 nv"] | None], Float[Array, "n nv"]]
# Function that returns a window with estimated hidden states of a model (such as the deflection of a spring) at its
# start.
HiddenStates = Callable[[Shot, Model], Shot]


@dataclass(frozen=True)
class Errors:
    """Simulated minus recorded positions of each window, each ``(n, nv)``; NaN for joints that a window leaves out.

    Attributes:
        t: Time since the start of each window [s], ``(n,)``.
        before: Errors of the given model.
        after: Errors of the corrected model.
        noise: Change of the corrected model's motion by noise of the starting state.
        travel: Recorded positions minus the position at the start.
    """

    t: tuple[Float[Array, " _"], ...]
    before: tuple[Float[Array, "_ nv"], ...]
    after: tuple[Float[Array, "_ nv"], ...]
    noise: tuple[Float[Array, "_ nv"], ...]
    travel: tuple[Float[Array, "_ nv"], ...]

    def of(self, windows: list[int]) -> Errors:
        """Errors of some of the windows."""
        every = (self.t, self.before, self.after, self.noise, self.travel)
        return Errors(*(tuple(series[k] for k in windows) for series in every))

    def rms(self, series: tuple[Float[Array, "_ nv"], ...], horizon: float) -> Float[Array, " nv"]:
        """Root mean square of a series over all windows up to the horizon; zero for joints that no window compares."""
        kept = np.concatenate([x[1:][t[1:] <= horizon + 1e-9] for t, x in zip(self.t, series, strict=True)])
        count = np.count_nonzero(~np.isnan(kept), axis=0)
        return np.sqrt(np.nansum(kept**2, axis=0) / np.maximum(count, 1))

    @property
    def is_compared(self) -> Bool[Array, " nv"]:
        """True for joints that some window compares."""
        return np.any([~np.isnan(x[0]) for x in self.travel], axis=0)


def possible_horizons(errors: Errors, horizons: tuple[float, ...]) -> tuple[float, ...]:
    """Horizons that contain two samples and fit into the windows; if there are none, the length of the windows."""
    long = max(float(t[-1]) for t in errors.t)
    step = max(float(t[1]) for t in errors.t)
    return tuple(h for h in horizons if 2 * step <= h <= long + 0.5 * step) or (long,)


def horizon_of(errors: Errors, horizons: tuple[float, ...] = HORIZONS) -> float:
    """The longest horizon over which errors by noise of the starting state are small on every joint, or the shortest.

    Args:
        errors: Errors over the longest horizon.
        horizons: Candidates, the longest first; those with fewer than two samples are left out.
    """
    possible = possible_horizons(errors, horizons)
    for horizon in possible:
        allowed = np.maximum(
            _SHARE_OF_ERROR * errors.rms(errors.before, horizon), _SHARE_OF_TRAVEL * errors.rms(errors.travel, horizon)
        )
        if (errors.rms(errors.noise, horizon) <= allowed).all():
            return horizon
    return possible[-1]


@dataclass(frozen=True)
class WindowMotion:
    """Simulated encoder readings [rad or m] of both models in one window; NaN for joints that the window leaves out."""

    window: Window
    given: Float[Array, "n nv"]
    corrected: Float[Array, "n nv"]


@dataclass(frozen=True)
class Rollout:
    """Errors of simulated motion of both models by joint.

    Attributes:
        horizon_s: Time over which each window is compared [s]; None if no motion could be simulated.
        rms_before: Error of the given model by joint [rad or m].
        rms_after: Error of the corrected model.
        noise: Standard deviation of the encoder readings of each joint [rad or m], the smallest error that is possible.
        deviations: If there are no findings, joints whose error exceeds the 99 % noise band, with the ratio of the
            error to the upper end of the band.
        recordings: Errors of given and corrected model for each recording, if there are several.
        engaged: Joint limits that simulated motion passes.
        warnings: Notes on joint limits.
        notes: Notes on a shortened horizon, or on why no motion was simulated.
        motions: Simulated motion of both models in each window, over the whole window.
        controlled: True if controllers moved the joints instead of the recorded torque.
    """

    horizon_s: float | None
    rms_before: dict[str, float]
    rms_after: dict[str, float]
    noise: dict[str, float] = field(default_factory=dict)
    deviations: dict[str, float] = field(default_factory=dict)
    recordings: dict[str, tuple[dict[str, float], dict[str, float]]] = field(default_factory=dict)
    engaged: tuple[EngagedLimit, ...] = ()
    warnings: tuple[Note, ...] = ()
    notes: tuple[Note, ...] = ()
    motions: tuple[WindowMotion, ...] = ()
    controlled: bool = False

    @property
    def json(self) -> dict | None:
        """The entry ``rollout`` of ``diagnosis.json``; None if no motion could be simulated."""
        if self.horizon_s is None:
            return None
        out: dict = {"horizon_s": self.horizon_s, "rms_before": self.rms_before, "rms_after": self.rms_after}
        if self.noise:
            out["reading_noise"] = self.noise
        if self.deviations:
            out["strays"] = self.deviations
        if self.recordings:
            out["recordings"] = [
                {"recording": name, "rms_before": before, "rms_after": after}
                for name, (before, after) in self.recordings.items()
            ]
        if self.engaged:
            out["limits_engaged"] = [asdict(one) for one in self.engaged]
        return out


def compare_models(
    robot: Robot,
    models: Callable[[Window], tuple[Model, Model]],
    shots: tuple[Shot, ...],
    shoot: Shoot,
    horizons: tuple[float, ...],
    hidden_states: HiddenStates,
    *,
    controlled: bool,
) -> Rollout:
    """Errors of both models over the longest horizon that the noise of the starting states allows.

    Args:
        robot: The robot with joints and their limits.
        models: Function from a window to the given and the corrected model; the corrected one is fitted without the
            window.
        shots: At least one window, as long as the longest horizon.
        shoot: Function that simulates a window.
        horizons: Candidate horizons [s], the longest first.
        controlled: True if controllers move the joints instead of the recorded torque.
        hidden_states: Function that estimates the hidden states of the corrected model at the start of a window.

    Raises:
        ParameterError: If a simulated motion diverges.
    """
    rng = random_stream("noise of rollout starts")
    before, after, noise = [], [], []
    for plain in shots:
        given, model = models(plain.window)
        shot = hidden_states(plain, model)
        signs = rng.choice([-1.0, 1.0], (2, robot.nv))
        shift = signs * np.array([shot.states.q_std, shot.states.v_std])
        corrected, mask = shoot(shot, model, None), _nan_unless_compared(shot.window, robot.nv)
        before.append(shoot(shot, given, None) - shot.read + mask)
        after.append(corrected - shot.read + mask)
        noise.append(shoot(shot, model, shift) - corrected + mask)
    travel = tuple(shot.read - shot.read[0] + _nan_unless_compared(shot.window, robot.nv) for shot in shots)
    errors = Errors(tuple(shot.t for shot in shots), tuple(before), tuple(after), tuple(noise), travel)
    horizon = horizon_of(errors, horizons)
    shorter = Note(Code.SHORTER_HORIZON, None, {"seconds": horizon, "controlled": controlled})
    notes = () if horizon >= possible_horizons(errors, horizons)[0] else (shorter,)
    engaged = limits_engaged(robot, tuple(_motion_up_to(shot, errors, k, horizon) for k, shot in enumerate(shots)))
    read_std = np.sqrt(np.mean([shot.states.scatter**2 for shot in shots], axis=0))
    read_noise = dict(zip(robot.joint_names, read_std.tolist(), strict=True))
    files = list(dict.fromkeys(shot.log.file for shot in shots))
    by_recording = {
        file: _sizes(robot, errors.of([k for k, shot in enumerate(shots) if shot.log.file == file]), horizon)
        for file in (files if len(files) > 1 else [])
    }
    return Rollout(
        horizon,
        *_sizes(robot, errors, horizon),
        noise=read_noise,
        recordings=by_recording,
        engaged=engaged,
        warnings=limit_notes(robot, engaged),
        notes=notes,
        motions=tuple(
            WindowMotion(shot.window, shot.read + of_given, shot.read + of_corrected)
            for shot, of_given, of_corrected in zip(shots, errors.before, errors.after, strict=True)
        ),
        controlled=controlled,
    )


def _nan_unless_compared(window: Window, nv: int) -> Float[Array, " nv"]:
    """Zero for joints that a window compares and NaN for all others, ``(nv,)``."""
    out = np.zeros(nv) if window.joints is None else np.full(nv, np.nan)
    out[list(window.joints or ())] = 0.0
    return out


def _sizes(robot: Robot, errors: Errors, horizon: float) -> tuple[dict[str, float], dict[str, float]]:
    """RMS error of the given and of the corrected model by joint."""
    names = [joint for joint, own in zip(robot.joint_names, errors.is_compared, strict=True) if own]
    before, after = (errors.rms(x, horizon)[errors.is_compared].tolist() for x in (errors.before, errors.after))
    return dict(zip(names, before, strict=True)), dict(zip(names, after, strict=True))


def _motion_up_to(shot: Shot, errors: Errors, k: int, horizon: float) -> Simulated:
    """Recorded and simulated motion of a window up to the horizon."""
    keep = errors.t[k] <= horizon + 1e-9
    t = shot.log.motion.t[shot.window.start : shot.window.stop]
    read = shot.read
    return Simulated(
        shot.log.file, t[keep], read[keep], (read + errors.before[k])[keep], (read + errors.after[k])[keep]
    )
