"""Parameters of a cheap axis of a haptic device, and of the good device on which the cheap one is simulated.

The defects of a cheap axis are a virtual mass, play, friction, cogging and a force limit. The probe is the part of the
good device that the hand holds; the virtual mass is coupled to it.

The numbers are those of Table 2 of Brouwer and MacLean, Simulating Cheap Hardware. The paper says that its simulation
was stable with all defects together. The printed table swaps the columns for friction (millirad for a translation,
micrometres for a rotation); here each number belongs to the axis that has its unit. The table does not give the
friction in slip, the period of the cogging, the level of clipping or the unit of the damping. The first three are
arguments here. The damping is critical, which the text calls ideal: 7.75 N s/m at 0.1 kg and 150 N/m. The printed
damping is 0.05, which is possible in no unit: in N s/m the damping ratio would be 0.006, in N s/mm 6.5. The rotary
inertia is printed as "1 mkgmm" and taken as 1e-3 kg m^2: with 1 N m/rad its period is 0.20 s, similar to that of the
translation, 0.16 s.

The good device is the Laparoscopic Surgical Workstation of Immersion (Table 1 of the same paper), with travel, encoder
and motor of each axis. The twist of the tip has an encoder and no motor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from phantom_dyn.errors import ParameterError
from phantom_dyn.number_checks import require_not_negative, require_positive

CUTOFF_HZ = 70.0
"""Cut-off of the filter of the probe's velocity, as published [Hz]."""


@dataclass(frozen=True)
class VirtualMass:
    """Virtual inertia that the hand feels through a spring and a damper, the coupling.

    Attributes:
        inertia: Mass or moment of inertia [kg or kg m^2].
        stiffness: Stiffness of the coupling [N/m or N m/rad].
        damping: Damping of the coupling [N s/m or N m s/rad]; critical by default.
    """

    inertia: float
    stiffness: float
    damping: float | None = None

    def __post_init__(self):
        require_positive("a VirtualMass", inertia=self.inertia, stiffness=self.stiffness)
        if self.damping is None:
            object.__setattr__(self, "damping", 2.0 * float(np.sqrt(self.inertia * self.stiffness)))
        require_not_negative("a VirtualMass", damping=self.damping or 0.0)

    @property
    def period(self) -> float:
        """Period of the undamped mass on its coupling [s]."""
        return 2.0 * float(np.pi) * float(np.sqrt(self.inertia / self.stiffness))


@dataclass(frozen=True)
class StickingFriction:
    """Friction that sticks, by the law of the effect ``presliding_friction`` with its stick velocity.

    Attributes:
        torque: Friction in slip [N or N m].
        displacement: Displacement at which the axis breaks loose [m or rad].
        stick_velocity: Speed below which the axis sticks [m/s or rad/s].
        static_ratio: Friction at which the axis breaks loose, over friction in slip.
    """

    torque: float
    displacement: float
    stick_velocity: float
    static_ratio: float = 1.05

    def __post_init__(self):
        require_not_negative("a StickingFriction", torque=self.torque, stick_velocity=self.stick_velocity)
        require_positive("a StickingFriction", displacement=self.displacement)
        if not (np.isfinite(self.static_ratio) and self.static_ratio >= 1):
            raise ParameterError(
                f"The static_ratio of a StickingFriction is {self.static_ratio:g}: give 1 or more, as breaking loose "
                "takes at least what slipping does."
            )


@dataclass(frozen=True)
class CoggingTorque:
    """Sum of waves ``amplitude sin(order x + phase)``, as in the effect ``cogging``; all tuples have equal length.

    Attributes:
        order: Waves per revolution, or wave numbers [rad/m] on a translation.
        amplitude: Amplitudes [N or N m].
        phase: Phases [rad].
    """

    order: tuple[float, ...]
    amplitude: tuple[float, ...]
    phase: tuple[float, ...]

    def __post_init__(self):
        counts = {len(self.order), len(self.amplitude), len(self.phase)}
        if len(counts) != 1:
            raise ParameterError(
                f"A cogging torque has {len(self.order)} orders, {len(self.amplitude)} amplitudes and "
                f"{len(self.phase)} phases: give one of each a wave."
            )
        for name in ("order", "amplitude", "phase"):
            for value in getattr(self, name):
                if not np.isfinite(value):
                    raise ParameterError(f"The {name} of a cogging torque is {value:g}: give finite numbers.")


@dataclass(frozen=True)
class CheapAxis:
    """One axis of a cheap device; by default it has no defect.

    Attributes:
        mass: Inertia that the hand feels in addition to that of the good device.
        gap: Full width of the play between probe and mass [m or rad].
        friction: Friction that sticks.
        cogging: Torque that depends on the position.
        limit: Force at which the motor is clipped [N or N m].
        cutoff_hz: Cut-off of the filter of the probe's velocity [Hz]; infinite for no filter.
    """

    mass: VirtualMass | None = None
    gap: float = 0.0
    friction: StickingFriction | None = None
    cogging: CoggingTorque | None = None
    limit: float = np.inf
    cutoff_hz: float = CUTOFF_HZ

    def __post_init__(self):
        require_not_negative("a CheapAxis", gap=self.gap)
        if not self.limit >= 0:
            raise ParameterError(f"The limit of a cheap axis is {self.limit:g}: give 0 or more.")
        if not self.cutoff_hz > 0:
            raise ParameterError(f"The velocity's cut-off is {self.cutoff_hz:g} Hz: give more than 0.")
        if self.gap > 0 and self.mass is None:
            raise ParameterError(
                f"A cheap axis has a gap of {self.gap:g} and no mass: a play is between two masses, give one."
            )


def cheap_translation(*, slip: float, order: float, limit: float) -> CheapAxis:
    """The published translation with all defects.

    Mass 0.1 kg on a coupling of 150 N/m, play 1 mm, cogging 0.6 N. Friction breaks loose after 100 um, at 1.05 times
    the friction in slip, and sticks below 5 mm/s.

    Args:
        slip: Friction in slip [N].
        order: Wave number of the cogging [rad/m].
        limit: Largest force of the motor [N].
    """
    return CheapAxis(
        mass=VirtualMass(0.1, 150.0),
        gap=1e-3,
        friction=StickingFriction(slip, 100e-6, 5e-3),
        cogging=CoggingTorque((order,), (0.6,), (0.0,)),
        limit=limit,
    )


def cheap_rotation(*, slip: float, order: float, limit: float) -> CheapAxis:
    """The published rotation with all defects.

    Inertia 1e-3 kg m^2 on a coupling of 1 N m/rad, play 2 deg, cogging 0.04 N m. Friction breaks loose after 5 mrad, at
    1.05 times the friction in slip, and sticks below 6 deg/s. The 5 mrad are those of the table; the text has 0.2 deg
    (3.5 mrad).

    Args:
        slip: Friction in slip [N m].
        order: Order of the cogging, cycles per revolution.
        limit: Largest torque of the motor [N m].
    """
    return CheapAxis(
        mass=VirtualMass(1e-3, 1.0),
        gap=float(np.deg2rad(2.0)),
        friction=StickingFriction(slip, 5e-3, float(np.deg2rad(6.0))),
        cogging=CoggingTorque((order,), (0.04,), (0.0,)),
        limit=limit,
    )


@dataclass(frozen=True)
class WorkstationAxis:
    """One axis of the good device, in SI units; radians and newton metres if it turns.

    Attributes:
        travel: Range [m or rad]; infinite for an axis that turns without a stop.
        continuous: Force or torque that the motor can hold continuously [N or N m]; 0 without a motor.
        peak: Force or torque that the motor can hold for a short time [N or N m].
        resolution: Step of its encoder [m or rad].
        turns: True if it is rotary.
    """

    travel: float
    continuous: float
    peak: float
    resolution: float
    turns: bool = True

    @property
    def motor(self) -> CheapAxis:
        """An axis without defects whose force is clipped at the continuous force of the motor."""
        return CheapAxis(limit=self.continuous)


def _turning(travel: float, continuous: float, peak: float, resolution: float) -> WorkstationAxis:
    """A rotary axis with travel and resolution given in degrees."""
    return WorkstationAxis(math.radians(travel), continuous, peak, math.radians(resolution))


WORKSTATION: Mapping[str, WorkstationAxis] = MappingProxyType(
    {
        "insertion": WorkstationAxis(0.170, 11.0, 19.0, 0.008e-3, turns=False),
        "pitch": _turning(100.0, 0.47, 0.85, 0.01),
        "yaw": _turning(100.0, 0.47, 0.85, 0.01),
        "handle twist": _turning(180.0, 0.04, 0.07, 0.03),
        "tip twist": _turning(math.inf, 0.0, 0.0, 0.7),
        "handle grip": _turning(20.0, 0.15, 0.32, 0.04),
    }
)
"""Axes of the Laparoscopic Surgical Workstation, Table 1."""
