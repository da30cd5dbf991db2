"""The exceptions of both packages, and parts of their sentences: names that exist, values cut and made printable."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

_LISTED = 100
"""Names listed in full; a longer list hides the one that is wanted."""
_ALIKE = 0.5
"""Likeness of two names (`difflib`) from which on one is suggested for the other."""


class PhantomDynError(Exception):
    """Anything that phantom-dyn refuses or cannot do; its text is one sentence for the user."""


class RobotError(PhantomDynError, ValueError):
    """A robot file, a name in it, or its configuration cannot be used."""


class LogError(PhantomDynError, ValueError):
    """A recording cannot be used: the text says file, column, row, value and what to do."""


class ParameterError(PhantomDynError, ValueError):
    """A parameter has the wrong length, is out of bounds or is not physically consistent."""


class RunawayError(ParameterError):
    """A simulated motion leaves all bounds.

    Attributes:
        t: When [s].
    """

    def __init__(self, t: float) -> None:
        super().__init__(
            f"The motion leaves all bounds after {t:.4g} s: check controller and parameters, or shorten max_step."
        )
        self.t = t


class EffectError(PhantomDynError, ValueError):
    """An effect that a user brought cannot be used: the text says where it is from, what was wanted and what to do."""


class ChainError(PhantomDynError, ValueError):
    """A closed chain cannot be closed, or is singular, where it was asked for: the text names loop and residual."""


class UsageError(PhantomDynError, ValueError):
    """The command line was called with something that it does not understand."""


class IdentifiabilityError(PhantomDynError):
    """The recording excites too little for what was asked."""


class EstimationError(PhantomDynError):
    """A solver failed."""


def known_names(name: str, known: Iterable[str], what: str) -> str:
    """Say which names exist and which one was probably meant.

    Args:
        name: The name that the user wrote.
        known: Names that exist, in the order in which they are listed.
        what: Plural noun of the known things, such as ``joints``.

    Returns:
        For example ``the joints are a, b, c; did you mean b?``, the end of a sentence with its mark.
    """
    names = list(known)
    if not names:
        return f"there are no {what}."
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    guess = nearest(name, names)
    listed = ", ".join(map(shortened, names[:_LISTED]))
    meant = f"did you mean {shortened(guess)}?" if guess else f"give one of these {what}."
    return f"the {what} are {listed}{more}; {meant}"


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that looks most like ``name``, or None when none is close; case does not count."""
    folded = {other.casefold(): other for other in known}
    close = get_close_matches(name.casefold(), folded, n=1, cutoff=_ALIKE)
    return folded[close[0]] if close else None


def listed(names: Iterable[object], limit: int = 12) -> str:
    """Names for a message, the first ``limit`` of them."""
    words = [shortened(str(name)) for name in names]
    if not words:
        return "none"
    return ", ".join(words[:limit]) + (f" and {len(words) - limit} more" if len(words) > limit else "")


def shortened(text: str, most: int = 80) -> str:
    """A name or value for a message: on one line, and cut where it is longer than ``most`` letters."""
    text = printable(text)
    return text if len(text) <= most else f"{text[: most - 1]}…"


def printable(text: str) -> str:
    """Text without control characters, as the name of a file or joint may hold some that must not reach a terminal."""
    return "".join(c if c.isprintable() or c == "\N{NO-BREAK SPACE}" else " " for c in text)
