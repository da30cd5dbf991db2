"""Fit with the known true cause: how much of the gap the best explanation would close.

Run ``python oracle.py robot.urdf log.csv --json FILE`` in a folder that also contains the case's ``answer.json``. The
columns, nuisances, noise, blocks and refits are those of a diagnosis, but the search returns the true effects, each
with its best shape. It runs after the diagnoses in a process of its own, because it opens answers.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from itertools import product
from pathlib import Path

from identification.data.reading import read_recording
from identification.diagnosis import explanation as pieces
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.search.search import Search
from identification.pipeline import diagnose
from identification.reporting.stored.diagnosis_files import write_outputs
from identification.stages import Progress
from phantom_dyn.model.loading import load_robot

Place = tuple[str, str | None]


def true_set(truth: frozenset[Place]) -> Callable[..., frozenset[Term]]:
    """A search that returns the true effects, without those that have no columns in the recording."""

    def given_set(search: Search, progress: Progress, *_: object) -> frozenset[Term]:
        by_place: dict[Place, list[Term]] = {}
        for term in search.terms:
            if term.effect_joint in truth:
                by_place.setdefault(term.effect_joint, []).append(term)
        del progress  # the whole set is selected in one step
        sets = [frozenset(chosen) for chosen in product(*by_place.values())]
        return min(sets, key=search.score)

    return given_set


def oracle(robot_file: Path, log_file: Path, truth: frozenset[Place], json_file: Path) -> None:
    """Write the diagnosis of a case whose search gets the true causes."""
    robot = load_robot(robot_file)
    # This process replaces a part of the diagnosis and does nothing else.
    pieces.stepwise_search = true_set(truth)
    pieces.with_leading_rivals = lambda _, chosen: chosen
    diagnosis = diagnose(robot, (read_recording(log_file, robot),))
    write_outputs(diagnosis, robot, out=None, json_file=json_file)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Fit the true effects of one case.")
    parser.add_argument("robot", type=Path)
    parser.add_argument("log", type=Path)
    parser.add_argument("--json", type=Path, required=True, metavar="FILE")
    given = parser.parse_args(arguments)
    answer = json.loads(Path("answer.json").read_text())
    truth = frozenset((e["effect"], e["joint"]) for e in answer.get("truth", answer["effects"]))
    oracle(given.robot, given.log, truth, given.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
