"""A sealed case of this make as a pure function of its kind and seed, given the recordings.

The answer has the form that the scorer reads (``blind-answer/2``), with ``context``: what the diagnosis of the same
part says while nothing has been added (see `context_of`), and ``part``: which recording, and how it was cut.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.blind.makes.real.body import body
from benchmarks.blind.makes.real.context import context_of, named, places
from benchmarks.blind.makes.real.given import PartOne, corrected_by, null_diagnosis, write_inputs
from benchmarks.blind.makes.real.laws import EFFECTS
from benchmarks.blind.makes.real.motion import even
from benchmarks.blind.makes.real.outside import CAUSES
from benchmarks.blind.makes.real.recordings import SOURCES, Run, Source, parts
from benchmarks.blind.makes.real.rivals import alike
from benchmarks.blind.makes.real.scene import Effect, Rng, Rows, scene_of
from benchmarks.blind.makes.real.sizing import Ruler, Sized, beyond_tolerance, change, each, ruler, sized
from benchmarks.gapbench.makes import NoCase
from benchmarks.gapbench.makes.plain_numbers import plain

Array = np.ndarray
KINDS = ("null", "single", "pair", "outside")
SMALLEST, LARGEST = 1.0, 30.0  # sizes that are asked for [noise floors]
WIDER = 2.0  # times the judged band: what laws are computed from is not cut where it is judged
SWING = 2.0  # periods of that: how long a low pass swings at the ends of a log
CUTS = 8  # ways to cut a recording that an effect is put into; nulls take every one


@dataclass(frozen=True)
class Case:
    """A recorded robot, the model for part two, its logs and the answer."""

    source: Source
    corrected: str
    runs: Rows
    answer: dict


@dataclass(frozen=True)
class Part:
    """Part two of a recording with everything that is known of it.

    Attributes:
        source: Whose it is.
        which: How it was cut.
        edge: What is left out at both ends of every log [s].
        first: What part one says.
        null: Diagnosis of the logs with nothing added.
        ruler: Of the logs, their ends included.
    """

    source: Source
    which: int
    edge: float
    first: PartOne
    null: dict
    ruler: Ruler


def trimmed(runs: Rows, edge: float) -> Rows:
    """The logs as they are written: without a time at both ends [s], where filters swing; times from zero on."""
    out = []
    for run in runs:
        inside = (run.t >= run.t[0] + edge) & (run.t <= run.t[-1] - edge)
        out.append(Run(run.t[inside] - run.t[inside][0], run.q[inside], run.tau[inside]))
    return tuple(out)


def case_id(seed: int, kind: str) -> str:
    """A name that says nothing about the answer and is no name of another make."""
    return "r" + hashlib.sha256(f"real {kind} {seed}".encode()).hexdigest()[:12]


def resolved_kind(seed: int, kind: str) -> str:
    """``mixed`` becomes ``null`` or ``single`` by the seed alone."""
    if kind == "mixed":
        return ("null", "single")[hashlib.sha256(f"real {seed}".encode()).digest()[0] % 2]
    if kind not in KINDS:
        raise ValueError(f"No kind {kind!r}: there are {', '.join(KINDS)} and mixed.")
    return kind


@lru_cache(maxsize=2)
def part(place: int, which: int) -> Part:
    """Part two of a recording: the number of its source, and of the cut."""
    source = SOURCES[place]()
    one, two = parts(source, which)
    first = corrected_by(source, one)
    high = min(WIDER * first.band, *(0.4 / float(np.median(np.diff(run.t))) for run in two))
    grids = tuple(even(run, high) for run in two)
    # Of what the correction can say in a URDF the links' torques are better than those of the given model.
    robot = body(first.urdf or source.urdf, source.yaml, source.joints)
    null = null_diagnosis(source, first, trimmed(two, SWING / high))
    scene = scene_of(robot, source.joints, two, grids, float(null["band_hz"][1]))
    floor = np.array([j["rms_after"] for j in null["joints"]])
    return Part(source, which, SWING / high, first, null, ruler(scene, floor))


def _closed(known: Part, effect: Effect) -> bool:
    """Whether the family of an effect is named at its joint while nothing has been added."""
    return bool(places(effect.name, effect.joint) & named(known.null["findings"]))


def _target(rng: Rng) -> float:
    return float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))


def _drawn(known: Part, first: int, rng: Rng, but: Sequence[Effect] = ()) -> Sized | None:
    """The first effect, from a number on, that this recording can show at some joint; None where there is none."""
    scene, taken = known.ruler.scene, frozenset().union(*(places(e.name, e.joint) for e in but))
    for k in range(len(EFFECTS)):
        law, target = EFFECTS[(first + k) % len(EFFECTS)], _target(rng)
        for j in rng.permutation(scene.n):
            effect = law(scene, int(j), rng)
            if effect is None or _closed(known, effect) or places(effect.name, effect.joint) & taken:
                continue
            found = sized(known.ruler, effect, target)
            if found is not None:
                return found
    return None


def _entry(one: Sized, share: float) -> dict:
    return {
        "effect": one.effect.name,
        "joint": one.effect.joint,
        "parameters": plain(one.effect.parameters(one.size)),
        "gap_in_floors": share,
    }


def _packed(seed: int, kind: str, known: Part, runs: Rows, parts_of: Sequence[Sized], outside: Sized | None) -> Case:
    source, by = known.source, known.ruler
    changed, logs = change(by, by.scene.runs, runs), trimmed(runs, known.edge)
    truth = [_entry(one, one.gap) for one in parts_of]
    cause = None if outside is None else {"name": outside.effect.name, **_entry(outside, outside.gap)}
    sizes = [one.gap for one in parts_of] or ([outside.gap] if outside else [])
    answer = {
        "schema": "blind-answer/2",
        "make": "real",
        "id": case_id(seed, kind),
        "seed": seed,
        "kind": kind,
        "robot": f"real_{source.name}",
        "joints": list(source.joints),
        "passive_joints": [],
        "effects": truth,
        "truth": truth,
        "outside": cause,
        "alike": [{"of": i, **same} for i, one in enumerate(parts_of) for same in alike(by, one)],
        "paired_gap": min(sizes, default=0.0),
        "paired_gap_per_joint": each(by, changed).tolist(),
        "gap_in_floors": [one.gap for one in parts_of],
        "beyond_tolerance": beyond_tolerance(by, changed) if sizes else 0.0,
        "noise_floor": by.floor.tolist(),
        "band_hz": [0.0, by.scene.band],
        "part": {"which": known.which, "runs": len(logs), "seconds": float(sum(run.t[-1] for run in logs))},
        "context": context_of(known.null, known.first.diagnosis),
    }
    return Case(source, known.first.corrected, logs, answer)


def _both(known: Part, one: Sized, two: Sized) -> Rows:
    """Both effects in one log: torques and readings that each changes are added."""
    out = []
    for run, a, b in zip(known.ruler.scene.runs, one.effect.put(one.size), two.effect.put(two.size), strict=True):
        out.append(replace(run, q=a.q + b.q - run.q, tau=a.tau + b.tau - run.tau))
    return tuple(out)


def draw_case(seed: int, kind: str = "mixed") -> Case:
    """The case of a seed and a kind.

    Raises:
        FileNotFoundError: If the recording of the seed is not on this machine; says how to get it.
        NoCase: If no effect fits into its part.
    """
    kind = resolved_kind(seed, kind)
    place, which = seed % len(SOURCES), seed // len(SOURCES)
    rng = np.random.default_rng([0x4EA1, KINDS.index(kind), seed])
    known = part(place, which if kind == "null" else which % CUTS)
    if kind == "null":
        return _packed(seed, kind, known, known.ruler.scene.runs, (), None)
    if kind == "outside":
        law, joints = CAUSES[(seed + which) % len(CAUSES)], rng.permutation(known.ruler.scene.n)
        found = sized(known.ruler, law(known.ruler.scene, int(joints[0]), rng), _target(rng), judged=False)
        if found is not None:
            return _packed(seed, kind, known, found.effect.put(found.size), (), found)
    else:
        one = _drawn(known, seed + which, rng)
        if one is not None and kind == "single":
            return _packed(seed, kind, known, one.effect.put(one.size), (one,), None)
        two = one and _drawn(known, seed + which + 1 + int(rng.integers(len(EFFECTS) - 1)), rng, (one.effect,))
        if one and two:
            return _packed(seed, kind, known, _both(known, one, two), (one, two), None)
    raise NoCase(f"Nothing of kind {kind} fits into the recording of seed {seed}: use another seed.")


def write_case(case: Case, cases: Path) -> Path:
    """Writes what the diagnosis may see, and nothing else; returns the folder of the case."""
    folder = cases / case.answer["id"]
    write_inputs(folder, case.source, case.runs, case.corrected)
    return folder
