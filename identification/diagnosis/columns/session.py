"""Data of one diagnosis: a robot, its recordings in a common band, and the blocks that each fit may use.

All logs are filtered to one frequency band, in which effects are fitted. The judged band is the lower part of that
band. In it, the residual is judged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identification.data.changes import Change
from identification.data.drives.arrivals import with_unknown_arrivals
from identification.data.floating.swings import require_swings
from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.signals import narrowed, process_all, within_limits
from identification.data.unknown_drives import with_model_torque
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.blocks import split_blocks
from identification.diagnosis.columns.motion.brakes import with_brakes
from identification.diagnosis.columns.motion.one_sine import in_one_sine, moving
from identification.diagnosis.columns.motion.soft_friction import with_shown_friction
from identification.diagnosis.columns.one_recording_effects import NO_DIFFERENCES, Differences, differences_of
from identification.diagnosis.columns.operations import operation_of, with_known_payloads
from identification.diagnosis.columns.structure import STRUCTURES
from identification.diagnosis.columns.terms import KnownEffect
from identification.engine.products.blocks import Block, assign_folds
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import EffectError, LogError
from phantom_dyn.model.robot import Robot

# A series of every log, ``(n, nv)`` each; logs differ in length.
Series = tuple[Float[Array, "_ nv"], ...]


@dataclass(frozen=True)
class Session:
    """Robot, recordings and blocks of a diagnosis; they do not change while it runs.

    Attributes:
        robot: The given model.
        logs: Recordings ready for fitting; recordings that are held out of all fits come last.
        cutoff_hz: Edge of the judged band, common to all logs.
        blocks: Stretches of samples that are held out together.
        folds: Fold of each block, -1 for blocks of held-out recordings, ``(B,)``.
        known: Effects that belong to the given model already.
        differences: Known differences between the recordings.
        recordings: Raw recordings of the logs; empty if the session was made from logs.
    """

    robot: Robot
    logs: tuple[Log, ...]
    cutoff_hz: float
    blocks: tuple[Block, ...]
    folds: Int[Array, " B"]
    known: tuple[KnownEffect, ...] = ()
    differences: Differences = NO_DIFFERENCES
    recordings: tuple[Recording, ...] = ()

    @property
    def fitted_logs(self) -> tuple[Log, ...]:
        """Logs that fits may see."""
        seen = {block.log for block, fold in zip(self.blocks, self.folds, strict=True) if fold >= 0}
        return tuple(log for k, log in enumerate(self.logs) if k in seen)

    @cached_property
    def largest_torque(self) -> Float[Array, " nv"]:
        """Largest torque of each joint in all logs; zero if no torque is known."""
        return np.max([_largest(log.tau) for log in self.logs], axis=0)

    @cached_property
    def largest_speed(self) -> Float[Array, " nv"]:
        """Largest speed of each joint in samples that fits may use.

        Filters of the recorder may make positions jump at the ends of a log, which is no motion of the joint.
        """
        return np.max([_largest(log.motion.v[log.samples][log.valid_in_band]) for log in self.logs], axis=0)

    @cached_property
    def in_one_sine(self) -> frozenset[int]:
        """Joints that move at one frequency alone in every recording in which they move, by their indices."""
        return in_one_sine(self.logs, moving(self.logs))

    def in_judged_band(self, series: Series) -> Series:
        """In-band series of each log, low-passed to the judged band; the length does not change."""
        return tuple(self.log_in_judged_band(part, k) for k, part in enumerate(series))

    def log_in_judged_band(self, series: Float[Array, "n ..."], log: int) -> Float[Array, "n ..."]:
        """Series of one log, low-passed to the judged band."""
        return self.log_below(series, log, self.cutoff_hz)

    def log_below(self, series: Float[Array, "n ..."], log: int, edge_hz: float) -> Float[Array, "n ..."]:
        """In-band series of one log, low-passed to a frequency; the same object if its band ends there."""
        return narrowed(series, self.logs[log].valid_in_band, self.logs[log].band, edge_hz)


def _largest(series: Float[Array, "N nv"]) -> Float[Array, " nv"]:
    """Largest magnitude of each column; zero if all its values are NaN."""
    return np.nanmax(np.abs(series), axis=0, initial=0.0)


def session_of_logs(
    robot: Robot,
    logs: tuple[Log, ...],
    cutoff_hz: float,
    *,
    held_out: int = 0,
    known: tuple[KnownEffect, ...] = (),
    differences: Differences = NO_DIFFERENCES,
) -> Session:
    """A session of logs that are ready for fitting; no fit sees the last ``held_out`` of them."""
    blocks = split_blocks(logs, cutoff_hz)
    folds = assign_folds(blocks, np.arange(len(logs)) >= len(logs) - held_out)
    return Session(robot, logs, cutoff_hz, blocks, folds, known, differences)


def session_of(
    robot: Robot,
    recordings: tuple[Recording, ...],
    hold_out: tuple[Recording, ...] = (),
    *,
    known: tuple[KnownEffect, ...] = (),
    changes: tuple[Change, ...] = (),
    band_factor: float = 1.0,
) -> Session:
    """A session of recordings: filtered, in a common band, split into blocks and folds.

    Args:
        robot: The given model.
        recordings: Those that fits may see.
        hold_out: Recordings that no fit sees.
        known: Effects that belong to the given model already.
        changes: Known differences between the recordings, those held out at the end; empty if there are none.
        band_factor: Factor of the judged band's edge.

    Raises:
        LogError: If a recording cannot be used, or all together are too short to hold data back.
        EffectError: If a user's effect has the name of a structure of unknown cause.
    """
    _require_free_names(robot)
    robot = with_known_payloads(robot, known)
    every = (*recordings, *hold_out)
    differences = differences_of(changes, robot, len(recordings))
    logs, cutoff_hz = process_all(every, robot, band_factor)
    logs = tuple(replace(log, tau=within_limits(log.tau, robot)) for log in logs)
    logs = tuple(with_brakes(robot, with_model_torque(robot, log)) for log in logs)
    session = session_of_logs(robot, logs, cutoff_hz, held_out=len(hold_out), known=known, differences=differences)
    if np.sum(session.folds >= 0) < rules.LEAST_BLOCKS:
        seconds = sum(log.motion.t[-1] - log.motion.t[0] for log in logs)
        raise LogError(
            f"{recordings[0].file}: {seconds:.1f} s are too short to hold data back and judge on them: "
            "record at least ten seconds of motion."
        )
    _require_samples(session)
    require_swings(session.logs)
    return replace(session, robot=with_unknown_arrivals(_with_soft_friction(session), logs), recordings=every)


def _require_samples(session: Session) -> None:
    """Refuse recordings with too few blocks that contain samples outside gaps and excluded times."""
    blocks = [block for block, fold in zip(session.blocks, session.folds, strict=True) if fold >= 0]
    # A block counts if a sample of its core does not depend on a gap or an excluded time.
    if sum(session.logs[b.log].valid_in_band[b.core : b.stop].any() for b in blocks) >= rules.LEAST_BLOCKS:
        return
    edges = [np.flatnonzero(np.diff(np.concatenate([[False], log.valid, [False]]))) for log in session.logs]
    longest = [
        int(np.max(at[1::2] - at[::2], initial=0)) / log.band.rate_hz
        for at, log in zip(edges, session.logs, strict=True)
    ]
    log = session.logs[int(np.argmax(longest))]
    wanted = (2 * log.band.half + log.band.step) / log.band.rate_hz
    raise LogError(
        f"{log.file}: gaps in time and excluded stretches leave too few samples to hold data back and judge on them "
        f"(the longest stretch without lasts {max(longest):.2g} s, and the filter of the band needs {wanted:.2g} s of "
        "each): record at least ten seconds of motion without gaps."
    )


def _with_soft_friction(session: Session) -> Robot:
    """The robot with the soft friction of MuJoCo if the recordings show it, else without."""
    robot = session.robot
    if not any(robot.soft_friction):
        return robot
    operations = [operation_of(robot, log, session.known, k, session.cutoff_hz) for k, log in enumerate(session.logs)]
    recorded = [(o, log.tau - o.tau, log.band) for o, log in zip(operations, session.logs, strict=True)]
    return with_shown_friction(robot, recorded, _known_coulomb(robot, session.known))


def _known_coulomb(robot: Robot, known: tuple[KnownEffect, ...]) -> Float[Array, " nv"]:
    """Coulomb torque of each joint by known effects, in addition to the modelled friction."""
    out = np.zeros(robot.nv)
    for one in known:
        numbers = effect_named(one.effect, robot).model_numbers(robot, one.joint, np.array(one.theta))
        if one.joint in robot.joint_names and numbers is not None:
            out[robot.joint_names.index(one.joint)] += numbers.coulomb
    return out


def _require_free_names(robot: Robot) -> None:
    """Refuse effects of a user that have the name of a structure of unknown cause."""
    taken = {structure.name for structure in STRUCTURES}
    for effect in robot.user_effects:
        if effect.name in taken:
            raise EffectError(
                f"The effect {effect.name} has a name that a diagnosis uses for gaps of unknown cause "
                f"({', '.join(sorted(taken))}): give it another name."
            )
