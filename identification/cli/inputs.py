"""What commands that read a robot and recordings check before anything heavy is loaded."""

from __future__ import annotations

import argparse
from pathlib import Path

from phantom_dyn.errors import UsageError


def require_files(arguments: argparse.Namespace) -> None:
    """Refuse a robot or log that is not there, and a log given twice, before anything heavy is loaded.

    Blocks of a recording that is there twice would be judged by fits that have seen their copy.
    """
    from identification.readers import require_existing
    from phantom_dyn.robot_files import find_robot

    find_robot(arguments.robot)
    seen: dict[Path, str] = {}
    for option, paths in (("LOG", arguments.logs), ("--hold-out", arguments.hold_out)):
        for path in paths:
            require_existing(path)
            place = Path(path).resolve()
            if place in seen:
                raise UsageError(f"{path} is given twice, as {seen[place]} and as {option}; give every recording once")
            seen[place] = option


def stretch(text: str) -> tuple[float, float]:
    """``T0:T1`` as two times."""
    try:
        start, stop = (float(part) for part in text.split(":"))
    except ValueError:
        raise UsageError(f"--exclude {text} was given, wanted two times in seconds such as 2.5:4") from None
    if not start < stop:
        raise UsageError(f"--exclude {text} ends before it begins, wanted T0 < T1; turn the two times round")
    return start, stop
