"""Where rollouts start: windows spread over the samples that the figures are of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from identification.diagnosis.blocks import Block
from identification.log import Log

Array = np.ndarray

_LEAST_ROWS = 3  # of a window


@dataclass(frozen=True)
class Window:
    """Full-rate samples ``start`` to ``stop`` (one after the last) of a log, and the fold that has not seen them.

    Attributes:
        log: Index of the log.
        start: First sample.
        stop: One after the last.
        fold: -1 where no fit has seen them.
        lead: Samples before the start that may be used to settle, none invalid.
    """

    log: int
    start: int
    stop: int
    fold: int
    lead: int


def windows_in(
    logs: tuple[Log, ...],
    blocks: tuple[Block, ...],
    folds: Int[Array, " B"],
    judged: Int[Array, " k"],
    *,
    seconds: float,
    lead: float,
    count: int,
) -> tuple[Window, ...]:
    """At most ``count`` windows, evenly spread, each inside a judged block.

    Args:
        logs: Recordings.
        blocks: What is held out together.
        folds: Of each block.
        judged: Which blocks count.
        seconds: Length of a window [s]; a shorter block is taken whole.
        lead: Wanted seconds before a window in which hidden states settle.
        count: The most windows.
    """
    places = []
    for k in judged:
        block = blocks[k]
        log = logs[block.log]
        samples, rate = log.samples, log.band.rate_hz
        first, last = int(samples[block.core]), int(samples[block.stop - 1])
        length = min(max(_LEAST_ROWS, round(seconds * rate) + 1), last - first + 1)
        if length < _LEAST_ROWS:
            continue
        # As many as fit without overlap; what is left over is shared out before and behind them.
        fit = max(1, (last - first + 1) // length)
        margin = (last - first + 1 - fit * length) // 2
        places += [(block.log, first + margin + i * length, length, int(folds[k])) for i in range(fit)]
    good = [
        w for w in (_window(logs, at, start, length, fold, lead) for at, start, length, fold in places) if w is not None
    ]
    if len(good) <= count:
        return tuple(good)
    return tuple(good[i] for i in np.linspace(0, len(good) - 1, count).round().astype(int))


def _window(logs: tuple[Log, ...], at: int, start: int, length: int, fold: int, lead: float) -> Window | None:
    """None where a sample must not be used."""
    valid, rate = logs[at].valid, logs[at].band.rate_hz
    if not valid[start : start + length].all():
        return None
    wanted = min(round(lead * rate), start)
    bad = np.flatnonzero(~valid[start - wanted : start])
    return Window(at, start, start + length, fold, wanted if len(bad) == 0 else wanted - 1 - int(bad[-1]))
