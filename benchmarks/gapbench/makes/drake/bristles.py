r"""Friction of bristles (LuGre), written for steps that stay stable however stiff the bristles are.

A bristle bends by z, with the slip speed w:

    dz/dt = w - s0 |w| / g(w) z,    F = s0 z + s1 dz/dt + s2 w,    g(w) = Tc + (Ts - Tc) exp(-(w / ws)^2).

Held speed gives F = g(w) sign(w) + s2 w, a small displacement from rest F = s0 dx (Canudas de Wit et al., 1995).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Bristles:
    """Constants of m friction contacts; the friction opposes the slip speed w.

    Attributes:
        stiffness: s0 [N m/rad], shape ``(m,)``.
        damping: s1 [N m s/rad], shape ``(m,)``.
        viscous: s2 for positive and negative slip [N m s/rad], shape ``(m, 2)``.
        coulomb: Tc for positive and negative slip [N m], shape ``(m, 2)``; above zero.
        static: Ts - Tc [N m], shape ``(m,)``.
        stribeck: ws [rad/s], shape ``(m,)``.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    static: np.ndarray
    stribeck: np.ndarray

    def level(self, slip: np.ndarray) -> np.ndarray:
        """g(w) [N m], the dry friction of steady slip."""
        dry = np.where(slip >= 0.0, self.coulomb[:, 0], self.coulomb[:, 1])
        return dry + self.static * np.exp(-((slip / self.stribeck) ** 2))

    def wet(self, slip: np.ndarray) -> np.ndarray:
        """s2 of the direction of slip [N m s/rad]."""
        return np.where(slip >= 0.0, self.viscous[:, 0], self.viscous[:, 1])

    def steady(self, slip: np.ndarray) -> np.ndarray:
        """Friction at a held slip speed [N m]."""
        return self.level(slip) * np.sign(slip) + self.wet(slip) * slip


@dataclass(frozen=True)
class Linear:
    """Friction over one step as ``offset + slope * w_next``, and what the next bend is made of."""

    offset: np.ndarray
    slope: np.ndarray
    shrink: np.ndarray
    step: float

    def next_bend(self, bend: np.ndarray, slip: np.ndarray) -> np.ndarray:
        """z at the end of the step, from the slip speed at its end."""
        return (bend + self.step * slip) / self.shrink


def linear(of: Bristles, bend: np.ndarray, slip: np.ndarray, step: float, level: np.ndarray) -> Linear:
    """The friction of one step, implicit in slip and bend, so that stuck bristles need no small step.

    Args:
        of: Constants.
        bend: z at the start [rad], shape ``(m,)``.
        slip: w at the start [rad/s], shape ``(m,)``.
        step: Length [s].
        level: g(w), with whatever adds to it at this step [N m], shape ``(m,)``.
    """
    shrink = 1.0 + step * of.stiffness * np.abs(slip) / level
    reach = of.stiffness + of.damping / step
    half = 0.5 * of.wet(slip)
    return Linear(
        offset=reach * bend / shrink - of.damping * bend / step + half * slip,
        slope=reach * step / shrink + half,
        shrink=shrink,
        step=step,
    )


def joined(first: Bristles, second: Bristles) -> Bristles:
    """The contacts of both, one after the other."""
    names = ("stiffness", "damping", "viscous", "coulomb", "static", "stribeck")
    return Bristles(**{name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in names})
