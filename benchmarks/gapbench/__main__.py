"""The command ``gapbench``: draw cases, check and score what a tool says of them, run the baselines."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from . import __version__
from .baselines import NAMES as BASELINES
from .baselines.run import BaselineError, run_baseline
from .makes import NAMES as MAKES
from .scoring.board import json_of, judge_all, side_by_side, text_of
from .scoring.chart import ChartError, write_chart
from .scoring.submission import AnswerError, read_answer
from .splits import SplitError, draw_listed, hidden_cases, public_cases, read_key, seal_answers, truths

SPLITS = ("public", "hidden")


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no number of cases or processes: give 1 or more")
    return int(text)


def parser() -> argparse.ArgumentParser:
    """The commands and their options."""
    out = argparse.ArgumentParser(
        prog="gapbench", description="Score diagnoses of the gap between a robot and its model."
    )
    out.add_argument("--version", action="version", version=__version__)
    commands = out.add_subparsers(dest="command", required=True)

    draw = commands.add_parser("draw", help="draw the cases of a split into a folder")
    draw.add_argument("split", choices=SPLITS)
    draw.add_argument("folder", type=Path, metavar="DIR")
    draw.add_argument("--make", action="append", choices=MAKES, help="of this make alone; may be given again")
    draw.add_argument("--first", type=_positive, metavar="N", help="of each make the first N cases alone")
    draw.add_argument("--jobs", type=_positive, default=1, metavar="N", help="processes (default: 1)")
    draw.add_argument("--key-file", type=Path, metavar="FILE", help="that the hidden cases are made from")

    check = commands.add_parser("check", help="say what is wrong with a folder of answers")
    check.add_argument("answers", type=Path, metavar="ANSWERS")

    score = commands.add_parser("score", help="score a folder of answers, or several beside each other")
    score.add_argument("folder", type=Path, metavar="DIR", help="that 'gapbench draw' wrote")
    score.add_argument(
        "answers", type=Path, nargs="+", metavar="ANSWERS", help="folder with <case id>.json of each case"
    )
    score.add_argument("--json", type=Path, metavar="FILE", help="write the score for programs too")
    score.add_argument("--chart", type=Path, metavar="FILE", help="write a figure too (.png, .svg or .pdf)")
    score.add_argument("--key-file", type=Path, metavar="FILE", help="that opens sealed answers")

    baseline = commands.add_parser("baseline", help="write the answers of a baseline")
    baseline.add_argument("name", choices=BASELINES)
    baseline.add_argument("folder", type=Path, metavar="DIR", help="that 'gapbench draw' wrote")
    baseline.add_argument("answers", type=Path, metavar="ANSWERS", help="where the answers go")
    return out


def _draw(given: argparse.Namespace) -> int:
    makes = given.make or list(MAKES)
    if (given.split == "hidden") != (given.key_file is not None):
        raise SplitError(
            "Hidden cases are made from a key and public ones are not: give --key-file with 'hidden' alone."
        )
    key = read_key(given.key_file) if given.key_file else None
    listed = hidden_cases(makes, key, given.first) if key else public_cases(makes, given.first)
    names, said = draw_listed(listed, given.folder, given.jobs)
    for sentence in said:
        print(sentence, file=sys.stderr)
    if not names:
        return 1
    answers = seal_answers(given.folder, key) if key else given.folder / "answers"
    print(f"{len(names)} cases in {given.folder / 'cases'}, their answers in {answers}.")
    return 0


def _check(given: argparse.Namespace) -> int:
    files, bad = sorted(given.answers.glob("*.json")), 0
    for path in files:
        try:
            read_answer(path)
        except AnswerError as error:
            bad += 1
            print(*error.args, sep="\n")
    print(f"{len(files)} answers in {given.answers}, {bad} with faults.")
    return 1 if bad or not files else 0


def _score(given: argparse.Namespace) -> int:
    known = truths(given.folder, read_key(given.key_file) if given.key_file else None)
    names = [folder.name for folder in given.answers]
    if len(set(names)) < len(names):
        raise SplitError(
            f"Two folders of answers have one name ({', '.join(names)}): give each tool a name of its own."
        )
    scores, out = {}, {}
    for folder in given.answers:
        scores[folder.name], faults = judge_all(known, folder)
        for sentence in faults:
            print(f"{folder.name}: {sentence}", file=sys.stderr)
        out[folder.name] = json_of(scores[folder.name], faults)
    print(side_by_side(scores) if len(scores) > 1 else text_of(scores[names[0]]), end="\n" if len(scores) > 1 else "")
    if given.json:
        given.json.write_text(json.dumps(out if len(out) > 1 else out[names[0]], indent=1) + "\n")
    if given.chart:
        write_chart(scores, given.chart)
    return 0


def _baseline(given: argparse.Namespace) -> int:
    count, failed = run_baseline(given.name, given.folder / "cases", given.answers)
    print(f"{count} answers of {given.name} in {given.answers}; {failed} cases it could not read.")
    return 0


def main(arguments: list[str] | None = None) -> int:
    given = parser().parse_args(arguments)
    try:
        return {"draw": _draw, "check": _check, "score": _score, "baseline": _baseline}[given.command](given)
    except (SplitError, BaselineError, ChartError) as error:
        print(error, file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
