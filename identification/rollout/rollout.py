"""Simulates the given and the corrected model from many recorded states, and tests whether the errors are only noise.

The noise band of a joint is the error of a right model. Its causes are:

- noise of the initial state, noise of the torque, and errors of the fitted tolerance parameters: each of these is
  simulated once in every window,
- noise of the recorded states with which the simulation is compared,
- errors of filters and integration: a share of the joint's travel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.data.log import Log
from identification.data.unknown_drives import unknown_drives
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.motion.standstill import standing_still
from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.gap import held_out_torque, judged_blocks, residual_after, residual_sums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.result import Judgement
from identification.notes import Code, Note
from identification.rollout.compare import HORIZONS, HiddenStates, Rollout, Shoot, compare_models
from identification.rollout.joint_limits import recorded_past
from identification.rollout.rollout_starts import SHORTEST, STEP, Window, acting_torque, spread, states_of, windows_in
from identification.rollout.shots import (
    Shot,
    controlled,
    has_hidden_states,
    lead_for_hidden_states,
    simulation_count,
    under_control,
    under_torque,
)
from identification.rollout.simulated_models import LEAD, Model, at_work, corrected_model, known_causes, model_of
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import ParameterError, PhantomDynError, RobotError, RunawayError
from phantom_dyn.model.robot import Robot
from phantom_dyn.random_streams import random_stream

# Probability that a right model leaves its noise band on some joint. Tests of torques and motion together may give 5 %
# false alarms: 4 % by torques, 1 % by motion.
_LEVEL = 0.01
# A joint is at rest in a window if it is at rest in this share of the samples, because noise may look like motion. It
# is at rest for a while with the second share.
_AT_REST, _AT_REST_FOR_A_WHILE = 0.9, 0.1


def motion_deviations(
    shots: tuple[Shot, ...],
    models: Callable[[Window, int], Model],
    torque: Callable[[Shot, Model], Float[Array, "_ nv"]],
    noise: tuple[Float[Array, "_ nv"], ...],
    folds: tuple[int, ...],
    horizon: float,
    at_rest: tuple[Float[Array, " nv"], ...],
) -> Float[Array, " nv"]:
    """RMS error of each joint's simulated motion, divided by the upper limit of its 99 % noise band.

    A brake may hold a joint at rest, so that the recorded torque does not move it. If the simulation of a joint leaves
    the position in which the joint is at rest, every window in which the joint is at rest for a while is left out.

    Args:
        shots: Windows with their initial states.
        models: Function from a window and a fold to the model of the fit without the fold.
        torque: Function that returns the torque of a model's drives over the whole recording of a window.
        noise: Torque that counts as noise, for each recording.
        folds: Folds that were held out, at least two.
        horizon: Time over which windows are compared [s].
        at_rest: For each window, the share of its samples in which each joint is at rest.

    Raises:
        ParameterError: If a motion leaves all bounds.
    """
    from scipy.special import fdtri

    rng = random_stream("noise of rollout starts")
    squares: list[list[Array]] = []
    for shot in shots:
        window = shot.window
        model, other = models(window, window.fold), models(window, _other_fold(window.fold, folds))
        kept = slice(1, int(np.searchsorted(shot.t, horizon + 1e-9)))
        drive = torque(shot, model)
        simulated = under_torque(shot, model, drive)
        start_shift = rng.choice([-1.0, 1.0], simulated.shape[1:]) * np.array([shot.states.q_std, shot.states.v_std])
        # Noise from another time has the same size and spectrum as the noise in this window, but is independent of it.
        torque_noise = np.roll(noise[window.log], len(drive) // 2, axis=0)
        unknown = turning_torque(model.robot, shot.states.v)
        unknown *= rng.choice([-1.0, 1.0], unknown.shape)
        # Ratio of the error of a fit to the difference of two leave-one-fold-out fits (jackknife).
        jackknife = np.sqrt(0.5 * (len(folds) - 1))
        parts = (
            simulated - shot.read,  # the error; all following parts are possible errors of a right model
            under_torque(shot, model, drive, start_shift) - simulated,  # noise of the initial state
            under_torque(shot, model, drive + torque_noise + unknown) - simulated,  # noise as torque
            jackknife * (under_torque(shot, other, drive) - simulated),  # noise through the fit
            np.broadcast_to(shot.states.scatter, simulated.shape),  # noise of the recorded states
            rules.MODEL_SHARE * (shot.read - shot.read[0]),  # filters and integration
        )
        squares.append([np.mean(part[kept] ** 2, axis=0) for part in parts])
    error, expected = np.array(squares)[:, 0], np.maximum(np.sum(np.array(squares)[:, 1:], axis=1), 1e-300)

    def relative_to_band(error: Array, expected: Array, count: int) -> Array:
        # The upper limit of the band is the quantile of the F distribution; one over it is the lower quantile.
        return np.sqrt(error / expected * fdtri(count, count, _LEVEL / error.shape[-1]))

    share = np.array(at_rest)
    braked = ((share > _AT_REST) & (relative_to_band(error, expected, len(shots)) > 1.0)).any(axis=0)
    left_out = (braked & (share > _AT_REST_FOR_A_WHILE)).any(axis=1)
    if left_out.all():
        return np.zeros(error.shape[1])
    used = ~left_out
    return relative_to_band(error[used].mean(axis=0), expected[used].mean(axis=0), int(np.count_nonzero(used)))


def turning_torque(robot: Robot, v: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Standard deviation of the torque error by interpolation between two samples where a joint reverses.

    At a reversal the drive torque jumps by twice the Coulomb torque, at an unknown instant between two samples.
    Interpolation replaces the jump by a straight line, so that the mean torque between the samples is wrong by up to
    half the jump. A torque that the drive holds from sample to sample does not jump.

    Args:
        robot: The model with its friction.
        v: Velocities at the samples.
    """
    out = np.zeros_like(v)
    if robot.torque_hold != "zoh":
        # The instant of the jump is uniformly distributed between two samples: a deviation of 1 / sqrt(12) of the jump.
        out[:-1] = np.where(v[:-1] * v[1:] < 0.0, 2.0 * robot.coulomb_friction / np.sqrt(12.0), 0.0)
    return out


def _other_fold(fold: int, folds: tuple[int, ...]) -> int:
    """The fold after ``fold`` in ``folds``; the first one if ``fold`` is the last or not among them."""
    return folds[(folds.index(fold) + 1) % len(folds)] if fold in folds else folds[0]


def unknown_if_motion_deviates(judgement: Judgement, rollout: Rollout) -> Judgement:
    """The judgement; ``no_gap`` becomes ``unknown`` if simulated motion is far outside its noise band."""
    if judgement.verdict != "no_gap" or max(rollout.deviations.values(), default=0.0) < rules.STRAYS_FAR:
        return judgement
    joint = max(rollout.deviations, key=lambda name: rollout.deviations[name])
    return replace(judgement, verdict="unknown", unexplained=replace(judgement.unexplained, joint=joint))


_MOST, _FEWEST = 36, 6  # largest and smallest number of windows
_STEPS = 60_000  # largest number of integration steps times joints over all windows: about a third of a second
_HIDDEN_SIMULATIONS = 400  # largest number of short simulations for hidden states over all windows: about a second
_CONTROLLED = (2.0, 1.0, 0.5, 0.25)  # horizons [s] under controllers, which keep errors from growing


@dataclass(frozen=True)
class Explained:
    """Fits of a diagnosis that rollouts need.

    Attributes:
        problem: Columns and session of the fits.
        terms: Effects that were found.
        found: Fit of these effects to all blocks, and once without each fold.
        floor: Noise floor of each joint, ``(nv,)``.
    """

    problem: Problem
    terms: frozenset[Term]
    found: Fitted
    floor: Float[Array, " nv"]

    @property
    def session(self) -> Session:
        """Robot, logs and recordings."""
        return self.problem.session

    @property
    def controlled(self) -> bool:
        """True if the torque was not recorded, but computed from the stated controllers."""
        return any(recording.controlled for recording in self.session.recordings)

    def theta(self, fold: int) -> Float[Array, " K"]:
        """Coefficients of the fit without a fold; for fold -1 (blocks in no fit) those of the fit to all blocks."""
        return self.found.theta if fold < 0 else self.found.fold_theta[fold]


def rollout_of(explained: Explained) -> Rollout:
    """Simulations from smoothed recorded states; each window is simulated with a fit that has not seen it.

    The models move under the recorded torque. If controllers and references are known, a note states the error of the
    simulated closed loop, too. If no torque was recorded, only the closed loop is simulated.

    Args:
        explained: Fits of the diagnosis.
    """
    robot = explained.session.robot
    past = recorded_past(robot, explained.session.logs)
    if unknown_drives(robot).any():
        numbers = {"controlled": False, "problem": "a joint is moved by a torque that nobody knows"}
        return Rollout(None, {}, {}, warnings=past, notes=(Note(Code.NOT_SIMULATED, None, numbers),))
    torque = _torques()

    def hidden_states(shot: Shot, model: Model) -> Shot:
        if not has_hidden_states(model):
            return shot
        if robot.floating:  # the swing of a leg is too short for a fit of initial states to a part of it
            return shot.with_start_by_feedback(model, torque(shot, model))
        return shot.with_hidden_start(model, torque(shot, model))

    loop = _controlled_rollout(explained, hidden_states)
    if explained.controlled and loop is not None:
        return replace(loop, warnings=(*past, *loop.warnings))

    def shoot(shot: Shot, model: Model, start_shift: Float[Array, "2 nv"] | None) -> Float[Array, "n nv"]:
        return under_torque(shot, model, torque(shot, model), start_shift)

    out = _longest_rollout(explained, shoot, HORIZONS, hidden_states, by_control=False)
    # Robots with a floating base are not tested, because the noise band does not include noise of the base's sensors.
    if not explained.terms and out.horizon_s is not None and not robot.floating:
        out = replace(out, deviations=_deviations(explained, out.horizon_s))
    loop_notes = () if loop is None else _loop_notes(loop)
    return replace(out, warnings=(*past, *out.warnings), notes=(*out.notes, *loop_notes))


def _deviations(explained: Explained, horizon: float) -> dict[str, float]:
    """Results of `motion_deviations` for the joints that leave their noise bands, if there are no findings."""
    problem, session = explained.problem, explained.session
    operations, torque = problem.columns.operations, _torques()
    made: dict[tuple[int, int, int], Model] = {}

    def model(window: Window, fold: int) -> Model:
        operation = operations[window.log]
        key = (window.log, fold, _temperature_key(window, operation))
        if key not in made:
            operation = _at_mean_temperature(window, operation)
            made[key] = corrected_model(session.robot, session.known, (), explained.theta(fold), operation)
        return made[key]

    residuals = session.in_judged_band(
        residual_after(problem, held_out_torque(problem, explained.terms, explained.found))
    )
    # A fit also explains a part of the noise: its residual is scaled up to the noise floor.
    size = np.maximum(explained.floor / np.maximum(residual_sums(problem, residuals).rms(), 1e-300), 1.0)
    usable = problem.columns.usable
    noise = tuple(size * _at_all_times(*of_log) for of_log in zip(session.logs, residuals, usable, strict=True))
    shots = _shots(explained, horizon, STEP, 0)
    folds = tuple(sorted({int(fold) for fold in problem.grams.fold} - {-1}))
    if not shots or len(folds) < 2 or has_hidden_states(model(shots[0].window, shots[0].window.fold)):
        return {}
    try:
        ratios = motion_deviations(shots, model, torque, noise, folds, horizon, _shares_at_rest(session.logs, shots))
    except (PhantomDynError, np.linalg.LinAlgError):
        return {}
    return {joint: float(x) for joint, x in zip(session.robot.joint_names, ratios, strict=True) if x > 1.0}


def _shares_at_rest(logs: tuple[Log, ...], shots: tuple[Shot, ...]) -> tuple[Float[Array, " nv"], ...]:
    """For each window, the share of its samples in which each joint is at rest."""
    still = {k: standing_still(logs[k]) for k in {shot.window.log for shot in shots}}
    return tuple(still[shot.window.log][shot.window.start : shot.window.stop].mean(axis=0) for shot in shots)


def _at_all_times(log: Log, residual: Float[Array, "n nv"], usable: Bool[Array, "n nv"]) -> Float[Array, "N nv"]:
    """Residual of all joints at the full rate, with that of usable samples in place of all others."""
    columns = [_without_gaps(own, use) for own, use in zip(residual.T, usable.T, strict=True)]
    return np.column_stack([np.interp(log.motion.t, log.motion.t[log.samples], own) for own in columns])


def _without_gaps(noise: Float[Array, " n"], use: Bool[Array, " n"]) -> Float[Array, " n"]:
    """Noise at all samples: unused samples, such as those at standstill, get the noise of used samples."""
    out = np.where(use, noise, 0.0)
    if use.any():
        out[~use] = np.resize(noise[use], np.count_nonzero(~use))
    return out


def _torques() -> Callable[[Shot, Model], Float[Array, "N nv"]]:
    """Function that returns the torque of drives and measured forces over a window's recording; results are cached."""
    computed: dict[tuple[Model, int], Array] = {}

    def torque(shot: Shot, model: Model) -> Float[Array, "N nv"]:
        key = (model, shot.window.log)
        if key not in computed:
            computed[key] = acting_torque(model, shot.log)
        return computed[key]

    return torque


def _controlled_rollout(explained: Explained, at_start: HiddenStates) -> Rollout | None:
    """Rollout under the controllers and references of the judged recordings; None if one of these is unknown."""
    problem = explained.problem
    judged = {problem.blocks[k].log for k in judged_blocks(problem)}
    operations = problem.columns.operations
    if any(explained.session.logs[k].q_ref is None or not controlled(operations[k].robot) for k in judged):
        return None
    return _longest_rollout(explained, under_control, _CONTROLLED, at_start, by_control=True)


def _loop_notes(loop: Rollout) -> tuple[Note, ...]:
    """Notes on a rollout of the closed loop: its errors, or why it was not simulated."""
    if loop.horizon_s is None:
        return loop.notes
    numbers = {"seconds": loop.horizon_s, "before": loop.rms_before, "after": loop.rms_after}
    return (Note(Code.CLOSED_LOOP, None, numbers),)


def _longest_rollout(
    explained: Explained, shoot: Shoot, horizons: tuple[float, ...], at_start: HiddenStates, *, by_control: bool
) -> Rollout:
    """Rollouts over the longest horizon at which no simulation diverges; a note says why if there is none."""
    problem: Exception = ParameterError("there is no stretch of valid samples long enough")
    for horizon in horizons:
        try:
            return _rollout_over(
                explained, shoot, tuple(h for h in horizons if h <= horizon), at_start, by_control=by_control
            )
        except RobotError as error:  # a shorter horizon would not help
            problem = error
            break
        except (PhantomDynError, np.linalg.LinAlgError) as error:
            problem = error
    if isinstance(problem, RunawayError):
        return Rollout(None, {}, {}, notes=(Note(Code.RUNS_AWAY, None, {"controlled": by_control, "t": problem.t}),))
    numbers = {"controlled": by_control, "problem": str(problem)}
    return Rollout(None, {}, {}, notes=(Note(Code.NOT_SIMULATED, None, numbers),))


def _rollout_over(
    explained: Explained, shoot: Shoot, horizons: tuple[float, ...], at_start: HiddenStates, *, by_control: bool
) -> Rollout:
    """Rollouts of the given and the corrected model over all horizons."""
    session, terms = explained.session, ordered(explained.terms)
    robot, known = session.robot, session.known
    operations = explained.problem.columns.operations
    typical = corrected_model(robot, known, terms, explained.found.theta, operations[0])
    step = min(STEP, typical.longest_step(operations[0].q[0]))
    if step < SHORTEST:
        raise RobotError(f"a transmission that was found is so stiff that steps of {step:.2g} s would be needed.")
    shots = _shots(explained, horizons[0], step, simulation_count(typical) if has_hidden_states(typical) else 0)
    if not shots:
        raise ParameterError("there is no stretch of valid samples long enough.")
    pairs: dict[tuple[int, int, int], tuple[Model, Model]] = {}

    def models(window: Window) -> tuple[Model, Model]:
        here = operations[window.log]
        key = (window.log, window.fold, _temperature_key(window, here))
        if key not in pairs:
            here, theta = _at_mean_temperature(window, here), explained.theta(window.fold)
            pairs[key] = (
                model_of(here.robot, at_work(known_causes(here.robot, known), here)),
                corrected_model(robot, known, terms, theta, here),
            )
        return pairs[key]

    return compare_models(robot, models, shots, shoot, horizons, at_start, controlled=by_control)


def _temperature_key(window: Window, operation: Operation) -> int:
    """Key by which models are stored: the start of the window if temperatures change along a recording, else 0."""
    return 0 if operation.temperature is None else window.start


def _at_mean_temperature(window: Window, operation: Operation) -> Operation:
    """The operation with its temperatures replaced by their mean over a window."""
    if operation.temperature is None:
        return operation
    mean = operation.temperature[window.start : window.stop].mean(axis=0)
    return replace(operation, temperature=np.broadcast_to(mean, operation.q.shape))


def _shots(explained: Explained, seconds: float, step: float, simulations: int) -> tuple[Shot, ...]:
    """Windows to simulate.

    Args:
        explained: Fits of the diagnosis.
        seconds: Length of a window [s].
        step: Integration step [s].
        simulations: Number of short simulations that each window needs for its hidden states. The larger this number,
            the fewer windows are returned.
    """
    problem, logs = explained.problem, explained.session.logs
    # Each sample needs at least one step.
    step = min(step, *(1.0 / log.band.rate_hz for log in logs))
    lead = lead_for_hidden_states(min(log.band.rate_hz for log in logs)) if simulations else LEAD
    windows = windows_in(logs, problem.blocks, problem.grams.fold, judged_blocks(problem), seconds=seconds, lead=lead)
    swings = [(w.stop - w.start - 1) / logs[w.log].band.rate_hz for w in windows if w.joints is not None]
    seconds = min(seconds, float(np.mean(swings))) if swings else seconds
    count = int(np.clip(_STEPS * step / (seconds * explained.session.robot.nv), _FEWEST, _MOST))
    count = min(count, max(_FEWEST, _HIDDEN_SIMULATIONS // simulations)) if simulations else count
    windows = spread(windows, count)
    states = {k: states_of(logs[k], explained.session.cutoff_hz) for k in {window.log for window in windows}}
    return tuple(Shot(logs[window.log], states[window.log], window) for window in windows)
