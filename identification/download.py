"""Downloading one file: at most ten seconds without an answer, a progress bar on a terminal, a checked hash."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

T = TypeVar("T")

PATIENCE_S = 8.0
"""Wait for a server's first answer [s]; it includes the search for its address, which has no limit of its own."""
CHUNK = 1 << 16


def download(address: str, path: Path, sha256: str) -> None:
    """Put the file at ``address`` at ``path``; nothing is left there if it is not what ``sha256`` says.

    Raises:
        OSError: If the address does not answer, or the file cannot be written; the text is a few words.
        ValueError: If the file has another hash.
    """
    import pooch

    pooch.get_logger().setLevel("WARNING")  # it announces every download
    file = {"known_hash": f"sha256:{sha256}", "fname": path.name, "path": path.parent}
    try:
        pooch.retrieve(address, downloader=cast("Any", _to_file), **file)
    except ValueError as error:
        raise ValueError("what came has another SHA-256") from error


def _to_file(url: str, output_file: str, _: object) -> None:
    """Pooch's interface of a downloader: write what is at ``url`` to a path."""
    import requests

    try:
        response = within(PATIENCE_S, lambda: requests.get(url, stream=True, timeout=PATIENCE_S / 2))
        if not response.ok:
            raise OSError(f"the server answered {response.status_code}")
        size = int(response.headers.get("content-length", 0))
        with Path(output_file).open("wb") as out:
            for chunk in _with_progress(response.iter_content(CHUNK), size, Path(url).name):
                out.write(chunk)
    except requests.RequestException as error:
        raise OSError("no connection to the server") from error


def within(seconds: float, job: Callable[[], T]) -> T:
    """What ``job`` returns; a job that takes longer is left behind.

    It runs in a thread, because the search for a host's address cannot be interrupted otherwise.

    Raises:
        TimeoutError: After ``seconds``.
    """
    results: list[T] = []
    errors: list[Exception] = []

    def work() -> None:
        try:
            results.append(job())
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(seconds)
    if errors:
        raise errors[0]
    if not results:
        raise TimeoutError(f"no answer within {seconds:g} s")
    return results[0]


def _with_progress(chunks: Iterator[bytes], size: int, label: str) -> Iterator[bytes]:
    """The chunks, with a progress bar on standard error where that is a terminal."""
    if not sys.stderr.isatty():
        yield from chunks
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=size or None)
        for chunk in chunks:
            progress.advance(task, len(chunk))
            yield chunk
