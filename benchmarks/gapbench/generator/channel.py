"""What a drive makes of the logged torque: delay, lag, clip, ratio, each exact over the steps of the simulation."""

from __future__ import annotations

from math import exp, floor

from .plant import Channel


class Drive:
    """Torque of one drive from the torques held so far; the lag is its only state."""

    def __init__(self, channel: Channel, held: list[float], dt: float, step: float) -> None:
        self.channel, self.held, self.dt, self.step = channel, held, dt, step
        self.state: float | None = None

    def _delayed(self, start: float) -> float:
        """Mean of the held torque over one step that begins ``start`` holds after the first one."""
        share, first = self.step / self.dt, start - self.channel.delay / self.dt
        i = floor(first + 1e-9)
        if i < 0:
            return self.held[0]
        before = min(1.0, (i + 1 - first) / share)
        return before * self.held[i] + (1.0 - before) * self.held[min(i + 1, len(self.held) - 1)]

    def torque(self, start: float) -> float:
        """Mean torque over one step that begins ``start`` holds after the first one."""
        c = self.channel
        u = self._delayed(start) if c.delay else self.held[-1]
        if c.lag:
            before = u if self.state is None else self.state
            keep = exp(-self.step / c.lag)
            self.state = u + (before - u) * keep
            u += (before - u) * (1.0 - keep) * c.lag / self.step
        return c.ratio * min(max(u, -c.limit), c.limit)
