"""Kill runs at random moments, and check that only complete files of one run remain, and no process.

    python benchmarks/kills.py --kills 200 --seed 1

Half of the kills are SIGTERM and half SIGKILL, sent to the main process alone; every fourth run is ``--each`` with two
workers. Half of the moments are random over a whole run, the others within 30 ms after the first trace of a file that
is being written. After each kill the folder must contain the files of one finished run and the user's own file, and no
process of the killed run may live on; after every tenth kill a complete run must leave only its own files.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from identification.files import MARK
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

CHECKOUT = Path(__file__).resolve().parents[1]
ROBOT = CHECKOUT / "tests" / "robots" / "pendulum.urdf"
ALWAYS = {"diagnosis.json", "report.html", "corrected.yaml"}
NEXT_RUN_AFTER = 10  # number of kills between two complete runs
_OUTLIVES_S = 3.0  # a worker checks every 0.2 s whether its parent lives
_MINE = "what I noted\n"


@dataclass
class Tally:
    """What was done, and what was wrong afterwards."""

    kills: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    while_writing: int = 0
    finished_before: int = 0
    next_runs: int = 0

    def summary(self) -> str:
        """All counts in one line."""
        kinds = ", ".join(f"{count} {name}" for name, count in sorted(self.kills.items()))
        broken = Counter(line.split(":")[0] for line in self.wrong)
        found = ", ".join(f"{broken[kind]} {kind}" for kind in ("broken", "mixed", "litter", "orphan"))
        return (
            f"{sum(self.kills.values())} kills ({kinds}; {self.while_writing} while files were being written, "
            f"{self.finished_before} after the end), {self.next_runs} next runs: {found}"
        )


def write_log(path: Path, seed: int) -> None:
    """A recording of the pendulum with more friction than its model."""
    robot, rng = load_robot(ROBOT), np.random.default_rng(seed)
    t = np.arange(800) / 100.0
    w, phase = rng.uniform(1.0, 6.0, 4), rng.uniform(0, 6.28, 4)
    angle = np.outer(t, w) + phase
    q, v, a = (0.3 * x.sum(axis=1)[:, None] for x in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    motion = Motion(t, q, v, a)
    tau = inverse_dynamics(robot, motion) + 0.4 * np.sign(motion.v) + 0.01 * rng.standard_normal((800, 1))
    rows = np.column_stack([t, motion.q, tau])
    np.savetxt(path, rows, delimiter=",", header="t,q.pin,tau.pin", comments="")


def command(folder: Path, each: bool) -> list[str]:
    """Diagnose one recording into ``out``, or two by two workers into ``all``."""
    words = [sys.executable, "-m", "identification.cli", "diagnose", str(ROBOT), str(folder / "a.csv")]
    if each:
        return [*words, str(folder / "b.csv"), "--each", "--jobs", "2", "--out", str(folder / "all")]
    return [*words, "--out", str(folder / "out")]


def started(folder: Path, each: bool, token: str) -> subprocess.Popen[bytes]:
    """Start the command; a token in the environment identifies all processes that it starts."""
    environment = {**os.environ, "PHANTOM_DYN_KILLS": token, "TMPDIR": str(folder / "tmp")}
    nowhere = subprocess.DEVNULL
    return subprocess.Popen(command(folder, each), env=environment, stdout=nowhere, stderr=nowhere, cwd=CHECKOUT)


def alive(token: str) -> list[int]:
    """Processes with a token."""
    found = []
    for place in Path("/proc").glob("[0-9]*/environ"):
        try:
            if f"PHANTOM_DYN_KILLS={token}\0".encode() in place.read_bytes():
                found.append(int(place.parent.name))
        except OSError:
            continue
    return found


def run_of(path: Path) -> str | None:
    """The run to which a file belongs, or None."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".json":
        return json.loads(text)["run"]
    pattern = r"([0-9a-f]{32})\n$" if path.suffix == ".csv" else r"run: ([0-9a-f]{32})(?: -->)?\n$"
    found = re.search(pattern, text)
    return None if found is None else found.group(1)


def wrong_set(folder: Path) -> list[str]:
    """What is wrong with the files of one diagnosis; a folder that does not exist yet is right."""
    if not folder.exists():
        return []
    files = {path.name: path for path in folder.iterdir() if not path.name.startswith(".") and path.name != "mine.txt"}
    if not files:
        return []
    if not set(files) >= ALWAYS:
        return [f"broken: {folder.name} lacks {', '.join(sorted(ALWAYS - set(files)))}"]
    try:
        index = json.loads(files["diagnosis.json"].read_text())
        runs = {name: run_of(path) for name, path in files.items() if name != "next.csv"}
    except (ValueError, KeyError) as error:
        return [f"broken: {folder.name}: {error}"]
    if "next.csv" in files:
        digest = hashlib.sha256(files["next.csv"].read_bytes()).hexdigest()
        runs["next.csv"] = index["run"] if index["next_experiment"].get("reference_sha256") == digest else "another"
    other = sorted(name for name, run in runs.items() if run != index["run"])
    return [f"mixed: {folder.name}: {', '.join(other)} are not of the run of diagnosis.json"] if other else []


def wrong_tables(folder: Path) -> list[str]:
    """What is wrong with the tables of ``--each``, and with the folders beside them."""
    out = [line for inner in sorted(folder.glob("[ab]")) for line in wrong_set(inner)]
    tables = [folder / name for name in ("diagnoses.json", "diagnoses.csv")]
    if not all(path.exists() for path in tables):
        return out + [f"broken: {path.name} is alone" for path in tables if path.exists()]
    rows = json.loads(tables[0].read_text())["recordings"]
    runs = [row["diagnosis"]["run"] for row in rows]
    listed = [line.rpartition(",")[2] for line in tables[1].read_text().splitlines()[1:]]
    return out if runs == listed else [*out, "mixed: the tables are of different runs"]


def wrong_state(folder: Path) -> list[str]:
    """What is wrong with all files of the user and of the runs."""
    out = [*wrong_set(folder / "out"), *wrong_tables(folder / "all")]
    mine = folder / "out" / "mine.txt"
    if (folder / "out").exists() and (not mine.exists() or mine.read_text() != _MINE):
        out.append("broken: the user's own file is gone")
    return out


def litter(folder: Path) -> list[str]:
    """Temporary files and folders that remain, of this project or of a library."""
    ours = [path for path in folder.rglob("*") if MARK in path.name or path.name.startswith(".")]
    return [f"litter: {path.relative_to(folder)}" for path in (*ours, *(folder / "tmp").iterdir())]


def prepared(folder: Path) -> float:
    """Write recordings, a finished run of each kind and a file of the user; return the duration of a run [s]."""
    (folder / "tmp").mkdir()
    for seed, name in enumerate(("a.csv", "b.csv")):
        write_log(folder / name, seed)
    (folder / "out").mkdir()
    (folder / "out" / "mine.txt").write_text(_MINE)
    for each in (True, False):
        if started(folder, each, "first").wait() != 0:
            raise SystemExit("a run that nobody disturbs fails")
    begun = time.monotonic()
    started(folder, False, "second").wait()
    return time.monotonic() - begun


def kill_one(folder: Path, rng: random.Random, seconds: float, tally: Tally, each: bool) -> None:
    """Start a run, kill it at a random moment, and check the files and processes that remain."""
    token, number = f"{rng.getrandbits(64):x}", rng.choice((signal.SIGTERM, signal.SIGKILL))
    child = started(folder, each, token)
    length = seconds * (1.6 if each else 1.1)
    if rng.random() < 0.5:
        time.sleep(rng.uniform(0.0, length))
    else:
        wait_for_writing(folder, child)
        time.sleep(rng.uniform(0.0, 0.03))
    tally.while_writing += bool(_traces(folder))
    if child.poll() is not None:
        tally.finished_before += 1
    child.send_signal(number)
    child.wait()
    tally.kills[f"{signal.Signals(number).name}{' --each' if each else ''}"] += 1
    until = time.monotonic() + _OUTLIVES_S
    while (left := alive(token)) and time.monotonic() < until:
        time.sleep(0.05)
    tally.wrong += [f"orphan: process {one} {_OUTLIVES_S:.0f} s after {number.name}" for one in left]
    for one in left:
        os.kill(one, signal.SIGKILL)
    tally.wrong += wrong_state(folder)


def _traces(folder: Path) -> list[str]:
    """Names of temporary files that are being written."""
    return [entry.name for place in (folder, folder / "all") for entry in os.scandir(place) if MARK in entry.name]


def wait_for_writing(folder: Path, child: subprocess.Popen[bytes]) -> None:
    """Wait until a new temporary file shows that the run is writing, or the run has ended."""
    before = set(_traces(folder))
    while child.poll() is None and set(_traces(folder)) <= before:
        time.sleep(0.0005)


def next_run(folder: Path, tally: Tally) -> None:
    """Complete runs, after which only their files may exist."""
    for each in (False, True):
        if started(folder, each, "next").wait() != 0:
            tally.wrong.append("broken: the next run fails")
    tally.next_runs += 1
    tally.wrong += [*wrong_state(folder), *litter(folder)]


def killed(count: int, seed: int, folder: Path) -> Tally:
    """Kill a number of runs in an empty folder."""
    rng, tally = random.Random(seed), Tally()
    seconds = prepared(folder)
    for k in range(count):
        kill_one(folder, rng, seconds, tally, each=k % 4 == 3)
        if (k + 1) % NEXT_RUN_AFTER == 0 or k + 1 == count:
            next_run(folder, tally)
    return tally


def main() -> int:
    """Kill runs and print what was wrong afterwards."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        tally = killed(options.kills, options.seed, Path(name))
    for line in tally.wrong:
        print(line)
    print(tally.summary())
    return 1 if tally.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
