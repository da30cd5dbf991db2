"""Check ``bounds``: is an effect of exactly the stated size found in 90 to 99 % of the recordings?

Example: ``python benchmarks/blind/power.py --seeds 700:760 --work build/power``. Every seed is recorded twice with the
same robot, motion and noise: first without an effect, for which the diagnosis states its bounds, then with one of
these effects at the stated size. An interrupted run can be continued.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.generate import FILES, seed_range
from benchmarks.blind.processes import default_command, run_all
from benchmarks.gapbench.cases import write_answer
from benchmarks.gapbench.generator.case import ATTEMPTS, Case, write_case
from benchmarks.gapbench.generator.effects import WHOLE, Effect
from benchmarks.gapbench.generator.files import robot_yaml, urdf_text
from benchmarks.gapbench.generator.setup import Setup, draw_setup, logged_torque, run_of, tracks
from benchmarks.gapbench.generator.simulate import Run
from benchmarks.gapbench.scoring.proportions import proportion
from benchmarks.gapbench.scoring.tables import table
from benchmarks.gapbench.seal import sealed

# Effects with one parameter, and what is added to the stated size to get this parameter.
ONE_NUMBER = {
    "viscous_friction": 0.0,
    "coulomb_friction": 0.0,
    "load_dependent_friction": 0.0,
    "backlash": 0.0,
    "torque_constant": 1.0,
    "torque_offset": 0.0,
    "input_delay": 0.0,
    "actuator_lag": 0.0,
    "rotor_inertia": 0.0,
    "encoder_offset": 0.0,
    "encoder_quantization": 0.0,
}
AIM = (0.90, 0.99)


@dataclass(frozen=True)
class Found:
    """Outcome of one effect at its stated size.

    Attributes:
        effect, joint: The effect that was added.
        seen: True if there is any finding, or a verdict other than ``no_gap``.
        listed: True if the effect at its joint is a finding or one of its rivals.
    """

    effect: str
    joint: str | None
    seen: bool
    listed: bool


def setup_of(seed: int) -> tuple[Setup, Run] | None:
    """Setup of a seed and its recording without an effect, or None if no drawn motion can be executed."""
    for attempt in range(ATTEMPTS):
        setup = draw_setup(seed, attempt, kind="null")
        run = run_of(setup)
        if tracks(run, setup):
            return setup, run
    return None


def recorded(name: str, setup: Setup, run: Run) -> Case:
    """Write the files of a recording; the answer goes to another folder."""
    owner, session = setup.owner, setup.session
    header = ("t", *(f"q.{j}" for j in owner.joints), *(f"tau.{j}" for j in owner.joints))
    log = np.column_stack([run.t, run.measured, logged_torque(run, setup.torque_hold)])
    yaml = robot_yaml(
        owner, torque_hold=setup.torque_hold, encoder_counts=session.encoder_counts, tolerance=setup.tolerance
    )
    return Case(name, urdf_text(owner), yaml, header, log, {})


def chosen_bound(bounds: Sequence[dict], seed: int) -> dict | None:
    """One of the stated bounds, chosen by the seed in turn over effects and joints; None if none can be simulated."""
    order = list(ONE_NUMBER)
    for shift in range(len(order)):
        mine = [
            b for b in bounds if b["effect"] == order[(seed + shift) % len(order)] and "+" not in (b["joint"] or "")
        ]
        if mine:
            return sorted(mine, key=lambda b: b["joint"] or "")[seed // len(order) % len(mine)]
    return None


def effect_of(bound: dict, setup: Setup) -> Effect:
    """The generator's effect at the size that a bound states."""
    joints = [link.joint for link in setup.owner.links]
    index = WHOLE if bound["joint"] is None else joints.index(bound["joint"])
    return Effect(bound["effect"], index, {bound["parameter"]: ONE_NUMBER[bound["effect"]] + bound["below"]})


def _name(seed: int, what: str) -> str:
    return f"p{seed:05d}{what}"


def draw_without(seed: int, cases: Path) -> str | None:
    """Write the recording without an effect; return its name, or None if the seed gives none."""
    name = _name(seed, "a")
    if not all((cases / name / f).is_file() for f in FILES):
        drawn = setup_of(seed)
        if drawn is None:
            return None
        write_case(recorded(name, *drawn), cases)
    return name


def draw_with(seed: int, results: Path, cases: Path, answers: Path) -> str | None:
    """Write the same recording with an effect at its bound; None without ``no_gap`` or a suitable bound."""
    name = _name(seed, "b")
    if (answers / f"{name}.json").is_file():
        return name
    diagnosis = json.loads((results / f"{_name(seed, 'a')}.json").read_text())["diagnosis"]
    bound = chosen_bound(diagnosis["bounds"], seed) if diagnosis and diagnosis["verdict"] == "no_gap" else None
    drawn = setup_of(seed)
    if bound is None or drawn is None:
        return None
    setup, _ = drawn
    run = run_of(setup, effect_of(bound, setup))
    if not tracks(run, setup):
        return None
    write_case(recorded(name, setup, run), cases)
    write_answer({"id": name, "bound": bound}, answers)
    return name


def found(bound: dict, diagnosis: dict | None) -> Found:
    """Judge whether a diagnosis finds an effect that was added."""
    wanted = {"effect": bound["effect"], "joint": bound["joint"]}
    findings = diagnosis["findings"] if diagnosis else []
    named = [{"effect": f["effect"], "joint": f["joint"]} for f in findings]
    named += [e for f in findings for rival in f["rivals"] for e in rival["effects"]]
    seen = bool(findings) or (diagnosis is not None and diagnosis["verdict"] != "no_gap")
    return Found(bound["effect"], bound["joint"], seen, wanted in named)


def report(outcomes: Sequence[Found]) -> str:
    """Share of effects of the stated size that are found, in all and by effect."""
    rows: list[tuple[object, ...]] = []
    for effect in ("all", *sorted({x.effect for x in outcomes})):
        mine = [x for x in outcomes if effect in ("all", x.effect)]
        rows.append((effect, len(mine), proportion(x.seen for x in mine), proportion(x.listed for x in mine)))
    aim = f"To reach: seen in {100 * AIM[0]:.0f} to {100 * AIM[1]:.0f} %."
    return f"{table(('effect at its bound', 'cases', 'seen', 'effect and joint listed'), rows)}\n\n{aim}\n"


def _drawn(jobs: int, draw, *each: Sequence) -> list:
    """Results of ``draw`` for each set of arguments, in parallel."""
    with ProcessPoolExecutor(jobs) as pool:
        return list(pool.map(draw, *each))


def check(seeds: range, work: Path, jobs: int, command: Sequence[str]) -> list[Found]:
    """Draw and diagnose both recordings of every seed."""
    cases, answers, results = (work / name for name in ("cases", "answers", "results"))
    answers.mkdir(parents=True, exist_ok=True)
    names = _drawn(jobs, draw_without, seeds, [cases] * len(seeds))
    run_all(command, [n for n in names if n], cases, results, jobs=jobs, what="without an effect")
    drawn = [seed for seed, name in zip(seeds, names, strict=True) if name]
    count = len(drawn)
    second = [n for n in _drawn(jobs, draw_with, drawn, [results] * count, [cases] * count, [answers] * count) if n]
    with sealed(answers):
        run_all(command, second, cases, results, jobs=jobs, what="with an effect at its bound")
    return [
        found(
            json.loads((answers / f"{n}.json").read_text())["bound"],
            json.loads((results / f"{n}.json").read_text())["diagnosis"],
        )
        for n in second
    ]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Check what would have been seen against what is seen.")
    parser.add_argument("--seeds", type=seed_range, default=range(700, 760), metavar="FIRST:END")
    parser.add_argument("--work", type=Path, default=Path("build/power"), metavar="DIR")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args(arguments)
    text = report(check(given.seeds, given.work, given.jobs, default_command()))
    (given.work / "power.md").write_text(text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
