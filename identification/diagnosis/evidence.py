"""Samples that the figures of a report show."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float


@dataclass(frozen=True)
class SimulatedPositions:
    """Simulated positions of the given and the corrected model, in windows that start from the recorded state.

    Attributes:
        before: Positions of the given model [rad or m] at the samples of the evidence, ``(N, nv)``; NaN at samples that
            were not simulated, and at the first sample of each window.
        after: Positions of the corrected model, by fits to other blocks.
        seconds: Length of the windows [s].
        controlled: True if simulated with the stated controllers and the recorded references, False if with the
            recorded torque.
    """

    before: Float[Array, "N nv"]
    after: Float[Array, "N nv"]
    seconds: float
    controlled: bool


@dataclass(frozen=True)
class Evidence:
    """Samples that the figures of the report show, in the analysed band; arrays share the first axis.

    Attributes:
        t: Time [s]; several recordings follow each other with a gap.
        q, v, a: Motion, ``(N, nv)``.
        tau_measured: Drive torque, ``(N, nv)``.
        tau_before: Torque of the given model, ``(N, nv)``.
        tau_after: Torque of the corrected model, each sample predicted by a fit to other blocks.
        regime_shares: For each joint, share of the squared residual of the given model by regime.
        regime_times: For each joint, share of the samples by regime; empty if not computed.
        tau_transmitted: Torque that the transmission passes to the link, ``(N, nv)``: the modelled torque minus the
            torques of rotor and friction. None: the report takes the modelled torque.
        tau_without: For each finding, torque of the corrected model without that finding, ``(N, nv)``, by fits to other
            blocks; empty if not computed.
        sample_period: Median sampling period of the recordings [s], before they were thinned; None: unknown.
        simulated: Simulated motion of both models; None if there is none.
        valid: False for samples that must not be used, such as those in a gap of a recording; None: all may be used.
        touched: True where something touches the links that a joint carries, so that its torque is not used,
            ``(N, nv)``; None: no contacts are known.
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
    simulated: SimulatedPositions | None = None
    valid: Bool[Array, " N"] | None = None
    touched: Bool[Array, "N nv"] | None = None

    def residual(self, tau: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
        """Measured minus modelled torque [N m or N], NaN where the torque of a joint is not used, ``(N, nv)``.

        Args:
            tau: Torque of the model.
        """
        left = self.tau_measured - tau
        return left if self.touched is None else np.where(self.touched, np.nan, left)

    @property
    def drawn(self) -> Evidence:
        """The usable samples alone; a gap of a recording is then a gap in time."""
        if self.valid is None or self.valid.all():
            return self
        rows, simulated = self.valid, self.simulated
        return replace(
            self,
            **{name: getattr(self, name)[rows] for name in ("t", "q", "v", "a")},
            **{name: getattr(self, name)[rows] for name in ("tau_measured", "tau_before", "tau_after")},
            tau_transmitted=None if self.tau_transmitted is None else self.tau_transmitted[rows],
            tau_without=tuple(torque[rows] for torque in self.tau_without),
            simulated=simulated and replace(simulated, before=simulated.before[rows], after=simulated.after[rows]),
            valid=None,
            touched=None if self.touched is None else self.touched[rows],
        )
