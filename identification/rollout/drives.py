"""What drives give when a recorded torque is asked of them, over a whole recording."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from identification.rollout.models import Model
from phantom_dyn.effects.actuator_lag import lag_law
from phantom_dyn.effects.effect import Law
from phantom_dyn.effects.input_delay import delay_law
from phantom_dyn.effects.torque_constant import scaled_law
from phantom_dyn.effects.torque_saturation import clipped_law
from phantom_dyn.errors import ParameterError

Array = np.ndarray


def given_torque(model: Model, t: Float[Array, " N"], tau: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Torque [N m or N] that acts when ``tau`` is asked for at uniform times: each drive with its history.

    Args:
        model: Gives the effects of the drives and the timing of the log.
        t: Times [s].
        tau: Recorded torque.
    """
    dt = (t[-1] - t[0]) / (len(t) - 1)
    out = np.array(tau, dtype=float)
    if model.late:
        out = np.column_stack([np.interp(t - model.late * dt, t, column) for column in out.T])
    for drive in model.drives:
        for law in drive.laws:
            out[:, law.row] = _after(law, t, dt, out[:, law.row])
    return out


def _after(law: Law, t: Array, dt: float, tau: Array) -> Array:
    """One drive's torque behind one law; it starts in balance."""
    size = law.numbers[0]
    if law.function is scaled_law:
        return size * tau
    if law.function is clipped_law:
        return np.clip(tau, -size, size)
    if law.function is delay_law:
        return np.interp(t - size, t, tau)
    if law.function is lag_law:
        return _lagged(tau, dt, size)
    raise ParameterError("The simulation has no law for a drive like this.")


def _lagged(tau: Array, dt: float, time_constant: float) -> Array:
    """First-order low pass, exact for a torque that is linear between samples."""
    from scipy.signal import lfilter

    if time_constant <= 0:
        return tau
    steps = dt / time_constant
    keep = np.exp(-steps)
    old, new = (1.0 - keep) / steps - keep, 1.0 - (1.0 - keep) / steps
    return np.asarray(lfilter([new, old], [1.0, -keep], tau, zi=[tau[0] * (1.0 - new)])[0])
