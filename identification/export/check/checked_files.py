"""Checks files before they are written, by the torque residual that each file has on the recordings.

A file is refused if its residual on any joint is larger than that of the given model, or clearly larger than the
diagnosis claims for the findings in the file. A note states the reason.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from identification.data.floating.base_errors import torque_of_base_errors
from identification.diagnosis.columns.motion.soft_friction import softness
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.replay import Replay
from identification.diagnosis.result import Diagnosis, FittedNumbers
from identification.diagnosis.written import WrittenFile
from identification.export.check.file_torques import (
    ALL_LAWS,
    FEEDFORWARD_FORMAT,
    ISAAC_FORMAT,
    MJCF_FORMAT,
    URDF_FORMAT,
    Format,
    LogTorque,
    contains_effect,
    torque_of_actuators,
    torque_of_feedforward,
    torque_of_mjcf,
    torque_of_model,
    torque_of_randomisation,
    torque_of_residual,
    torque_of_urdf,
    torque_of_yaml,
)
from identification.export.corrected.corrected_model import CorrectedModel, added_torque, corrected_model
from identification.export.corrected.corrected_urdf import with_rotors_of
from identification.export.corrected.found_effects import robot_within_tolerances
from identification.export.file_names import FEEDFORWARD, GOES_WITH, ISAAC, MJCF, RANDOMISATION, RESIDUAL, URDF, YAML
from identification.export.headers import with_header
from identification.notes import Code, Note
from identification.words.numbers_and_names import number
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.model.robot import Robot

_LEVEL = 0.05
"""Probability that a file that is as good as the given model is refused, over all joints together."""
_ROUNDING = 1e-6
"""Smaller relative differences of two residuals are rounding errors: laws in files compute in another order."""
_LARGEST_RATIO = 1.2
"""A file is refused if its residual exceeds this factor times the claimed residual plus one noise floor."""
_FORMATS = {URDF: URDF_FORMAT, MJCF: MJCF_FORMAT, FEEDFORWARD: FEEDFORWARD_FORMAT, ISAAC: ISAAC_FORMAT}
"""Numbers and laws that these files can contain; all other files can contain every law."""


@dataclass(frozen=True)
class RecordedTorques:
    """The recordings on which files are evaluated, and the residual of the given model.

    Attributes:
        replay: The recordings.
        robot: The given model.
        known: Effects that the given model already contains.
        fitted: Numbers of the fit, including those of the recording: delays of torque and references, softness of
            friction and errors of the base's sensors.
    """

    replay: Replay
    robot: Robot
    known: tuple[KnownEffect, ...]
    fitted: FittedNumbers

    @cached_property
    def given(self) -> tuple[Float[Array, "2 B nv"], dict[str, float]]:
        """The result of `residual_of` for the given model."""
        return self.residual_of(torque_of_model(self.replay, self.robot, self.known))

    def residual_of(self, torque_along: LogTorque) -> tuple[Float[Array, "2 B nv"], dict[str, float]]:
        """Squared residual of a modelled torque with the recording's fitted numbers, and rms residual without them.

        Args:
            torque_along: Function from the index of a log to the modelled torque.

        Returns:
            The result of `squares`, and the root mean square of each joint's residual.
        """
        cached_torque = cache(torque_along)
        squares, fitted = self.squares(cached_torque), self.fitted
        has_recording_numbers = fitted.timing or fitted.softness or fitted.arrivals or fitted.base
        residual = rms(self.replay.squares(cached_torque) if has_recording_numbers else squares)
        return squares, dict(zip(self.robot.joint_names, residual.tolist(), strict=True))

    @cached_property
    def _base_error_torques(self) -> tuple[Float[Array, "_ nv"], ...]:
        """Spurious torque of each log from errors of the base's sensors; empty for a robot with a fixed base."""
        base = self.fitted.base
        return tuple(torque_of_base_errors(self.replay.robot, log, base) for log in self.replay.logs) if base else ()

    def squares(self, torque_along: LogTorque) -> Float[Array, "2 B nv"]:
        """Sums of squares of the residual of a modelled torque, and numbers of samples, by block and joint.

        The fitted numbers of the recording (delays, softness of friction, errors of the base's sensors) are applied to
        the modelled torque first, because no file can state them.
        """
        fitted = self.fitted

        def torque_in_recording(log: int) -> Array:
            torque, one = torque_along(log), self.replay.logs[log]
            for joint, share in fitted.softness:
                torque = torque + share * softness(self.replay.robot, one.motion, joint)
            if fitted.arrivals:
                torque = torque - one.later_references(fitted.arrivals)
            if fitted.base:
                torque = torque + self._base_error_torques[log]
            return torque + fitted.timing * np.gradient(torque, axis=0) if fitted.timing else torque

        return self.replay.squares(torque_in_recording)


@dataclass(frozen=True)
class FileCheck:
    """Reference for the check of written files, for one diagnosis and one corrected model.

    Attributes:
        diagnosis: The diagnosis with its claims.
        measured: The recordings.
        corrected: The model from which the files are built.
        found: Effects that were found.
        config: The robot's ``robot.yaml``; None if there is none.
    """

    diagnosis: Diagnosis
    measured: RecordedTorques
    corrected: CorrectedModel
    found: tuple[KnownEffect, ...]
    config: Path | None

    @property
    def known(self) -> tuple[KnownEffect, ...]:
        """Effects that the given model already contains."""
        return self.measured.known

    @property
    def effects(self) -> tuple[KnownEffect, ...]:
        """All effects that are added to the given model."""
        return (*self.known, *self.found)

    @cached_property
    def estimate(self) -> Robot:
        """The given model with its changes within tolerance, or without them if a mass would be zero or negative.

        Bodies may be impossible.
        """
        try:
            return robot_within_tolerances(self.corrected.given, self.diagnosis.adjusted)
        except PhantomDynError:
            return self.corrected.given

    def record(self, file: str, text: str) -> WrittenFile:
        """The record of the check of one file, with its residuals.

        Args:
            file: Name of the file.
            text: Text of the file.
        """
        kind, replay, given = _FORMATS.get(file, ALL_LAWS), self.measured.replay, self.corrected.given
        contained = tuple(one for one in self.effects if contains_effect(kind, self.corrected, one))
        torques: dict[str, Callable[[], LogTorque]] = {
            YAML: lambda: torque_of_yaml(replay, text, given, self.known),
            URDF: lambda: torque_of_urdf(replay, text, self.corrected, self.config, contained),
            # The MJCF itself is not evaluated here: its torques were already compared with the model's in MuJoCo.
            MJCF: lambda: torque_of_mjcf(replay, self.corrected, contained),
            RANDOMISATION: lambda: torque_of_randomisation(replay, text, given, self.known),
            FEEDFORWARD: lambda: torque_of_feedforward(replay, text, given),
            ISAAC: lambda: torque_of_actuators(replay, text, self.corrected, contained),
            RESIDUAL: lambda: torque_of_residual(
                replay, text, torque_of_model(replay, self.corrected.base, self.effects), self.estimate
            ),
        }
        squares, residual = self.measured.residual_of(torques[file]())
        before, residual_before = self.measured.given
        if self.known and kind is not ALL_LAWS:
            before, residual_before = self.measured.residual_of(self._limited_torque(kind, given, self.known))
        lacking = [one for one in self.found if not contains_effect(kind, self.corrected, one)]
        # Effects that only add noise to readings do not lower a residual: they count as missing in every file.
        lacks = any(one in lacking or effect_named(one.effect, given).only_noise for one in self.found)
        return WrittenFile(
            file,
            residual,
            residual_before,
            tuple(_named(one) for one in self.found if one not in lacking),
            tuple(_named(one) for one in lacking),
            self._refusal(squares, before, lambda: self._claimed(kind, lacks or self._moves_rotors(kind))),
        )

    def _limited_torque(self, kind: Format, base: Robot, effects: tuple[KnownEffect, ...]) -> LogTorque:
        """Drive torque of a model with effects, as far as this kind of file can contain them."""
        contained = tuple(one for one in effects if contains_effect(kind, self.corrected, one))
        part = corrected_model(base, tuple(one for one in effects if one not in contained))
        further_torque = None if kind in (URDF_FORMAT, ISAAC_FORMAT) else (lambda motion: added_torque(part, motion))
        robot = part.robot if kind is not URDF_FORMAT else with_rotors_of(part.robot, self.corrected.given)
        return torque_of_model(self.measured.replay, robot, contained, further_torque)

    def _moves_rotors(self, kind: Format) -> bool:
        """True if rotor inertias were changed within tolerance and the format cannot state them."""
        changed = not np.array_equal(self.estimate.rotor_inertia, self.corrected.given.rotor_inertia)
        return kind is URDF_FORMAT and changed

    def _claimed(self, kind: Format, lacks: bool) -> Float[Array, " nv"]:
        """Residual of each joint that the diagnosis claims for the findings in a file [N m or N]."""
        whole = np.array([joint.rms_after for joint in self.diagnosis.joints])
        if not lacks:
            return whole
        try:
            part = rms(self.measured.squares(self._limited_torque(kind, self.estimate, self.effects)))
        except PhantomDynError:
            return whole
        return np.maximum(whole, part)

    def _refusal(self, squares: Array, before: Array, claimed: Callable[[], Array]) -> str:
        """Reason why a file is refused; empty if it passes.

        Args:
            squares: Squared residual of the file, from `RecordedTorques.squares`.
            before: Squared residual of the given model.
            claimed: Function that computes the claimed residual, which takes long and is not always needed.
        """
        residual, of_given = rms(squares), rms(before)
        joints = self.diagnosis.joints
        worse = has_larger_residual(squares, before)
        if worse.any():
            j = int(np.argmax(np.where(worse, residual / np.maximum(of_given, 1e-300), 0.0)))
            return (
                f"on {joints[j].joint} its residual is {number(residual[j])} {joints[j].unit}, and that of the given "
                f"model {number(of_given[j])} {joints[j].unit}"
            )
        floor = np.array([joint.noise_floor for joint in joints])
        wanted = claimed()
        over = residual > _LARGEST_RATIO * wanted + floor
        if over.any():
            j = int(np.argmax(np.where(over, residual / np.maximum(wanted, 1e-300), 0.0)))
            return (
                f"on {joints[j].joint} its residual is {number(residual[j])} {joints[j].unit}, and the diagnosis "
                f"claims {number(wanted[j])} {joints[j].unit} for the findings in it"
            )
        return ""


def rms(squares: Float[Array, "2 B nv"]) -> Float[Array, " nv"]:
    """Root mean square of each joint, from sums of squares and numbers of samples by block."""
    total = squares.sum(axis=1)
    return np.sqrt(total[0] / np.maximum(total[1], 1e-300))


def has_larger_residual(squares: Float[Array, "2 B nv"], before: Float[Array, "2 B nv"]) -> Bool[Array, " nv"]:
    """True for joints on which a model has a significantly larger residual than another one.

    Student's t test of the mean difference of squared residuals (a ratio of sums over blocks), at a level of 5 % over
    all joints together.

    Args:
        squares: Sums of squares of the model's residual, and numbers of samples, by block and joint.
        before: Sums of squares of the other model's residual, and numbers of samples, on the same samples.
    """
    from scipy.special import stdtrit  # imported here because it is slow, and only needed if files are checked

    counts = squares[1]
    blocks = len(counts)
    total = np.maximum(counts.sum(axis=0), 1e-300)
    mean = (squares[0] - before[0]).sum(axis=0) / total
    spread = squares[0] - before[0] - mean * counts
    deviation = np.sqrt(blocks / max(blocks - 1, 1) * (spread**2).sum(axis=0)) / total
    quantile = stdtrit(max(blocks - 1, 1), 1.0 - 0.5 * _LEVEL / counts.shape[1])
    return (mean > quantile * deviation) & (rms(squares) > (1.0 + _ROUNDING) * rms(before))


def _named(effect: KnownEffect) -> str:
    return effect.effect if effect.joint is None else f"{effect.effect} {effect.joint}"


def passed_files(
    texts: dict[str, str], check: FileCheck | None, *, mjcf_has_moved_joints: bool = False
) -> tuple[dict[str, str], tuple[WrittenFile, ...], tuple[Note, ...]]:
    """Texts of the files that passed their check, with their residuals in the header.

    Args:
        texts: Texts by file name.
        check: Reference for the check; None to let all files pass.
        mjcf_has_moved_joints: True if measured poses changed joint placements of the MJCF. Its residual is then not
            known.

    Returns:
        The texts, a record of each check, and a note on each file that is left out.
    """
    if check is None:
        return texts, tuple(WrittenFile(name, {}, {}) for name in texts if name not in GOES_WITH), ()
    passed, records, refused = dict(texts), [], []
    for name in (YAML, URDF, MJCF, RANDOMISATION, FEEDFORWARD, ISAAC, RESIDUAL):
        if name not in texts:
            continue
        try:
            record = check.record(name, texts[name])
        except PhantomDynError as error:
            # One file that cannot be evaluated must not prevent the other files and the report.
            record = WrittenFile(name, {}, {}, refused=str(error).rstrip("."))
        if name == MJCF and mjcf_has_moved_joints:
            record = replace(record, rms_left={}, rms_given={})
        records.append(record)
        if record.refused:
            del passed[name]
            refused.append(Note(Code.REFUSED, None, {"files": (name,), "problem": record.refused}))
        else:
            passed[name] = with_header(texts[name], record, check.diagnosis, check.measured.fitted)
    for name, other in GOES_WITH.items():
        if name in passed and other not in passed:
            del passed[name]
            refused.append(Note(Code.NOT_ALONE, None, {"files": (name,), "other": other}))
    return passed, tuple(records), tuple(refused)
