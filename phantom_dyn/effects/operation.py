"""What effects compute their torques from: motion, modelled and recorded drive torque, references of controllers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.dynamics.dynamics import (
    inverse_dynamics,
    inverse_dynamics_derivatives,
    mass_matrix,
    modelled_friction,
    rotor_torque,
)
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.recursive import low_passed

# Number of poles of the low pass on a load, which is applied forwards and backwards.
_POLES = 4


@dataclass(frozen=True)
class References(ReadOnlyArrays):
    """References of position controllers and the torques that they command.

    From them follows the torque that the drive would have given had the references arrived later. The measured motion
    stays as it was, so the commanded torque changes by the gain times the change of the reference, and the drive's
    limits clip it.

    Attributes:
        t: Times [s], increasing, shape ``(N,)``.
        q_ref: References as they were sent [rad or m], shape ``(N, nv)``.
        commanded: Torque that each controller commands, before any limit [N m or N], shape ``(N, nv)``.
        gain: Torque per unit of the reference [N m/rad or N/m], zero for joints without a controller, shape ``(nv,)``.
        limits: Torque at which the drives clip the command, infinite if they do not, shape ``(nv,)``.
        least: Smallest delay of each reference [s] that the recorded output of the drives allows, shape ``(nv,)``.
        most: Largest delay that this output allows [s], infinite if no output was recorded, shape ``(nv,)``.
    """

    t: Float[Array, " N"]
    q_ref: Float[Array, "N nv"]
    commanded: Float[Array, "N nv"]
    gain: Float[Array, " nv"]
    limits: Float[Array, " nv"]
    least: Float[Array, " nv"]
    most: Float[Array, " nv"]

    def later(self, delay: float, rows: tuple[int, ...]) -> Float[Array, "N m"]:
        """Change of the drive torque if references arrive ``delay`` seconds later.

        The first reference applies before the start.

        Args:
            delay: Additional delay [s].
            rows: Indices of the joints.
        """
        late = self.q_ref.copy()
        for row in rows:
            late[:, row] = np.interp(self.t - delay, self.t, self.q_ref[:, row])
        return self.with_references(late)[:, list(rows)]

    def with_references(self, q_ref: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
        """Change of the drive torque with other references [rad or m]."""
        changed = self.commanded + self.gain * (q_ref - self.q_ref)
        return np.clip(changed, -self.limits, self.limits) - np.clip(self.commanded, -self.limits, self.limits)


# Names of cached properties that depend on motion and model only, not on a fit.
_OF_THE_MOTION = ("own_friction", "transmitted", "inertia", "steepest")


@dataclass(frozen=True)
class Operation(Motion):
    """A motion with its modelled and its recorded drive torque; the input from which effects compute their columns.

    Attributes:
        robot: The given model, from which the cached quantities below are computed.
        tau: Drive torque that the model needs for the motion, with modelled friction, armature and known effects,
            shape ``(N, nv)``. Signatures use it instead of the measured torque, whose noise would bias a fit.
        expected: ``tau`` with the findings so far, shape ``(N, nv)``.
        logged: Drive torque of the recording, shape ``(N, nv)``; ``tau`` if there is none.
        residual_of_fit: Torque residual of the last fit of model tolerances and findings, shape ``(N, nv)``; None
            before the first fit.
        recording: Index of the recording, for effects that act in some recordings only.
        band_hz: Upper edge of the band in which torques are judged [Hz].
        found_load: Part of `load` from the findings so far, shape ``(N, nv)``; None for zero.
        known_in_drive: Part of ``tau`` due to known friction and known faults of the drive, which the transmission does
            not pass to the link, shape ``(N, nv)``; None for zero.
        temperature: Temperature of the drives [deg C], shape ``(N, nv)``, NaN where none was recorded; None if none was
            recorded for any joint.
        per_load: Derivative of the drive torque by the torque on the link: one plus the friction that a known effect
            adds per unit of load, shape ``(N, nv)``; None for one.
        references: References and commands if the torque was computed from references; otherwise None.
    """

    robot: Robot = field(repr=False)
    tau: Float[Array, "N nv"]
    expected: Float[Array, "N nv"]
    logged: Float[Array, "N nv"]
    residual_of_fit: Float[Array, "N nv"] | None = None
    recording: int = 0
    band_hz: float = np.inf
    temperature: Float[Array, "N nv"] | None = None
    found_load: Float[Array, "N nv"] | None = None
    known_in_drive: Float[Array, "N nv"] | None = None
    references: References | None = None
    per_load: Float[Array, "N nv"] | None = None

    @classmethod
    def of(
        cls,
        robot: Robot,
        motion: Motion,
        logged: Float[Array, "N nv"] | None = None,
        temperature: Float[Array, "N nv"] | None = None,
    ) -> Operation:
        """``motion`` with the torque of the given model, and the recorded torque and temperature if they are given."""
        tau = inverse_dynamics(robot, motion)
        state = (motion.t, motion.q, motion.v, motion.a)
        plain = cls(*state, robot, tau, tau, tau if logged is None else logged, base=motion.base)
        return plain if temperature is None else replace(plain, temperature=temperature)

    def after_fit(
        self,
        expected: Float[Array, "N nv"],
        residual_of_fit: Float[Array, "N nv"] | None = None,
        found_load: Float[Array, "N nv"] | None = None,
    ) -> Operation:
        """The same motion after another fit. Cached quantities of the motion are copied, except the large `partials`.

        Args:
            expected: ``tau`` with the findings of this fit, shape ``(N, nv)``.
            residual_of_fit: Torque residual of this fit, shape ``(N, nv)``.
            found_load: Part of `load` from the findings of this fit, shape ``(N, nv)``; None keeps the present one.
        """
        found_load = self.found_load if found_load is None else found_load
        out = replace(self, expected=expected, residual_of_fit=residual_of_fit, found_load=found_load)
        out.__dict__.update({name: self.__dict__[name] for name in _OF_THE_MOTION if name in self.__dict__})
        out.__dict__["kept"] = self.kept
        return out

    def short_lived_copy(self) -> Operation:
        """A copy for a short use, whose `partials` and stored arrays of effects are freed together with it.

        If the operations of all recordings kept these arrays, they would need too much memory.
        """
        out = self.after_fit(self.expected, self.residual_of_fit)
        out.__dict__["kept"] = dict(self.kept)
        return out

    def made_of(self, parts: Sequence[Operation]) -> Operation:
        """This operation, with cached quantities joined from those of its parts, if their robot is the same.

        Args:
            parts: Operations whose motions, one after the other, are this motion.
        """
        if any(part.robot is not self.robot for part in parts):
            return self
        out = replace(self)
        for name in ("own_friction", "transmitted", "inertia"):
            out.__dict__[name] = joined([getattr(part, name) for part in parts])
        out.__dict__["steepest"] = np.max([part.steepest for part in parts], axis=0)
        return out

    @property
    def dt(self) -> float:
        """Mean time step [s]."""
        return float((self.t[-1] - self.t[0]) / max(len(self.t) - 1, 1))

    @property
    def residual(self) -> Float[Array, "N nv"]:
        """Torque residual of the last fit, or of the given model before any fit."""
        return self.logged - self.tau if self.residual_of_fit is None else self.residual_of_fit

    @cached_property
    def expected_rate(self) -> Float[Array, "N nv"]:
        """Time derivative of the expected torque [N m/s or N/s], from neighbouring samples; zero for one sample."""
        return np.gradient(self.expected, self.t, axis=0) if len(self.t) > 1 else np.zeros_like(self.expected)

    @cached_property
    def own_friction(self) -> Float[Array, "N nv"]:
        """Modelled friction as part of the drive torque."""
        return modelled_friction(self.robot, self)

    @cached_property
    def transmitted(self) -> Float[Array, "N nv"]:
        """Torque that transmissions pass to links: drive torque minus that for rotors, friction and drive faults."""
        passed = self.tau - rotor_torque(self.robot, self) - self.own_friction
        return passed if self.known_in_drive is None else passed - self.known_in_drive

    @property
    def load(self) -> Float[Array, "N nv"]:
        """Torque that the transmissions pass to the links, with the findings so far."""
        return self.transmitted if self.found_load is None else self.transmitted + self.found_load

    @cached_property
    def partials(self) -> tuple[Float[Array, "N nv nv"], Float[Array, "N nv nv"], Float[Array, "N nv nv"]]:
        """Derivatives of the rigid-body torque by positions, velocities and accelerations, with armature.

        They are large and quick to compute, so that `after_fit` does not copy them.
        """
        to_q, to_v = inverse_dynamics_derivatives(self.robot, self)
        return _by_entry(to_q), _by_entry(to_v), _by_entry(mass_matrix(self.robot, self.q))

    @cached_property
    def inertia(self) -> Float[Array, "N nv"]:
        """Inertia that each joint moves while the others are at rest, with armature."""
        mass = self.partials[2] if "partials" in self.__dict__ else mass_matrix(self.robot, self.q)
        return mass.diagonal(axis1=1, axis2=2).copy()

    @cached_property
    def steepest(self) -> Float[Array, " nv"]:
        """For each joint, the largest change of any joint's torque per unit of this joint's position."""
        known = "partials" in self.__dict__
        to_q = self.partials[0] if known else inverse_dynamics_derivatives(self.robot, self)[0]
        return np.abs(to_q).max(axis=(0, 1))

    @cached_property
    def kept(self) -> dict[tuple, Array]:
        """Arrays that effects compute once and use for all their shapes, by name and joint index."""
        return {}


def joined(parts: Sequence[Float[Array, "_ nv"]]) -> Float[Array, "N nv"]:
    """Parts of a series joined, read-only."""
    out = np.concatenate(parts)
    out.flags.writeable = False
    return out


def _by_entry(values: Float[Array, "N nv nv"]) -> Float[Array, "N nv nv"]:
    """The same array, stored so that all samples of one matrix entry are contiguous in memory."""
    return np.ascontiguousarray(values.transpose(2, 1, 0)).transpose(2, 1, 0)


def up_to_band(operation: Operation, load: Float[Array, " N"]) -> Float[Array, " N"]:
    """A load, low-passed at the edge of the judged band, above which accelerations are noisy.

    Effects filter only the load, and not its product with ``sign(v)``, so that the steps of the sign stay sharp.

    Args:
        operation: Operation with the band and the time step.
        load: Torque that the transmission of a joint passes to its link [N m or N].
    """
    if not 0.0 < operation.band_hz * operation.dt < 0.5:
        return load
    return low_passed(load, operation.band_hz, 1.0 / operation.dt, order=_POLES)
