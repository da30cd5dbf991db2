"""Output of a command: names of files and joints may hold control characters, which must not reach a terminal."""

from __future__ import annotations

import os
import sys
from typing import TextIO

from phantom_dyn.errors import printable


def say(words: object = "", *, file: TextIO | None = None, flush: bool = False) -> None:
    """Print lines without control characters.

    Args:
        words: One line or several.
        file: Stream; standard output by default.
        flush: True if the text must be seen at once.
    """
    text = "\n".join(map(printable, str(words).split("\n")))
    stream = sys.stdout if file is None else file
    if stream is not None:
        text = _in_encoding(text, stream)
    print(text, file=file, flush=flush)


def _in_encoding(text: str, stream: TextIO) -> str:
    """Text with +- and ? in the place of what the encoding of a stream lacks, as ASCII lacks most signs."""
    encoding = getattr(stream, "encoding", None) or "utf-8"
    try:
        text.encode(encoding, getattr(stream, "errors", None) or "strict")
    except UnicodeEncodeError:
        return text.replace("±", "+-").encode(encoding, "replace").decode(encoding)
    return text


def complain(words: str) -> None:
    """Print a line on standard error. If it cannot be written, only the exit code tells of the error."""
    try:
        say(f"phantom-dyn: {words}", file=sys.stderr, flush=True)
    except OSError:
        discard_output(sys.stderr)


def discard_output(stream: TextIO) -> None:
    """Send all further output of a broken stream to the null device.

    Python flushes the stream once more when it exits, and would fail there again.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, stream.fileno())
    os.close(null)


def open_streams() -> None:
    """Open standard output and error on the null device if the caller has closed them (``>&-``).

    Python has no object for them then, and the next opened file would receive what C++ code prints.
    """
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, number)
            if null != number:
                os.close(null)
            setattr(sys, name, os.fdopen(number, "w", encoding="utf-8"))
