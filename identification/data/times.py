"""Text of a recording's times, for messages."""

from __future__ import annotations

from phantom_dyn.array_types import Array, Float

_NAMED = 5  # times in a sentence


def time_text(t: float) -> str:
    """A time [s] to six digits, and to a millisecond at least, as times since 1970 differ only in their last digits."""
    return f"{t:.6g}" if abs(t) < 1e3 else f"{t:.3f}".rstrip("0").rstrip(".")


def when(t: Float[Array, " n"]) -> str:
    """Text of several times [s], of which only the first few are listed."""
    more = f" and {len(t) - _NAMED} more" if len(t) > _NAMED else ""
    return "at t = " + ", ".join(time_text(time) for time in t[:_NAMED]) + f" s{more}"
