"""Writes the table of the sealed cases and the confusion matrix into the README.

Example: ``python benchmarks/blind/publish.py --score build/blind/score``
"""

from __future__ import annotations

import argparse
import datetime
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
BEGIN, END = "<!-- blind:begin -->", "<!-- blind:end -->"
IMAGE = Path("docs/blind_confusion.png")
CAPTION = "*Truth (rows) against the leading finding, or the verdict without one; shade: share of the row.*"


def between_markers(text: str, inside: str) -> str:
    """The text with everything between the two markers replaced; both have to be there once, in order."""
    pattern = re.compile(re.escape(BEGIN) + ".*?" + re.escape(END), re.DOTALL)
    if text.count(BEGIN) != 1 or text.count(END) != 1 or not pattern.search(text):
        raise ValueError(f"The text has to hold {BEGIN} and then {END}, each once: put them where the table goes.")
    return pattern.sub(lambda _: f"{BEGIN}\n{inside.strip()}\n{END}", text)


def heading(batches: Sequence[tuple[str, range]], day: datetime.date) -> str:
    """When, and which seeds."""
    seeds = ", ".join(f"{kind} {r.start} to {r.stop - 1}" for kind, r in batches)
    return f"Measured on {day.isoformat()} with `make blind`; seeds, opened once: {seeds}."


def publish(score: Path, batches: Sequence[tuple[str, range]], checkout: Path) -> None:
    """Puts ``score.md`` between the README's markers and the confusion matrix beside it."""
    text = (score / "score.md").read_text()
    image = f"![Confusion matrix of the sealed cases]({IMAGE.as_posix()})"
    inside = "\n\n".join([heading(batches, datetime.datetime.now(datetime.UTC).date()), text.strip(), image, CAPTION])
    readme = checkout / "README.md"
    filled = between_markers(readme.read_text(), inside)
    (checkout / IMAGE).parent.mkdir(exist_ok=True)
    shutil.copyfile(score / "confusion.png", checkout / IMAGE)
    readme.write_text(filled)


def main(arguments: list[str] | None = None) -> int:
    from benchmarks.blind.generate import REPORTING

    parser = argparse.ArgumentParser(description="Write a finished score into the README.")
    parser.add_argument("--score", type=Path, default=Path("build/blind/score"), metavar="DIR")
    given = parser.parse_args(arguments)
    publish(given.score, list(REPORTING.items()), CHECKOUT)
    return 0


if __name__ == "__main__":
    sys.path.insert(0, str(CHECKOUT))
    sys.exit(main())
