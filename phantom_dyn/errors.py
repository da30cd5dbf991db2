"""Exceptions of both packages, and functions that make parts of their messages: lists of names, shortened texts."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

# Largest number of names that a message lists.
_LISTED = 100
# Smallest similarity of two names (`difflib`) at which one is suggested for the other.
_SIMILAR = 0.5


class PhantomDynError(Exception):
    """Base class of all errors of phantom-dyn; the message is one sentence for the user."""


class RobotError(PhantomDynError, ValueError):
    """A robot file, a name in it, or its configuration cannot be used."""


class LogError(PhantomDynError, ValueError):
    """A recording cannot be used; the message says file, column, row, value and what to do."""


class ParameterError(PhantomDynError, ValueError):
    """A parameter has the wrong length, is out of bounds or is not physically consistent."""


class RunawayError(ParameterError):
    """A simulated motion diverged.

    Attributes:
        t: Time at which it diverged [s].
    """

    def __init__(self, t: float) -> None:
        super().__init__(
            f"The motion leaves all bounds after {t:.4g} s: check controller and parameters, or shorten max_step."
        )
        self.t = t


class EffectError(PhantomDynError, ValueError):
    """An effect of a user cannot be used; the message says where it is from, what was wanted and what to do."""


class ChainError(PhantomDynError, ValueError):
    """A closed chain cannot be closed, or is singular, at some positions; the message names loop and residual."""


class UsageError(PhantomDynError, ValueError):
    """A function or the command line was called with wrong arguments."""


class IdentifiabilityError(PhantomDynError):
    """The recording excites the robot too little to identify the requested parameters."""


class EstimationError(PhantomDynError):
    """A solver failed."""


def known_names(name: str, known: Iterable[str], what: str) -> str:
    """Words for a message about an unknown name: the known names, and the one that was probably meant.

    Args:
        name: The name that the user wrote.
        known: Names that exist, in the order in which they are listed.
        what: Plural noun of the known things, such as ``joints``.

    Returns:
        Words with which a message ends, for example ``the joints are a, b, c; did you mean b?``.
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
    """The known name that is most similar to ``name``, regardless of case; None if none is similar."""
    folded = {other.casefold(): other for other in known}
    close = get_close_matches(name.casefold(), folded, n=1, cutoff=_SIMILAR)
    return folded[close[0]] if close else None


def listed(names: Iterable[object], limit: int = 12) -> str:
    """List of names for a message; at most ``limit`` of them are named."""
    words = [shortened(str(name)) for name in names]
    if not words:
        return "none"
    return ", ".join(words[:limit]) + (f" and {len(words) - limit} more" if len(words) > limit else "")


def shortened(text: str, most: int = 80) -> str:
    """A name or value for a message, on one line and shortened to ``most`` letters."""
    text = printable(text)
    return text if len(text) <= most else f"{text[: most - 1]}…"


def printable(text: str) -> str:
    """Text with spaces in place of control characters, which a terminal might execute."""
    return "".join(c if c.isprintable() or c == "\N{NO-BREAK SPACE}" else " " for c in text)
