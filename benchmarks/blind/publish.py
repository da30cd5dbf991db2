"""Write the table of the sealed cases and the confusion matrix into the documentation.

Example: ``python benchmarks/blind/publish.py --score build/blind/score``, with the seeds that were run (``--singles
100:140 --nulls 100:120``), or without seeds after a run of the reporting ranges.
"""

from __future__ import annotations

import argparse
import datetime
import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.generate import OPTIONS, REPORTING, add_seed_options, case_ids, chosen_batches
from benchmarks.gapbench.scoring.tables import wrapped
from benchmarks.markers import between_markers

CHECKOUT = Path(__file__).resolve().parents[2]
BEGIN, END = "<!-- blind:begin -->", "<!-- blind:end -->"
IMAGE = Path("docs/blind_confusion.png")
PAGE = Path("docs") / "sealed_cases.md"
CAPTION = "*Truth (rows) against the leading finding, or the verdict without one; shade: share of the row.*"


def command(batches: Sequence[tuple[str, range]]) -> str:
    """Command that draws, diagnoses and scores these cases."""
    if set(case_ids(batches)) == set(case_ids(REPORTING.items())):
        return "make blind"
    options = [f"{OPTIONS.get(kind, f'--kind {kind} --seeds')} {r.start}:{r.stop}" for kind, r in batches]
    return " ".join(["python benchmarks/blind/run.py", *options])


def heading(batches: Sequence[tuple[str, range]], day: datetime.date) -> str:
    """Date, command, number of cases, share of the reporting ranges, and seeds."""
    mine, whole = set(case_ids(batches)), set(case_ids(REPORTING.items()))
    if mine == whole:
        extent = "the reporting ranges; seeds, opened once"
    elif mine < whole:
        extent = f"part of the reporting ranges ({len(whole)} cases); seeds, opened once"
    else:
        extent = "not those of the reporting ranges; seeds"
    seeds = ", ".join(f"{kind} {r.start} to {r.stop - 1}" for kind, r in batches)
    cases = f"{len(mine)} case{'' if len(mine) == 1 else 's'}"
    return wrapped(f"Measured on {day.isoformat()} with `{command(batches)}`: {cases}, {extent}: {seeds}.")


def publish(score: Path, batches: Sequence[tuple[str, range]], checkout: Path) -> None:
    """Write ``score.md`` between the markers of the page, and the confusion matrix beside the page.

    Raises:
        ValueError: If the score is not that of these seeds.
    """
    scored, wanted = {x["id"] for x in json.loads((score / "score.json").read_text())["cases"]}, set(case_ids(batches))
    if scored != wanted:
        raise ValueError(
            f"{score} holds {len(scored)} cases, {len(scored & wanted)} of them among the {len(wanted)} of the given "
            "seeds: give the seeds that were scored."
        )
    text = (score / "score.md").read_text()
    image = f"![Confusion matrix of the sealed cases]({IMAGE.name})"
    inside = "\n\n".join([heading(batches, datetime.datetime.now(datetime.UTC).date()), text.strip(), image, CAPTION])
    page = checkout / PAGE
    filled = between_markers(page.read_text(), BEGIN, END, inside.strip())
    (checkout / IMAGE).parent.mkdir(exist_ok=True)
    shutil.copyfile(score / "confusion.png", checkout / IMAGE)
    page.write_text(filled)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Write a finished score into docs/sealed_cases.md.")
    parser.add_argument("--score", type=Path, default=Path("build/blind/score"), metavar="DIR")
    add_seed_options(parser)
    given = parser.parse_args(arguments)
    publish(given.score, chosen_batches(given), CHECKOUT)
    return 0


if __name__ == "__main__":
    sys.exit(main())
