"""Check whether an effect raises the noise floor by which it is judged, which would hide it.

    python benchmarks/silence.py --seeds 0:20 [--make slow]

Each case of one effect runs twice, with and without the effect, with the same motion, noise and encoders. The noise
floor of the joint that the effect changes most may differ by a factor of at most 1.2; the goal is 95 % of the pairs. A
floor that rises with the effect would make a diagnosis miss it. An effect also changes the highest frequency of the
motion, and so the judged band; floors are therefore compared per root of their band.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.blind.generate import seed_range
from benchmarks.blind.processes import default_command, run_all
from benchmarks.gapbench.generator.case import Case, with_and_without, write_case
from benchmarks.gapbench.makes import NoCase

WITHIN = 1.2
MAKES = ("mujoco", "slow")


@dataclass(frozen=True)
class Pair:
    """One effect, judged with and without it.

    Attributes:
        seed: Seed of the case.
        effect: Name of the effect.
        joint: Joint whose torque the effect changes most.
        ratio: Noise floor of this joint with the effect divided by the floor without it, each per root of its band.
        source: Source of the floor with the effect.
        verdict: Verdict with the effect.
    """

    seed: int
    effect: str
    joint: str
    ratio: float
    source: str
    verdict: str


def pairs(seeds: Sequence[int], *, slow: bool, jobs: int) -> Iterator[Pair]:
    """Both diagnoses of each seed that gives a case."""
    with tempfile.TemporaryDirectory() as place:
        cases, results = Path(place) / "cases", Path(place) / "results"

        def drawn(seed: int) -> tuple[int, Case, Case] | None:
            try:
                case, twin = with_and_without(seed, "single", slow=slow)
            except NoCase:
                return None
            without = replace(twin, id=f"{case.id}-without")
            for one in (case, without):
                write_case(one, cases)
            return seed, case, without

        with ThreadPoolExecutor(jobs) as pool:
            made = [one for one in pool.map(drawn, seeds) if one is not None]
        names = [case.id for _, *two in made for case in two]
        run_all(default_command(), names, cases, results, jobs=jobs, what="diagnosed")
        for seed, case, without in made:
            own, other = (_diagnosis(results, one.id) for one in (case, without))
            if own is not None and other is not None:
                yield _compared(seed, case, own, other)


def _diagnosis(results: Path, name: str) -> dict | None:
    return json.loads((results / f"{name}.json").read_text())["diagnosis"]


def _compared(seed: int, case: Case, with_it: dict, without: dict) -> Pair:
    joint = case.answer["joints"][int(np.argmax(case.answer["paired_gap_per_joint"]))]
    own, other = (next(one for one in said["joints"] if one["joint"] == joint) for said in (with_it, without))
    return Pair(
        seed,
        case.answer["effects"][0]["effect"],
        joint,
        _density(own, with_it) / _density(other, without),
        own["noise_floor_source"],
        with_it["verdict"],
    )


def _density(joint: dict, said: dict) -> float:
    """Noise floor of a joint per root of the judged band."""
    low, high = said["band_hz"]
    return joint["noise_floor"] / (high - low) ** 0.5


def summary(found: Sequence[Pair]) -> list[str]:
    """Share of pairs with equal floors, and how far the others differ."""
    ratio = np.array([pair.ratio for pair in found])
    same = np.maximum(ratio, 1.0 / ratio) <= WITHIN
    return [
        f"pairs                   {len(found)}",
        f"floor within {WITHIN} times  {same.sum()} of {len(found)} ({100 * same.mean():.0f} %)",
        "ratio at 5, 50, 95 %:   " + ", ".join(f"{x:.2f}" for x in np.percentile(ratio, [5, 50, 95])),
    ]


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line, print one line for each pair, then the results."""
    parser = argparse.ArgumentParser(description="Whether effects raise the floor by which they are judged.")
    parser.add_argument("--seeds", type=seed_range, default=range(20))
    parser.add_argument("--make", choices=MAKES, default=MAKES[0])
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args(words)
    found = []
    for pair in pairs(given.seeds, slow=given.make == "slow", jobs=given.jobs):
        found.append(pair)
        print(f"{pair.seed} {pair.effect} {pair.joint}  {pair.ratio:.2f}  ({pair.source}, {pair.verdict})", flush=True)
    print(*summary(found), sep="\n")


if __name__ == "__main__":
    main()
