"""Motion of a model along a whole recording, started again from the recorded state every few tenths of a second.

Free motion under a recorded torque runs away from any recording, as an error of the torque grows with the time squared.
The recorded state is therefore taken up again and again (multiple shooting, as in the rollout of a diagnosis).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from identification.data.log import Log
from identification.rollout.driven import SHORTEST, STEP, acting_torque
from identification.rollout.hidden_states import hides
from identification.rollout.rollout_starts import States, Window, window_at
from identification.rollout.shots import Shot, under_control, under_torque
from identification.rollout.simulated_models import LEAD, Model
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.errors import PhantomDynError

_FEWEST = 3
"""Samples of a stretch that is simulated: a shorter one at the end belongs to the one before."""


@dataclass(frozen=True, eq=False)
class ReplayedMotion:
    """Positions of models along one recording.

    Attributes:
        horizon_s: How long each stretch was followed [s]; None where nothing could be simulated.
        q: Readings [rad or m] of each model at every sample, ``(N, nv)``; NaN where a sample must not be used, or
            where the model cannot be simulated.
        notes: Sentences: a horizon that was shortened, or why a model was not simulated.
    """

    horizon_s: float | None
    q: tuple[Float[Array, "N nv"], ...]
    notes: tuple[str, ...] = ()


def replayed_motion(
    log: Log,
    states: States,
    models: Mapping[str, Model],
    horizons: tuple[float, ...],
    *,
    controlled: bool = False,
    progress: Progress = lambda _: None,
) -> ReplayedMotion:
    """Motion of each model over the longest horizon at which none that can be simulated leaves all bounds.

    Args:
        log: The recording.
        states: Its smoothed states.
        models: What moves, by name.
        horizons: To choose from [s], the longest first.
        controlled: Under the stated controllers and recorded references in place of the recorded torque.
        progress: Takes the stages.
    """
    found: dict[str, tuple[float, Array]] = {}
    notes: list[str] = []
    for name, model in models.items():
        problem = ""
        for horizon in horizons:
            try:
                found[name] = horizon, _followed(log, states, model, horizon, controlled, progress)
                break
            except (PhantomDynError, np.linalg.LinAlgError) as error:
                problem = problem or str(error)
        if name not in found:
            notes.append(f"The motion of the {name} cannot be simulated: {problem[:1].lower()}{problem[1:]}")
    if not found:
        nothing = np.full(log.motion.q.shape, np.nan)
        return ReplayedMotion(None, tuple(nothing for _ in models), tuple(notes))
    least = min(horizon for horizon, _ in found.values())
    if least < horizons[0]:
        notes.append(_shortened(horizons[0], least))
    q = []
    for name, model in models.items():
        horizon, one = found.get(name, (least, np.full(log.motion.q.shape, np.nan)))
        q.append(one if horizon == least else _followed(log, states, model, least, controlled, progress))
    return ReplayedMotion(least, tuple(q), tuple(notes))


def stretches(valid: Bool[Array, " N"], length: int) -> tuple[tuple[int, int], ...]:
    """First sample of each stretch of valid samples, and one after its last; together they are all that can be used.

    Args:
        valid: False for samples that must not be used.
        length: Samples of a stretch; the last one before a gap is shorter, or longer by less than `_FEWEST`.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], valid, [False]]).astype(int)))
    out = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        firsts = list(range(start, stop, length))
        if len(firsts) > 1 and stop - firsts[-1] < _FEWEST:
            firsts.pop()
        out += [(a, b) for a, b in zip(firsts, [*firsts[1:], stop], strict=True) if b - a >= _FEWEST]
    return tuple(out)


def _followed(
    log: Log, states: States, model: Model, horizon: float, controlled: bool, progress: Progress
) -> Float[Array, "N nv"]:
    """Readings of one model, NaN where it was not simulated."""
    step = model.longest_step(states.q[0])
    step = min(step, _step_of_controllers(model, states.q[0])) if controlled else step
    if step < SHORTEST:
        raise PhantomDynError(f"A transmission or controller is so stiff that steps of {step:.2g} s would be needed.")
    out = np.full(log.motion.q.shape, np.nan)
    torque = acting_torque(model, log)
    parts = stretches(log.valid, max(_FEWEST, round(horizon * log.band.rate_hz)))
    for k, (start, stop) in enumerate(parts):
        progress(Announcement(Stage.SIMULATION, k + 1, len(parts)))
        window = window_at((log,), Window(0, start, stop, -1, 0), LEAD)
        assert window is not None  # all its samples are valid
        out[start:stop] = _read(Shot(log, states, window), model, torque, min(step, STEP) if controlled else None)
    return out


def _read(shot: Shot, model: Model, torque: Float[Array, "N nv"], step: float | None) -> Float[Array, "n nv"]:
    """Readings over one stretch; hidden states are those that the motion before it pulls the model into.

    Args:
        shot: The stretch.
        model: What moves.
        torque: Behind its drives.
        step: Longest step [s] under the stated controllers; None: under the recorded torque.
    """
    shot = shot.pulled(model, torque) if hides(model) else shot
    return under_torque(shot, model, torque) if step is None else under_control(shot, model, max_step=step)


def _step_of_controllers(model: Model, q: Float[Array, " nv"]) -> float:
    """Longest step [s] that follows how the stated controllers damp the links: half of the fastest decay's time."""
    gains = [0.0 if a.controller is None else a.controller.kd for a in model.robot.actuators]
    rates = np.linalg.eigvals(np.linalg.solve(mass_matrix(model.robot, q[None])[0], np.diag(gains)))
    return 0.5 / max(float(np.abs(rates).max()), 1e-9)


def _shortened(wanted: float, horizon: float) -> str:
    return (
        f"Simulated motion starts again from the recorded one every {horizon:g} s: over {wanted:g} s it leaves all "
        "bounds."
    )
