"""``make fuzz MINUTES=10 [SEED=0] [ONLY=csv]``: hostile files until the time is over, every kind of failure kept once.

A failure is a traceback, an exit code other than 0 or 2, more than 60 s of processor time or 1 GB, a refusal without
file or advice, a number that is not finite or a formula in an output, a control character or a warning of Python on the
terminal. The files of the first case of each are left in ``fuzz_failures/``.
"""

import argparse
import faulthandler
import random
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from fuzz_cases import KINDS, Case, drawn_case, tried, written_case
from fuzz_seeds import Seeds, make_seeds
from identification.cli.main import main as command
from identification.cli.terminal import progress

_BATCH = 500
_STUCK_S = 700.0  # a loop outside Python hears no alarm: the process says where it is and ends


def seeds_with_diagnosis(folder: Path) -> Seeds:
    """The good files, with the diagnosis that `compare` reads; also compiles what is compiled in a first run."""
    seeds = make_seeds(folder)
    json_file = folder / "made.json"
    # Loops that are closed numerically have compiled functions of their own.
    for robot, log in (("fourbar.xml", "fourbar.csv"), ("pendulum.urdf", "log.csv")):
        words, _ = written_case(Case("good", {}, ("diagnose", robot, log)), seeds, folder)
        code = command([*words, "--json", str(json_file)])
        assert code == 0, "a good recording is refused"
    seeds.texts["diagnosis.json"] = json_file.read_text()
    return seeds


def _signature(failure: str) -> str:
    """What makes two failures the same: their words without numbers and quoted values."""
    return re.sub(r"'[^']*'|\"[^\"]*\"|\d+", "#", failure)[:160]


class Tally:
    """Cases so far, and the first of every kind of failure."""

    def __init__(self, kept: Path) -> None:
        self.cases, self.failed, self.slowest, self.most = 0, 0, 0.0, 0
        self.codes: Counter[tuple[str, int | None]] = Counter()
        self.seen: Counter[str] = Counter()
        self._kept = kept

    def add(self, case: Case, seeds: Seeds) -> None:
        """Try a case."""
        faulthandler.dump_traceback_later(_STUCK_S, exit=True)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            outcome, found = tried(case, seeds, folder)
            self.cases += 1
            self.codes[case.kind, outcome.code] += 1
            self.slowest, self.most = max(self.slowest, outcome.seconds), max(self.most, outcome.peak)
            self.failed += bool(found)
            for failure in found:
                self._keep(case, folder, failure, outcome.raised)
        faulthandler.cancel_dump_traceback_later()

    def _keep(self, case: Case, folder: Path, failure: str, trace: str) -> None:
        signature = _signature(failure)
        self.seen[signature] += 1
        if self.seen[signature] > 1:
            return
        place = self._kept / f"{len(self.seen):03d}"
        shutil.copytree(folder, place)
        (place / "why.txt").write_text(f"{case.kind}: {' '.join(case.words)}\n{failure}\n{trace}", errors="replace")
        print(f"{place}: {case.kind}: {failure}", flush=True)

    def summary(self) -> str:
        """What was tried and found."""
        kinds = sorted({kind for kind, _ in self.codes})
        parts = [f"{kind} {self.codes[kind, 0]} done, {self.codes[kind, 2]} refused" for kind in kinds]
        head = f"{self.cases} cases, {self.failed} failed ({len(self.seen)} kinds); slowest {self.slowest:.1f} s"
        return "\n  ".join([f"{head}, at most {self.most / 1e6:.0f} MB", *parts])


def main() -> int:
    """Try cases until the time is over."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--minutes", type=float, default=10.0)
    options.add_argument("--cases", type=int, default=10**9, help="at most this many")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--only", default="", choices=["", *KINDS])
    options.add_argument("--keep", type=Path, default=Path("fuzz_failures"))
    given_options = options.parse_args()
    shutil.rmtree(given_options.keep, ignore_errors=True)
    progress.EVERY_S = 1e6  # a line of progress is no part of a refusal
    tally, until = Tally(given_options.keep), time.monotonic() + 60 * given_options.minutes
    with tempfile.TemporaryDirectory() as name:
        seeds = seeds_with_diagnosis(Path(name))
    batch = given_options.seed * 10**6
    while time.monotonic() < until and tally.cases < given_options.cases:
        _tried_batch(batch, tally, seeds, given_options.only, until, given_options.cases)
        batch += 1
        print(f"{tally.cases} cases, {tally.failed} failed", file=sys.stderr, flush=True)
    print(tally.summary())
    return 1 if tally.failed else 0


def _tried_batch(number: int, tally: Tally, seeds: Seeds, only: str, until: float, most: int) -> None:
    checks = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)

    @seed(number)
    @settings(max_examples=_BATCH, deadline=None, database=None, phases=(Phase.generate,), suppress_health_check=checks)
    @given(st.randoms(use_true_random=True))
    def batch(rng: random.Random) -> None:
        if time.monotonic() < until and tally.cases < most:
            tally.add(drawn_case(rng, seeds, only), seeds)

    batch()


if __name__ == "__main__":
    sys.exit(main())
