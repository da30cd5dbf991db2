"""Samples of a diagnosis that the figures of its report are drawn from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float


@dataclass(frozen=True)
class Followed:
    """Positions that both models reach in simulation; every window starts from the recorded state.

    Attributes:
        before: Of the given model [rad or m] at the samples of the evidence, ``(N, nv)``; NaN where nothing was
            simulated, and where a window begins.
        after: Of the corrected model, by fits that have not seen the window.
        seconds: Length of the windows [s].
        controlled: True if the stated controllers follow the recorded references, False under the recorded torque.
    """

    before: Float[Array, "N nv"]
    after: Float[Array, "N nv"]
    seconds: float
    controlled: bool


@dataclass(frozen=True)
class Evidence:
    """Samples behind the figures of the report, in the analysed band; arrays share the first axis.

    Attributes:
        t: Time [s]; several recordings follow each other with a gap.
        q, v, a: Motion, ``(N, nv)``.
        tau_measured: Drive torque, ``(N, nv)``.
        tau_before: Torque of the given model, ``(N, nv)``.
        tau_after: Torque of the corrected model, each sample predicted by a fit that has not seen it.
        regime_shares: For each joint a mapping regime -> share of the residual energy before.
        regime_times: For each joint a mapping regime -> share of the samples; empty where it was not computed.
        tau_transmitted: Torque that the transmission passes to the link, ``(N, nv)``: the modelled torque less the
            rotor's share and the friction. None: the report takes the modelled torque.
        tau_without: For each finding the torque of the model that lacks it and has all others, ``(N, nv)``, by fits
            that have not seen the sample; empty where it was not computed.
        sample_period: Median time between the samples of the recordings [s], before they were thinned; None: unknown.
        followed: Simulated motion of both models; None where none could be simulated.
        valid: False for samples that must not be used, as within a gap of a recording; None: all may be.
        touched: True where something touches the links that a joint carries, so that its row is not used, ``(N, nv)``;
            None where contacts are not known.
    """

    t: Float[Array, " N"]
    q: Float[Array, "N nv"]
    v: Float[Array, "N nv"]
    a: Float[Array, "N nv"]
    tau_measured: Float[Array, "N nv"]
    tau_before: Float[Array, "N nv"]
    tau_after: Float[Array, "N nv"]
    regime_shares: tuple[dict[str, float], ...]
    regime_times: tuple[dict[str, float], ...] = ()
    tau_transmitted: Float[Array, "N nv"] | None = None
    tau_without: tuple[Float[Array, "N nv"], ...] = ()
    sample_period: float | None = None
    followed: Followed | None = None
    valid: Bool[Array, " N"] | None = None
    touched: Bool[Array, "N nv"] | None = None

    def residual(self, tau: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
        """Measured less modelled torque [N m or N], NaN where the row of a joint is not used, ``(N, nv)``.

        Args:
            tau: Torque of the model.
        """
        left = self.tau_measured - tau
        return left if self.touched is None else np.where(self.touched, np.nan, left)

    @property
    def drawn(self) -> Evidence:
        """Only the usable samples: a gap of a recording is then a gap in time."""
        if self.valid is None or self.valid.all():
            return self
        rows, followed = self.valid, self.followed
        return replace(
            self,
            **{name: getattr(self, name)[rows] for name in ("t", "q", "v", "a")},
            **{name: getattr(self, name)[rows] for name in ("tau_measured", "tau_before", "tau_after")},
            tau_transmitted=None if self.tau_transmitted is None else self.tau_transmitted[rows],
            tau_without=tuple(torque[rows] for torque in self.tau_without),
            followed=followed and replace(followed, before=followed.before[rows], after=followed.after[rows]),
            valid=None,
            touched=None if self.touched is None else self.touched[rows],
        )
