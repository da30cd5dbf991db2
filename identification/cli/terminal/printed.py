"""What a command prints: names of files and joints may hold control characters, which must not reach a terminal."""

from __future__ import annotations

from typing import TextIO

from phantom_dyn.errors import printable


def say(words: object = "", *, file: TextIO | None = None, flush: bool = False) -> None:
    """Print lines without control characters.

    Args:
        words: One line or several.
        file: Where to; standard output by default.
        flush: Whether it must be seen at once.
    """
    print("\n".join(map(printable, str(words).split("\n"))), file=file, flush=flush)
