"""Write sealed cases: the input of the diagnosis into one folder, the answers into another.

Example: ``python -m benchmarks.blind.generate --singles 0:120 --nulls 0:60 --cases DIR --answers DIR``, or one kind
with ``--seeds 0:40 --kind single``. Without seeds, the reporting ranges (`REPORTING`) are drawn. ``--make drake``,
``--make field`` or ``--make real`` selects another make. Existing cases are kept.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.makes import NAMES as MAKES
from benchmarks.blind.makes import make_named
from benchmarks.gapbench import cases as drawing

KINDS = ("mixed", "null", "single", "pair", "outside")
# Every kind has its own random stream, so a seed can be used once for each. Seeds below 1000 are for development.
# 1000 to 10999 were opened for earlier reports, 15000 to 18039 and 20000 to 23029 to check later methods. Those
# from 11000 were opened once, for the report.
REPORTING = {
    "single": range(11000, 11250),
    "null": range(12000, 12300),
    "pair": range(13000, 13080),
    "outside": range(14000, 14080),
}
OPTIONS = {"single": "--singles", "null": "--nulls", "pair": "--pairs", "outside": "--outside"}
FILES = ("robot.urdf", "robot.yaml", "log.csv")
FIRST = MAKES[0]


def seed_range(text: str) -> range:
    """Seeds from A up to, but without, B for ``A:B``; the seed A for ``A``."""
    first, _, end = text.partition(":")
    try:
        seeds = range(int(first), int(end) if end else int(first) + 1)
    except ValueError:
        seeds = range(0)
    if not seeds or seeds[0] < 0:
        raise argparse.ArgumentTypeError(f"'{text}' are no seeds: give FIRST:END with 0 <= FIRST < END, as in 0:40")
    return seeds


def draw(seed: int, kind: str, cases: Path, answers: Path, make: str = FIRST) -> str:
    """Generate a case and its answer unless both exist, and return its id.

    Raises:
        NoCase: If the seed gives no case.
    """
    return drawing.draw(seed, kind, cases, answers, make_named(make))


def draw_one(seed: int, folder: Path, answers_folder: Path) -> tuple[Path, Path]:
    """Draw a robot with an effect, never a null; return the case folder and the answer file."""
    name = draw(seed, "single", Path(folder), Path(answers_folder))
    return Path(folder) / name, Path(answers_folder) / f"{name}.json"


def draw_many(seeds: range, kind: str, cases: Path, answers: Path, jobs: int, make: str = FIRST) -> list[str]:
    """Generate the cases of many seeds, ``jobs`` in parallel, except those that exist; return the ids of all."""
    by = make_named(make)
    names = drawing.draw_all([(by, seed, kind) for seed in seeds], cases, answers, jobs)
    return [name for name in names if name is not None]


def case_ids(batches: Iterable[tuple[str, range]], make: str = FIRST) -> list[str]:
    """Ids of the cases of some kinds and seeds without repetition, without drawing a case."""
    by = make_named(make)
    names = (by.case_id(seed, by.resolved_kind(seed, kind)) for kind, seeds in batches for seed in seeds)
    return list(dict.fromkeys(names))


def add_seed_options(to: argparse.ArgumentParser) -> None:
    """Add the options that `chosen_batches` reads."""
    to.add_argument("--seeds", type=seed_range, metavar="FIRST:END", help="of --kind")
    to.add_argument("--kind", choices=KINDS, default="mixed", help="of --seeds")
    for kind, option in OPTIONS.items():
        to.add_argument(option, dest=kind, type=seed_range, metavar="FIRST:END", help=f"seeds of kind {kind}")
    to.add_argument("--make", choices=MAKES, default=FIRST, help=f"whose cases (default: {FIRST})")


def chosen_batches(given: argparse.Namespace) -> list[tuple[str, range]]:
    """Kinds and seeds from the command line, or the reporting ranges without any."""
    batches = [(given.kind, given.seeds)] if given.seeds else []
    batches += [(kind, seeds) for kind in OPTIONS if (seeds := getattr(given, kind))]
    return batches or list(REPORTING.items())


def parser() -> argparse.ArgumentParser:
    """The options of this command."""
    out = argparse.ArgumentParser(description="Write sealed cases and their answers.")
    add_seed_options(out)
    out.add_argument("--cases", type=Path, required=True, metavar="DIR", help="what the diagnosis may see")
    out.add_argument("--answers", type=Path, required=True, metavar="DIR", help="what only the scorer may see")
    out.add_argument("--jobs", type=int, default=2)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Write the cases that do not exist yet."""
    given = parser().parse_args(arguments)
    count = 0
    for kind, seeds in chosen_batches(given):
        count += len(draw_many(seeds, kind, given.cases, given.answers, given.jobs, given.make))
    print(f"{count} cases in {given.cases}, their answers in {given.answers}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
