"""Draws cases of a make and keeps them: what a diagnosis may see in one folder, the answers in another."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from .makes import Make, NoCase

Wanted = tuple[Make, int, str]  # whose case, of which seed and kind


def write_answer(answer: dict, answers: Path) -> Path:
    """Writes one answer under a temporary name and renames it."""
    answers.mkdir(parents=True, exist_ok=True)
    path = answers / f"{answer['id']}.json"
    part = path.with_suffix(".part")
    part.write_text(json.dumps(answer, indent=1) + "\n")
    part.replace(path)
    return path


def robot_and_log(case: Path) -> tuple[str, str] | None:
    """Names of the robot file and the (first) log in the folder of a case; None where it lacks one of them."""
    robots = [path.name for path in (case / "robot.urdf", case / "robot.xml") if path.is_file()]
    logs = sorted(path.name for path in [*case.glob("log.*"), *case.glob("log_*")])
    return (robots[0], logs[0]) if robots and logs else None


def draw(seed: int, kind: str, cases: Path, answers: Path, make: Make) -> str:
    """Generates a case and its answer unless both are there; returns its id.

    Raises:
        NoCase: If the seed gives none.
    """
    name = make.case_id(seed, make.resolved_kind(seed, kind))
    if not (answers / f"{name}.json").is_file() or robot_and_log(cases / name) is None:
        case = make.draw_case(seed, kind)
        make.write_case(case, cases)
        write_answer(case.answer, answers)
    return name


def draw_all(wanted: Sequence[Wanted], cases: Path, answers: Path, jobs: int) -> list[str | None]:
    """Generates cases, ``jobs`` at a time, skipping those that are there.

    Returns:
        Their ids in the order of ``wanted``. A seed that gives no case is reported on the terminal and has None.
    """
    if jobs == 1 or len(wanted) == 1:
        return [draw_if_any(one, cases, answers) for one in wanted]
    with ProcessPoolExecutor(jobs) as pool:
        waiting = [pool.submit(draw_if_any, one, cases, answers) for one in wanted]
        return [one.result() for one in waiting]


def draw_if_any(wanted: Wanted, cases: Path, answers: Path) -> str | None:
    """As `draw`, but says that a seed gives no case in place of raising."""
    make, seed, kind = wanted
    try:
        return draw(seed, kind, cases, answers, make)
    except NoCase as reason:
        print(reason, file=sys.stderr)
        return None
