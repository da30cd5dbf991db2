# pyright: reportAttributeAccessIssue=false
"""Computes the data of a replay: poses of the links of every copy of the robot, colours, and curves.

A simulation with the recorded torque diverges from any recording, as the position error grows with the square of time.
The simulation therefore starts again from the recorded state every few tenths of a second (multiple shooting, as in the
rollout of a diagnosis).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.refusal import fault_warnings, require_right
from identification.data.signals import process_all
from identification.data.unknown_drives import with_model_torque
from identification.diagnosis.columns.known_geometry import effects_on_torques, with_known_places
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import EffectAt
from identification.export.corrected.found_effects import robot_within_tolerances
from identification.rollout.compare import HORIZONS
from identification.rollout.rollout_starts import SHORTEST, STEP, States, Window, acting_torque, states_of, window_at
from identification.rollout.shots import Shot, controlled, has_hidden_states, under_control, under_torque
from identification.rollout.simulated_models import LEAD, Model, known_causes, model_of
from identification.stages import Announcement, Progress, Stage
from identification.viewing.corrections import Correction
from identification.viewing.torque_curves import TorqueCurves, full_colour, relative_residuals, torque_curves
from identification.words.diagnosis_words import joints_words, placed_effect
from identification.words.effect_words import is_between_joints, words_of
from identification.words.note_words import sentences
from identification.words.user_words import user_words
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.errors import ChainError, PhantomDynError
from phantom_dyn.model.robot import Robot

_FEWEST = 3
"""Smallest number of samples of a simulated section; a shorter last section is added to the section before it."""


@dataclass(frozen=True, eq=False)
class ReplayedMotion:
    """Simulated positions of models along one recording.

    Attributes:
        horizon_s: Length of each simulated section [s]; None if no model could be simulated.
        q: Positions [rad or m] of each model at every sample, ``(N, nv)``; NaN for samples that must not be used, and
            for a model that cannot be simulated.
        notes: Sentences on a shortened horizon, and on the reason why a model was not simulated.
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
    """Simulates each model over the longest horizon for which no model diverges.

    Args:
        log: The recording.
        states: Smoothed states of the recording.
        models: The simulated models, by name.
        horizons: Possible horizons [s], the longest first.
        controlled: True to simulate the controllers in the robot's file with recorded references; False to simulate
            with the recorded torque.
        progress: Called for each simulated section.
    """
    found: dict[str, tuple[float, Array]] = {}
    notes: list[str] = []
    for name, model in models.items():
        problem = ""
        for horizon in horizons:
            try:
                found[name] = horizon, _simulated(log, states, model, horizon, controlled, progress)
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
        notes.append(
            f"Simulated motion starts again from the recorded one every {least:g} s: over {horizons[0]:g} s it leaves "
            "all bounds."
        )
    # A model that was simulated over a longer horizon is simulated again, so that all have the same horizon.
    q = []
    for name, model in models.items():
        horizon, positions = found.get(name, (least, np.full(log.motion.q.shape, np.nan)))
        q.append(positions if horizon == least else _simulated(log, states, model, least, controlled, progress))
    return ReplayedMotion(least, tuple(q), tuple(notes))


def stretches(valid: Bool[Array, " N"], length: int) -> tuple[tuple[int, int], ...]:
    """First sample and end (exclusive) of the sections into which the valid samples are divided.

    Runs of less than `_FEWEST` valid samples are left out.

    Args:
        valid: False for samples that must not be used.
        length: Number of samples of a section. The last section before a gap may be shorter, or longer by
            `_FEWEST` - 1.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], valid, [False]]).astype(int)))
    out = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        firsts = list(range(start, stop, length))
        if len(firsts) > 1 and stop - firsts[-1] < _FEWEST:
            firsts.pop()
        out += [(a, b) for a, b in zip(firsts, [*firsts[1:], stop], strict=True) if b - a >= _FEWEST]
    return tuple(out)


def _simulated(
    log: Log, states: States, model: Model, horizon: float, controlled: bool, progress: Progress
) -> Float[Array, "N nv"]:
    """Simulated positions of one model; NaN for samples that are not simulated."""
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
        assert window is not None  # all samples of the window are valid
        out[start:stop] = _section(Shot(log, states, window), model, torque, min(step, STEP) if controlled else None)
    return out


def _section(shot: Shot, model: Model, torque: Float[Array, "N nv"], step: float | None) -> Float[Array, "n nv"]:
    """Simulated positions over one section; hidden states of the model start from the motion before the section.

    Args:
        shot: The section.
        model: The simulated model.
        torque: Torque of the model's drives [N m or N].
        step: Longest step of a simulation with controllers [s]; None to simulate with the recorded torque.
    """
    shot = shot.with_start_by_feedback(model, torque) if has_hidden_states(model) else shot
    return under_torque(shot, model, torque) if step is None else under_control(shot, model, max_step=step)


def _step_of_controllers(model: Model, q: Float[Array, " nv"]) -> float:
    """Longest step [s] for the damping of the controllers in the robot's file: half of the shortest decay time."""
    gains = [0.0 if a.controller is None else a.controller.kd for a in model.robot.actuators]
    rates = np.linalg.eigvals(np.linalg.solve(mass_matrix(model.robot, q[None])[0], np.diag(gains)))
    return 0.5 / max(float(np.abs(rates).max()), 1e-9)


FRAME_HZ = 50.0
"""Largest number of frames per second of the recording; the page shows fewer."""
MOST_FRAMES = 20_000
"""Largest number of frames of a replay; a long recording has fewer frames per second."""

MEASURED, GIVEN, CORRECTED = "measured", "given model", "corrected model"


@dataclass(frozen=True, eq=False)
class Copy:
    """One copy of the robot.

    Attributes:
        name: Source of the copy's motion: the recording or a model.
        q: Joint positions [rad or m], ``(n, nv)``; NaN for samples that were not simulated.
        poses: Poses of the joints' frames from `link_poses`, ``(n, J, 7)``.
        strength: Strength of each joint's colour, from 0 for no residual to 1 for the full colour, ``(n, nv)``.
    """

    name: str
    q: Float[Array, "n nv"]
    poses: Float[Array, "n J 7"]
    strength: Float[Array, "n nv"]


@dataclass(frozen=True, eq=False)
class Replay:
    """A recording and simulated motions, ready to be drawn.

    Attributes:
        robot: The given model.
        file: Name of the recording.
        t: Times of the frames [s], ``(n,)``.
        copies: Copies with the measured motion, the motion of the given model, and, with a correction, the motion of
            the corrected model.
        curves: Measured torque and torques of the models.
        full: Relative residual that is shown in full colour.
        horizon_s: Time after which the simulation starts again from the recorded motion [s]; None without simulation.
        corrections: Corrections of the model in words.
        notes: Sentences about the recording and the simulation.
    """

    robot: Robot
    file: str
    t: Float[Array, " n"]
    copies: tuple[Copy, ...]
    curves: TorqueCurves
    full: float
    horizon_s: float | None
    corrections: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def frame(self, time: float) -> int:
        """Index of the frame nearest to a time [s]."""
        after = int(np.clip(np.searchsorted(self.t, time), 1, len(self.t) - 1))
        return after if self.t[after] - time < time - self.t[after - 1] else after - 1

    def strongest_joint(self) -> int:
        """The joint with the largest mean relative residual of the given model."""
        return int(np.argmax(self.copies[1].strength.mean(axis=0)))


def replay_of(
    robot: Robot,
    recording: Recording,
    *,
    correction: Correction | None = None,
    known: tuple[KnownEffect, ...] = (),
    horizon_s: float | None = None,
    progress: Progress = lambda _: None,
) -> Replay:
    """Prepares the replay of one recording.

    Args:
        robot: The given model.
        recording: Recording with torques, either recorded or commanded by controllers.
        correction: Corrections of the model; None to simulate only the given model.
        known: Effects that the given model already contains.
        horizon_s: Time after which the simulation starts again from the recorded motion [s]; None to use that of the
            diagnosis.
        progress: Called at the start of each stage.

    Raises:
        LogError: If the recording cannot be used, or has a certain fault that the user did not overrule.
        RobotError: If a link of the corrected model would not have a positive mass.
    """
    require_right((recording,))
    robot, known = with_known_places(robot, known), effects_on_torques(known)
    progress(Announcement(Stage.FILTERING))
    (log,), cutoff_hz = process_all((recording,), robot)
    robots = [(robot, known)]
    if correction is not None:
        adjusted = with_known_places(robot_within_tolerances(robot, correction.adjusted), correction.effects)
        robots.append((adjusted, (*known, *effects_on_torques(correction.effects))))
    curves = torque_curves(log, cutoff_hz, tuple(robots))
    states = states_of(log, cutoff_hz)
    motion = replayed_motion(
        with_model_torque(robot, log),
        states,
        {
            name: model_of(one, known_causes(one, effects))
            for name, (one, effects) in zip((GIVEN, CORRECTED), robots, strict=False)
        },
        _horizons(horizon_s, correction),
        controlled=recording.controlled and controlled(robot),
        progress=progress,
    )
    progress(Announcement(Stage.LINKS))
    rows = frame_rows(log.motion.t)
    shares = relative_residuals(curves)
    full = full_colour(shares[0])
    no_residual = np.zeros((len(rows), robot.nv))
    colours = [no_residual, *(_at_frames(log.motion.t[rows], curves.t, share / full) for share in shares)]
    names = (MEASURED, GIVEN, CORRECTED)
    positions = (states.raw, *motion.q)
    copies = tuple(
        Copy(name, q[rows], link_poses(robot, q[rows]), colour)
        for name, q, colour in zip(names, positions, colours, strict=False)
    )
    return Replay(
        robot=robot,
        file=recording.file,
        t=np.array(log.motion.t[rows]),
        copies=copies,
        curves=curves,
        full=full,
        horizon_s=motion.horizon_s,
        corrections=_corrections(correction, robot),
        notes=(*fault_warnings((recording,)), *sentences(recording.remarks), *motion.notes),
    )


def frame_rows(t: Float[Array, " N"]) -> Array:
    """Indices of samples that are shown as frames: at equal steps, at most `FRAME_HZ` a second and `MOST_FRAMES`."""
    rate = (len(t) - 1) / (t[-1] - t[0])
    return np.arange(0, len(t), max(1, round(rate / FRAME_HZ), -(-len(t) // MOST_FRAMES)))


def _horizons(wanted: float | None, correction: Correction | None) -> tuple[float, ...]:
    """Horizons to choose from, the longest first."""
    stated = None if correction is None else correction.horizon_s
    first = wanted or stated or HORIZONS[0]
    return (first, *(horizon for horizon in HORIZONS if horizon < first))


def _at_frames(t: Float[Array, " n"], times: Float[Array, " m"], values: Float[Array, "m nv"]) -> Float[Array, "n nv"]:
    """Values interpolated from ``times`` to ``t`` and limited to 0 to 1; zero outside the range of ``times``."""
    columns = [np.interp(t, times, column, left=0.0, right=0.0) for column in values.T]
    return np.clip(np.column_stack(columns), 0.0, 1.0)


def _corrections(correction: Correction | None, robot: Robot) -> tuple[str, ...]:
    """Corrections of the model in words."""
    if correction is None:
        return ()
    places: dict[str, list[EffectAt]] = {}
    for one in correction.effects:
        at = EffectAt(one.effect, one.joint, words=user_words(one.effect, robot))
        places.setdefault(one.effect, []).append(at)
    words = [_named(every) for every in places.values()]
    if count := len(correction.adjusted):
        words.append(f"{count} changes within tolerance" if count > 1 else "1 change within tolerance")
    return tuple(words)


def _named(places: list[EffectAt]) -> str:
    """An effect with all its joints, such as ``Coulomb friction on joints j1 and j2``."""
    joints = [at.joint for at in places if at.joint is not None]
    if len(joints) < 2 or is_between_joints(places[0].effect):
        return ", ".join(map(placed_effect, places))
    return f"{words_of(places[0]).name} on {joints_words(joints)}"


def link_poses(robot: Robot, q: Float[Array, "n nv"]) -> Float[Array, "n J 7"]:
    """Pose of each joint's frame in the root frame: x, y, z [m], then the unit quaternion w, x, y, z.

    Poses are NaN if a position is NaN, or if the loops of a closed chain have no solution at the positions.

    Args:
        robot: The robot; the joints are those of Pinocchio's model, beginning with the root.
        q: Positions of the driven joints [rad or m].
    """
    model = robot.model
    data = model.createData()
    out = np.full((len(q), model.njoints, 7), np.nan)
    for row in np.flatnonzero(np.isfinite(q).all(axis=1)):
        try:
            pin.forwardKinematics(model, data, robot.configuration(q[row : row + 1])[0])
        except ChainError:
            continue
        for joint, place in enumerate(data.oMi):
            x, y, z, qx, qy, qz, qw = pin.SE3ToXYZQUAT(place)
            out[row, joint] = x, y, z, qw, qx, qy, qz
    return out
