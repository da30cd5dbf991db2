r"""How stiff a virtual wall may be so that device and wall are passive, whoever holds the device.

Colgate and Schenkel (1997): a device with damping b in front of a sampled wall C(z) is passive exactly if

.. math:: b > \frac{T}{2} \frac{1}{1 - \cos\omega T}\, \mathrm{Re}\{(1 - e^{-j\omega T})\, C(e^{j\omega T})\}
   \quad\text{for all } 0 \le \omega \le \pi/T,

which for a spring and a damper without delay is :math:`b > KT/2 + |B|`. With a delay of :math:`dT + \tau` the power at
the aliases :math:`\omega_n` of a frequency is a Hermitian form of rank two,
:math:`b \sum |v_n|^2 - \mathrm{Re}\{\alpha\, \bar S_\tau S_0\}` with :math:`S_\tau = \sum v_n e^{j\omega_n\tau}
/(j\omega_n)`; its largest eigenvalue takes the place of the right-hand side, and is that where :math:`\tau = 0`.
Sufficient for stability with any passive operator, and far more than a free device needs if B is large.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.haptics.arguments import require_not_negative, require_numbers
from phantom_dyn.haptics.discretisation import split_delay

# Points between 0 and the Nyquist frequency; the greatest value is smooth there, most often at an end.
_POINTS = 2000
_HALVINGS = 60


def passive_damping(stiffness: float, *, period: float, delay: float = 0.0, virtual_damping: float = 0.0) -> float:
    """Least damping b of the device [N s/m or N m s/rad] with which this wall is passive.

    Args:
        stiffness: K of the wall [N/m or N m/rad].
        period: Sampling period T [s].
        delay: Of the loop beside the hold [s]; any number of 0 or more.
        virtual_damping: B of the wall.

    Raises:
        ParameterError: If stiffness or delay is negative, the period not positive, or a number not finite.
    """
    require_not_negative(stiffness=stiffness)
    require_numbers(virtual_damping=virtual_damping)
    steps, rest = split_delay(period, delay)
    x = np.linspace(0.0, np.pi, _POINTS + 1)[1:]
    x = np.concatenate([np.geomspace(1e-3 * x[0], x[0], 20)[:-1], x])
    back = -np.expm1(-1j * x)  # 1 - 1/z, exact where z is near one
    wall = stiffness + virtual_damping / period * back
    alpha = back * wall / period * np.exp(-1j * steps * x)
    square = (0.5 * period / np.sin(0.5 * x)) ** 2  # sum of 1/w_n^2 over all aliases
    if rest == 0:
        return float(np.max((alpha * square).real))
    # Sum of exp(-j w_n rest)/w_n^2 over the aliases: the z transform of a ramp that starts `rest` before the samples.
    cross = alpha * -period * np.conj(rest / back + period * (1.0 - back) / back**2)
    apart = np.maximum((np.abs(alpha) * square) ** 2 - cross.imag**2, 0.0)
    return float(np.max(0.5 * (cross.real + np.sqrt(apart))))


def passive_stiffness(damping: float, *, period: float, delay: float = 0.0, virtual_damping: float = 0.0) -> float:
    """Greatest stiffness [N/m or N m/rad] with which a wall on a device of this damping is passive; 0 if none is.

    Args:
        damping: b, the device's own damping to ground [N s/m or N m s/rad].
        period: Sampling period T [s].
        delay: Of the loop beside the hold [s].
        virtual_damping: B of the wall.

    Raises:
        ParameterError: If damping or delay is negative, the period not positive, or a number not finite.
    """
    require_not_negative(damping=damping)
    require_numbers(virtual_damping=virtual_damping)
    if virtual_damping == 0:
        return damping / passive_damping(1.0, period=period, delay=delay)
    if passive_damping(0.0, period=period, delay=delay, virtual_damping=virtual_damping) > damping:
        return 0.0
    low, high = 0.0, damping / passive_damping(1.0, period=period, delay=delay) + 4 * abs(virtual_damping) / period
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        needed = passive_damping(middle, period=period, delay=delay, virtual_damping=virtual_damping)
        low, high = (middle, high) if needed <= damping else (low, middle)
    return low
