"""Prints the output of a command without control characters, which names of files and joints may contain."""

from __future__ import annotations

import os
import sys
from typing import TextIO

from phantom_dyn.errors import printable


def say(words: object = "", *, file: TextIO | None = None, flush: bool = False) -> None:
    """Print lines without control characters.

    If the program that reads the output has ended (head, less), lines are discarded. The command continues, because it
    may write files.

    Args:
        words: One or several lines.
        file: Stream; standard output by default.
        flush: True to show the text at once.
    """
    text = "\n".join(map(printable, str(words).split("\n")))
    stream = sys.stdout if file is None else file
    if stream is not None:
        text = _in_encoding(text, stream)
    try:
        print(text, file=file, flush=flush)
    except BrokenPipeError:
        discard_output(sys.stdout if file is None else file)


def _in_encoding(text: str, stream: TextIO) -> str:
    """Text in which characters that the stream's encoding (such as ASCII) lacks are replaced by +- or ?."""
    encoding = getattr(stream, "encoding", None) or "utf-8"
    try:
        text.encode(encoding, getattr(stream, "errors", None) or "strict")
    except UnicodeEncodeError:
        return text.replace("±", "+-").encode(encoding, "replace").decode(encoding)
    return text


def complain(words: str) -> None:
    """Print an error on standard error; if printing fails, only the exit code reports the error."""
    try:
        say(f"phantom-dyn: {words}", file=sys.stderr, flush=True)
    except OSError:
        discard_output(sys.stderr)


def discard_output(stream: TextIO) -> None:
    """Send further output of a broken stream to the null device.

    Without this, Python would flush the stream at exit and fail again.
    """
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, stream.fileno())
    os.close(null)


def open_streams() -> None:
    """Open standard output and error on the null device if the caller has closed them (``>&-``).

    Otherwise Python would have no object for a closed stream, and output of C++ code would go to the next opened file.
    """
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, number)
            if null != number:
                os.close(null)
            setattr(sys, name, os.fdopen(number, "w", encoding="utf-8"))
