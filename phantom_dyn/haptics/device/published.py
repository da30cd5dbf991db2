r"""Published parameters of haptic devices: LHIfAM with two cables, PHANToM 1.0, PHANToM 1.5.

**LHIfAM and PHANToM 1.0** [Gil]_. Of Table 2 the available copy has only motor damping and cable stiffness. Motor and
body mass follow from total mass and resonance, (22), and the damping of the cable from the distance Q = 78.16 dB of the
peak, (23). The damping of the body is missing and assumed to be 3.4 N s/m. With any value from 3.14 to 7.71 N s/m the
new cable has one crossing and the original cable its low crossing, as printed. These numbers differ from the printed
ones:

======================================  ================  =============================================================
figure                                  printed           computed
======================================  ================  =============================================================
new cable, single crossing              411.23 rad/s      445.06 rad/s (87.74 dB); 411.23 needs :math:`m_r` = 0.3769 kg
                                                          (`LHIFAM_HEAVIER_MOTOR`), whose original cable resonates at
                                                          75.8 Hz, not at the printed 82 Hz
undelayed experiment, 250 us inherent   more than 7 dB    11.2 dB lower (76.56 dB, 32.8 rad/s), or 3.4 dB at the
                                        lower             vibration's crossing (84.37 dB, 416.9 rad/s)
PHANToM, "60 Hz in Cavusoglu et al."    its first axis    60 Hz is the y axis of [Cavusoglu]_; 90 Hz is the x axis
======================================  ================  =============================================================

**PHANToM 1.5** [Cavusoglu]_, fits of section 4.3, position over force. The source does not state their units, and there
are no units with which they agree with the dynamic model of the same source: their masses are 16.69, 15.96 and 8.78 g
(in N and mm), and those of the model 77.31, 52.49 and 32.25 g at the origin. The text mentions resonances that the fits
do not have: x at 90 Hz (the peak of the fit is at 104.5 Hz), and y at 30, 125 and 250 Hz. The fits are given as
transfer functions here, because the masses, spring and damper that `two_mass_of_fit` derives from them contradict each
other.

References:
    .. [Gil] J. J. Gil et al., chapter on stability and transparency in "Advances in Haptics", 2010, section 4.
    .. [Cavusoglu] M. C. Cavusoglu, D. Feygin, F. Tendick, A critical study of the mechanical and electrical properties
       of the PHANToM haptic interface, Presence 11 (6), 2002, section 4.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import TwoMassAxis, masses_from_resonance
from phantom_dyn.haptics.device.transfer_function import TransferFunction

PERIOD = 1e-3
"""Sampling period of the experiments [s]."""
PRINTED_PEAK_DISTANCE = 78.16
"""Printed distance Q of the peak of the LHIfAM with the original cable [dB]."""

PHANTOM_RADIUS = 0.12
"""Distance from the first axis of the PHANToM 1.0 to its handle [m]."""
PHANTOM_INERTIA = 0.07292 * PHANTOM_RADIUS**2
"""Inertia of the first axis of the PHANToM 1.0 [kg m2]: 72.92 g at the handle."""
PHANTOM_RESONANCE = 2 * math.pi * 62.5
"""Resonance of the first axis of the PHANToM 1.0 [rad/s]."""

LHIFAM_MASS = 5.4
"""Moving mass of the LHIfAM along its guide [kg]."""
LHIFAM_RESONANCE = 2 * math.pi * 82.0
"""Resonance of the LHIfAM with the original cable [rad/s]."""


def _lhifam() -> TwoMassAxis:
    motor, body = masses_from_resonance(LHIFAM_MASS, 79.5e3, LHIFAM_RESONANCE)
    damping, ratio = (0.1, 3.4), motor / body
    peak = 10 ** (PRINTED_PEAK_DISTANCE / 20) / LHIFAM_RESONANCE
    cable = (peak - damping[0] - damping[1] * ratio**2) / (1 + ratio) ** 2
    return TwoMassAxis(motor, body, *damping, 79.5e3, cable)


LHIFAM = _lhifam()
"""LHIfAM with its original cable, 79.5 kN/m."""
LHIFAM_NEW_CABLE = replace(LHIFAM, cable_stiffness=38e3, cable_damping=11.0)
"""LHIfAM with a cable of 38 kN/m and 11 N s/m, as printed."""
LHIFAM_HEAVIER_MOTOR = replace(LHIFAM_NEW_CABLE, motor_mass=0.3769, body_mass=LHIFAM_MASS - 0.3769)
"""LHIfAM with the new cable and the motor mass that the printed crossing needs."""


def phantom_1_0(cable_damping: float, body_damping: float = 0.0) -> TwoMassAxis:
    """First axis of the PHANToM 1.0, about its joint.

    Args:
        cable_damping: Damping of the cable [N m s/rad], which the available copy lacks; tests use 0.001 to 0.008.
        body_damping: Damping of the body [N m s/rad], which the available copy lacks.
    """
    motor, body = masses_from_resonance(PHANTOM_INERTIA, 18.13, PHANTOM_RESONANCE)
    return TwoMassAxis(motor, body, 0.0085, body_damping, 18.13, cable_damping)


def _fit(numerator: list[float], quadratic: list[float]) -> TransferFunction:
    return TransferFunction(np.array(numerator), np.array([*quadratic, 0.0, 0.0]))


PHANTOM_1_5_X = _fit([1.0, 5.716, 9.201e4], [3.329e-6, 0.001226, 1.536])
"""Fit of the x axis (that of the first joint), units not stated."""
PHANTOM_1_5_Y = _fit([1.0, 30.25, 2.923e5, 5.741e6, 1.784e10], [1.526, 233.0, 2.848e5])
"""Fit of the y axis."""
PHANTOM_1_5_Z = _fit([1.0, 1248.0, 1.275e6, 3.243e8, 1.097e11], [5.953, 875.3, 9.635e5])
"""Fit of the z axis."""


@dataclass(frozen=True)
class FitReading:
    """Masses, springs and dampers of a fit of the PHANToM 1.5, in its units, which are not stated.

    Attributes:
        motor_mass: m1.
        body_mass: m2.
        stiffness: k between them.
        mount_stiffness: k_t, stiffness of the spring in series; infinite in model (a).
        dampings: Values of b, one from each coefficient that contains b; for a true two-mass model they are equal.
    """

    motor_mass: float
    body_mass: float
    stiffness: float
    mount_stiffness: float
    dampings: tuple[float, ...]


def low_frequency_inertia(axis: TransferFunction) -> float:
    """Mass of an axis at low frequency: the limit of force over acceleration.

    Raises:
        ParameterError: If springs or dampers to ground hold the axis, so that there is no limit.
    """
    if np.any(axis.denominator[-2:] != 0) or len(axis.denominator) < 3:
        raise ParameterError(
            "The axis is held by springs or dampers to ground, so that force over acceleration has no limit at low "
            "frequency: give a transfer function with two poles at zero."
        )
    return float(axis.denominator[-3] / axis.numerator[-1])


def two_mass_of_fit(axis: TransferFunction) -> FitReading:
    r"""Parameters of model (a) or (b) from a fit, which has more coefficients than unknowns.

    Model (a): :math:`(m_2 s^2 + b s + k) / (s^2 [m_1 m_2 s^2 + (m_1 + m_2)(b s + k)])`. Model (b) adds :math:`1/k_t`, a
    compliant mount.

    Raises:
        ParameterError: If the transfer function has neither shape.
    """
    top, bottom = axis.numerator.tolist(), axis.denominator[:3].tolist()
    if len(axis.denominator) != 5 or len(top) not in (3, 5) or np.any(axis.denominator[3:] != 0):
        raise ParameterError(
            f"A transfer function of degree {len(top) - 1} over {len(axis.denominator) - 1} is not one of the "
            "PHANToM 1.5: give degree 2 or 4 over 4, with two poles at zero."
        )
    if len(top) == 3:
        # Over m2: numerator (1, b/m2, k/m2), denominator (m1, r b, r k) with r = (m1 + m2)/m2.
        motor, pole = bottom[0], bottom[2] / top[2]
        body = pole - motor
        share = pole / body
        return FitReading(motor, body, top[2] * body, math.inf, (top[1] * body, bottom[1] / share))
    mount = bottom[0]
    total = bottom[2] / top[4]
    # With c = (m1 + m2)/(m1 m2): denominator kt (1, c b, c k), numerator (1, c b, c k + kt/m1, kt b/(m1 m2), ...).
    motor = mount / (top[2] - bottom[2] / mount)
    body = total - motor
    both = total / (motor * body)
    dampings = (bottom[1] / mount / both, top[1] / both, top[3] * motor * body / mount)
    return FitReading(motor, body, bottom[2] / mount / both, mount, dampings)
