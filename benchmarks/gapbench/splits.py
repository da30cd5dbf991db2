"""Two splits: public cases by seeds that are listed, hidden ones by seeds that only the holder of a key can make."""

from __future__ import annotations

import csv
import hashlib
import hmac
import json
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from .cases import draw
from .makes import MissingPackage, NoCase, make_named, missing
from .seal import NAME as SEALED
from .seal import decrypted, encrypted

MANIFEST = Path(__file__).with_name("public.csv")
# Of each make. In this order of shares every beginning of the list holds all kinds.
COUNTS = {"single": 30, "null": 20, "outside": 15, "pair": 10}
FIRST_SEEDS = {"single": 100_000, "null": 101_000, "pair": 102_000, "outside": 103_000}
NEXT_SEED = 500  # added where a seed gives no case
TRIES = 5
# The sums of the list are of files made with these; others round otherwise. So do processors, where a simulated robot
# sticks and slides: a case has a sum if two kernels of linear algebra (Haswell, SkylakeX) make the same files.
SUMS_WITH = {"mujoco": "4.0.0", "numpy": "2.4.6", "scipy": "1.17.1"}
LEAST_KEY = 32  # characters: 128 bits as hexadecimal digits


@dataclass(frozen=True)
class Listed:
    """A case of a split: its make, kind and seed, and the sum of its files where it is known."""

    make: str
    kind: str
    seed: int
    sha256: str = ""


class SplitError(Exception):
    """A key or a folder that does not serve; the sentence says what to do."""


def kinds_in_order() -> list[tuple[str, int]]:
    """Kinds of a make's cases with their number within the kind, mixed evenly."""
    every = [(kind, i) for kind, count in COUNTS.items() for i in range(count)]
    return sorted(every, key=lambda one: ((one[1] + 0.5) / COUNTS[one[0]], one[0]))


def public_cases(makes: Sequence[str], first: int | None = None) -> list[Listed]:
    """The public cases of some makes, of each the first so many."""
    with MANIFEST.open(newline="") as file:
        rows = [Listed(r["make"], r["kind"], int(r["seed"]), r["sha256"]) for r in csv.DictReader(file)]
    return [one for make in makes for one in [r for r in rows if r.make == make][:first]]


def hidden_cases(makes: Sequence[str], key: bytes, first: int | None = None) -> list[Listed]:
    """The hidden cases that a key stands for: their seeds are its keyed hashes, 96 bits long, and cannot be guessed."""

    def seed(make: str, kind: str, i: int) -> int:
        return int.from_bytes(hmac.new(key, f"gapbench {make} {kind} {i}".encode(), hashlib.sha256).digest()[:12])

    return [Listed(make, kind, seed(make, kind, i)) for make in makes for kind, i in kinds_in_order()[:first]]


def read_key(path: Path) -> bytes:
    """The key in a file.

    Raises:
        SplitError: If it is too short to be one, or not there.
    """
    if not path.is_file():
        raise SplitError(f"There is no key in {path}: make one with 'openssl rand -hex 32 > {path}', and keep it.")
    key = path.read_bytes().strip()
    if len(key) < LEAST_KEY:
        raise SplitError(f"The key in {path} has {len(key)} characters: take {LEAST_KEY} or more, drawn at random.")
    return key


def sum_of(case: Path) -> str:
    """SHA-256 over names and contents of the files of a case."""
    out = hashlib.sha256()
    for path in sorted(case.iterdir()):
        out.update(path.name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return out.hexdigest()


def _drawn(listed: Listed, cases: Path, answers: Path) -> tuple[str, str]:
    """Id of a case and an empty text, or an empty id and why there is none."""
    make, said = make_named(listed.make), ""
    for attempt in range(TRIES):
        try:
            return draw(listed.seed + NEXT_SEED * attempt, listed.kind, cases, answers, make), ""
        except MissingPackage as reason:
            return "", str(reason)
        except NoCase as reason:
            said = str(reason)
    return "", said


def draw_listed(listed: Sequence[Listed], folder: Path, jobs: int = 1) -> tuple[list[str], list[str]]:
    """Draws cases into ``cases`` and ``answers`` of a folder, skipping those that are there.

    Returns:
        Ids of the cases, and a sentence for each thing that was left out or differs from the list.
    """
    absent = {make: why for make in dict.fromkeys(one.make for one in listed) if (why := missing(make))}
    wanted = [one for one in listed if one.make not in absent]
    work = partial(_drawn, cases=folder / "cases", answers=folder / "answers")
    if jobs == 1:
        done = list(map(work, wanted))
    else:
        with ProcessPoolExecutor(jobs) as pool:
            done = list(pool.map(work, wanted))
    said = [*absent.values(), *dict.fromkeys(why for _, why in done if why)]
    other = [
        name
        for one, (name, _) in zip(wanted, done, strict=True)
        if name and one.sha256 and sum_of(folder / "cases" / name) != one.sha256
    ]
    if other:
        said.append(
            f"The files of {len(other)} cases are not those of the list, first {other[0]}: say so beside a score; the "
            f"list was made with {', '.join(f'{name} {version}' for name, version in SUMS_WITH.items())}; other "
            "versions round otherwise."
        )
    return [name for name, _ in done if name], said


def seal_answers(folder: Path, key: bytes) -> Path:
    """Puts the answers of a folder into one file that opens with the key alone, and takes the readable ones away."""
    answers = folder / "answers"
    texts = {path.name: path.read_text() for path in sorted(answers.glob("*.json"))}
    closed = folder / SEALED
    if closed.is_file():
        texts = {**_opened(closed, key), **texts}
    closed.write_bytes(encrypted(json.dumps(texts).encode(), key))
    for path in answers.glob("*.json"):
        path.unlink()
    answers.rmdir()
    return closed


def _opened(closed: Path, key: bytes) -> dict[str, str]:
    try:
        return json.loads(decrypted(closed.read_bytes(), key))
    except ValueError as error:
        raise SplitError(str(error)) from error


def truths(folder: Path, key: bytes | None = None) -> list[dict]:
    """What the generator wrote of each case in a folder that `draw_listed` filled, in the order of their ids.

    Raises:
        SplitError: If there is none, or they are sealed and there is no key that opens them.
    """
    closed = folder / SEALED
    if closed.is_file() and key is None:
        raise SplitError(f"The answers in {closed} are sealed: only who has the key can score, see --key-file.")
    texts: Iterable[str]
    if closed.is_file() and key is not None:
        opened = _opened(closed, key)
        texts = [opened[name] for name in sorted(opened)]
    else:
        texts = [path.read_text() for path in sorted((folder / "answers").glob("*.json"))]
    out = [json.loads(text) for text in texts]
    if not out:
        raise SplitError(f"There are no answers in {folder}: draw the cases with 'gapbench draw public {folder}'.")
    return out
