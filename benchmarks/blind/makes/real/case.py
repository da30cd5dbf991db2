"""Draws a sealed case of this make from its kind and seed; equal recordings give equal cases.

The answer has the scorer's format (``blind-answer/2``) and two more keys: ``context`` is the diagnosis of the same part
without an added effect (see `context_of`), and ``part`` states how the recording was cut.
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
SMALLEST, LARGEST = 1.0, 30.0  # range of the wanted gaps [noise floors]
WIDER = 2.0  # low pass of the motion for the laws, in judged bands: wider, so that it does not cut inside the band
SWING = 2.0  # length of the low pass's transients at the ends of a log, in periods of its edge
CUTS = 8  # number of ways to cut a recording to which an effect is added; nulls may use more


@dataclass(frozen=True)
class Case:
    """A recorded robot, the model for part two, its logs and the answer."""

    source: Source
    corrected: str
    runs: Rows
    answer: dict


@dataclass(frozen=True)
class Part:
    """Part two of a recording, and the results of both parts.

    Attributes:
        source: The recorded robot.
        which: Number of the cut, see `parts`.
        edge: Time that is excluded at both ends of every log [s].
        first: Results of part one: the corrected model.
        null: Diagnosis of part two without an added effect.
        ruler: Measures effects in part two, with the ends of its logs.
    """

    source: Source
    which: int
    edge: float
    first: PartOne
    null: dict
    ruler: Ruler


def trimmed(runs: Rows, edge: float) -> Rows:
    """The logs of a case: without ``edge`` seconds at both ends, where filters have transients, and from time zero."""
    out = []
    for run in runs:
        inside = (run.t >= run.t[0] + edge) & (run.t <= run.t[-1] - edge)
        out.append(Run(run.t[inside] - run.t[inside][0], run.q[inside], run.tau[inside]))
    return tuple(out)


def case_id(seed: int, kind: str) -> str:
    """An id that does not reveal the answer and that no other make uses."""
    return "r" + hashlib.sha256(f"real {kind} {seed}".encode()).hexdigest()[:12]


def resolved_kind(seed: int, kind: str) -> str:
    """The kind itself, or for ``mixed`` either ``null`` or ``single``, chosen by the seed."""
    if kind == "mixed":
        return ("null", "single")[hashlib.sha256(f"real {seed}".encode()).digest()[0] % 2]
    if kind not in KINDS:
        raise ValueError(f"No kind {kind!r}: there are {', '.join(KINDS)} and mixed.")
    return kind


@lru_cache(maxsize=2)
def part(place: int, which: int) -> Part:
    """Part two of a recording, from the number of its source and the number of the cut."""
    source = SOURCES[place]()
    one, two = parts(source, which)
    first = corrected_by(source, one)
    high = min(WIDER * first.band, *(0.4 / float(np.median(np.diff(run.t))) for run in two))
    grids = tuple(even(run, high) for run in two)
    # The corrected URDF gives better torques of the links than the given model, even if it cannot hold all corrections.
    robot = body(first.urdf or source.urdf, source.yaml, source.joints)
    null = null_diagnosis(source, first, trimmed(two, SWING / high))
    scene = scene_of(robot, source.joints, two, grids, float(null["band_hz"][1]))
    floor = np.array([j["rms_after"] for j in null["joints"]])
    return Part(source, which, SWING / high, first, null, ruler(scene, floor))


def _closed(known: Part, effect: Effect) -> bool:
    """True if the diagnosis without an added effect names the family of this effect at its joint."""
    return bool(places(effect.name, effect.joint) & named(known.null["findings"]))


def _target(rng: Rng) -> float:
    """A random gap [noise floors], uniform in its logarithm."""
    return float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))


def _drawn(known: Part, first: int, rng: Rng, but: Sequence[Effect] = ()) -> Sized | None:
    """The first effect, beginning with number ``first``, that this recording can show at a joint; None without one.

    Effects of families that the context or the effects ``but`` name at the same joint are skipped.
    """
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
    """Logs with two effects: the changes of torques and positions by each are added."""
    out = []
    for run, a, b in zip(known.ruler.scene.runs, one.effect.put(one.size), two.effect.put(two.size), strict=True):
        out.append(replace(run, q=a.q + b.q - run.q, tau=a.tau + b.tau - run.tau))
    return tuple(out)


def draw_case(seed: int, kind: str = "mixed") -> Case:
    """The case of a seed and a kind.

    Raises:
        FileNotFoundError: If the recording of the seed is not on this machine; the message says how to get it.
        NoCase: If the recording can show no effect of this kind.
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
    """Write the inputs of the diagnosis without the answer; return the folder of the case."""
    folder = cases / case.answer["id"]
    write_inputs(folder, case.source, case.runs, case.corrected)
    return folder
