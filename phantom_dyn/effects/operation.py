"""What effects look at: motion, the drive torque of the model, and the drive torque of the recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import (
    inverse_dynamics,
    inverse_dynamics_derivatives,
    mass_matrix,
    modelled_friction,
    rotor_torque,
)
from phantom_dyn.effects.references import References
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion, read_only

# Cached quantities that neither a fit nor what it leaves changes.
_OF_THE_MOTION = ("own_friction", "transmitted", "inertia", "steepest")


@dataclass(frozen=True)
class Operation(Motion):
    """A motion with the torque that drives it.

    Attributes:
        robot: The given model, which the cached quantities below are of.
        tau: Drive torque that the model needs (modelled friction and armature included, and effects that are known),
            shape ``(N, nv)``. Signatures are made of it, not of the measured one, whose noise would bias a fit.
        expected: The same with the findings so far, shape ``(N, nv)``: what a late or saturated drive is asked for.
        logged: Drive torque of the recording, shape ``(N, nv)``; ``tau`` where there is none.
        residual_of_fit: Torque residual of the last fit of tolerances and findings, shape ``(N, nv)``; None before the
            first fit.
        recording: Which of several recordings it is of, for effects that act in some of them only.
        band_hz: Edge [Hz] of the band in which torques are judged.
        found_load: What the findings so far add to `load`, shape ``(N, nv)``; None: nothing.
        temperature: Of the drives [deg C], shape ``(N, nv)``, NaN for joints without; None where no joint has one.
        per_load: Drive torque per torque on the link, ``(N, nv)``: one, and what known friction under load adds; None:
            one.
        references: What controllers ask for, where the torque was computed from references; None where it was not.
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
    references: References | None = None
    per_load: Float[Array, "N nv"] | None = None

    def __post_init__(self):
        super().__post_init__()
        for name in ("tau", "expected", "logged"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("residual_of_fit", "temperature", "found_load", "per_load"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, read_only(getattr(self, name)))

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

    def again(
        self,
        expected: Float[Array, "N nv"],
        residual_of_fit: Float[Array, "N nv"] | None = None,
        found_load: Float[Array, "N nv"] | None = None,
    ) -> Operation:
        """The same motion after another fit; what was computed of motion and model is kept, but for `partials`.

        So is what was found of the load, where nothing else is given.
        """
        found_load = self.found_load if found_load is None else found_load
        out = replace(self, expected=expected, residual_of_fit=residual_of_fit, found_load=found_load)
        out.__dict__.update({name: self.__dict__[name] for name in _OF_THE_MOTION if name in self.__dict__})
        out.__dict__["kept"] = self.kept
        return out

    def for_a_while(self) -> Operation:
        """A copy for a short use: its `partials` and what effects keep in it are freed with it.

        Those of all recordings together would be the largest part of the memory.
        """
        out = self.again(self.expected, self.residual_of_fit)
        out.__dict__["kept"] = dict(self.kept)
        return out

    def made_of(self, parts: Sequence[Operation]) -> Operation:
        """The same, with what is known of the parts of its motion; parts of another robot tell nothing of it."""
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
        """Torque residual of the last fit, or of the given model before any fit; periodicities are looked for in it."""
        return self.logged - self.tau if self.residual_of_fit is None else self.residual_of_fit

    @cached_property
    def expected_rate(self) -> Float[Array, "N nv"]:
        """Rate of the expected torque [N m/s or N/s], from the samples next to each."""
        return np.gradient(self.expected, self.t, axis=0)

    @cached_property
    def own_friction(self) -> Float[Array, "N nv"]:
        """Modelled friction as part of the drive torque."""
        return modelled_friction(self.robot, self)

    @cached_property
    def transmitted(self) -> Float[Array, "N nv"]:
        """Torque that the transmissions pass to the links: drive torque less the rotors' share."""
        return self.tau - rotor_torque(self.robot, self)

    @property
    def load(self) -> Float[Array, "N nv"]:
        """Torque that the transmissions pass to the links, with the findings so far."""
        return self.transmitted if self.found_load is None else self.transmitted + self.found_load

    @cached_property
    def partials(self) -> tuple[Float[Array, "N nv nv"], Float[Array, "N nv nv"], Float[Array, "N nv nv"]]:
        """Derivatives of the rigid-body torque to positions, velocities and accelerations (armature included).

        Of a long motion they are larger than all else, and soon computed: no other operation takes them over.
        """
        to_q, to_v = inverse_dynamics_derivatives(self.robot, self)
        return _by_entry(to_q), _by_entry(to_v), _by_entry(mass_matrix(self.robot, self.q))

    @cached_property
    def inertia(self) -> Float[Array, "N nv"]:
        """Inertia that each joint moves while the others hold still, armature included."""
        mass = self.partials[2] if "partials" in self.__dict__ else mass_matrix(self.robot, self.q)
        return mass.diagonal(axis1=1, axis2=2).copy()

    @cached_property
    def steepest(self) -> Float[Array, " nv"]:
        """For each joint the most that the torque of any joint changes per unit of its position."""
        known = "partials" in self.__dict__
        to_q = self.partials[0] if known else inverse_dynamics_derivatives(self.robot, self)[0]
        return np.abs(to_q).max(axis=(0, 1))

    @cached_property
    def kept(self) -> dict[tuple, Array]:
        """What effects make of it once for all their shapes, by a name and a row."""
        return {}


def joined(parts: Sequence[Float[Array, "_ nv"]]) -> Float[Array, "N nv"]:
    """Series one after the other, not to be written to: nobody needs a copy of their own."""
    out = np.concatenate(parts)
    out.flags.writeable = False
    return out


def _by_entry(values: Float[Array, "N nv nv"]) -> Float[Array, "N nv nv"]:
    """The same with each entry's series in one piece of memory, those of one joint's motion side by side."""
    return np.ascontiguousarray(values.transpose(2, 1, 0)).transpose(2, 1, 0)
