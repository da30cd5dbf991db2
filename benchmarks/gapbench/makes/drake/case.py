"""A sealed case of this make as a pure function of its kind and seed: the files and the answer.

The answer has the form that the scorer reads (``blind-answer/2``), with these of its own: ``make`` is ``drake``,
``fine`` is what bristles and current loops of the same robot without the effect leave per joint [noise floors],
``loop`` what the loops leave of that, ``current_loop`` the time constants of these loops [s], and ``drawn_as`` names
the kind and the effects that were drawn where a case became a null for lack of a trace.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import NoCase
from .files import urdf, write_log, yaml
from .measure import BAND, Ruler, rms, size_of
from .session import LEAD
from .simulate import Run
from .sizing import Found, drawn_pair, drawn_single, quiet_setup
from .tolerance import Workshop, alike, beyond_tolerance, tolerance_columns

KINDS = ("null", "single", "pair", "outside")
ATTEMPTS = 18


@dataclass(frozen=True)
class Case:
    """A setup's given model, its recording, and the answer."""

    id: str
    urdf: str
    yaml: str
    joints: tuple[str, ...]
    log: np.ndarray
    answer: dict


def case_id(seed: int, kind: str) -> str:
    """A name that says nothing about the answer and is no name of another make."""
    return "d" + hashlib.sha256(f"drake {kind} {seed}".encode()).hexdigest()[:12]


def resolved_kind(seed: int, kind: str) -> str:
    """``mixed`` becomes ``null`` or ``single`` by the seed alone."""
    if kind == "mixed":
        return ("null", "single")[hashlib.sha256(f"{seed}".encode()).digest()[0] % 2]
    if kind not in KINDS:
        raise ValueError(f"No kind {kind!r}: there are {', '.join(KINDS)} and mixed.")
    return kind


def _log(run: Run) -> np.ndarray:
    kept = run.t >= LEAD
    t = run.t[kept] - run.t[kept][0]
    return np.column_stack([t, run.reading[kept], run.command[kept]])


def _empty(measure: Ruler, drawn_as: dict | None) -> dict:
    n = len(measure.floor)
    return {
        "truth": [],
        "outside": None,
        "paired_gap": 0.0,
        "paired_gap_per_joint": [0.0] * n,
        "gap_in_floors": [],
        "beyond_tolerance": 0.0,
        "drawn_size": 0.0,
        "alike": [],
        "drawn_as": drawn_as,
    }


def _figures(found: Found, shop: Workshop) -> dict:
    columns = tolerance_columns(shop)
    truth = [
        {"effect": e.name, "joint": e.joint, "parameters": e.parameters(s), "gap_in_floors": size_of(own)}
        for e, s, own in zip(found.effects, found.magnitudes, found.own, strict=True)
    ]
    same = [
        {"of": i, **one}
        for i, (e, own) in enumerate(zip(found.effects, found.own, strict=True))
        if not found.outside
        for one in alike(e.name, e.joint, own, shop, columns)
    ]
    first = truth[0]
    outside = {"name": first["effect"], "joint": first["joint"], "parameters": first["parameters"]}
    return {
        "truth": [] if found.outside else truth,
        "outside": outside if found.outside else None,
        "paired_gap": size_of(found.change),
        "paired_gap_per_joint": rms(found.change).tolist(),
        "gap_in_floors": [one["gap_in_floors"] for one in truth],
        "beyond_tolerance": beyond_tolerance(found.change, shop, columns),
        "drawn_size": found.wanted,
        "alike": same,
        "drawn_as": None,
    }


def _packed(seed: int, kind: str, measure: Ruler, run: Run, figures: dict) -> Case:
    setup, name = measure.setup, case_id(seed, kind)
    said = "null" if figures["drawn_as"] else kind
    answer = {
        "schema": "blind-answer/2",
        "make": "drake",
        "id": name,
        "seed": seed,
        "kind": said,
        "robot": setup.given.kind,
        "joints": list(setup.given.joints),
        "passive_joints": [],
        "effects": figures["truth"],
        **figures,
        "noise_floor": measure.floor.tolist(),
        "fine": measure.fine.tolist(),
        "loop": measure.loop.tolist(),
        "current_loop": setup.session.fine.loop.tolist(),
        "band_hz": [0.0, BAND],
        "null_kind": None if said != "null" else "no_trace" if figures["drawn_as"] else "normal",
        "inside": None,
        "rate": setup.rate,
        "torque_hold": "zoh",
        "encoder_counts": [part.counts for part in setup.given.parts],
        "reference": setup.reference,
    }
    return Case(name, urdf(setup.given), yaml(setup.given, setup.tolerance), setup.given.joints, _log(run), answer)


def _found(seed: int, kind: str, attempt: int, measure: Ruler, shop: Workshop) -> Found | None:
    rng = np.random.default_rng([0xEFFEC7, seed, KINDS.index(kind), attempt])
    return drawn_pair(rng, seed, measure, shop) if kind == "pair" else drawn_single(rng, seed, kind, measure, shop)


def _attempt(seed: int, kind: str, attempt: int) -> Case | None:
    quiet = quiet_setup(seed, KINDS.index(kind), attempt)
    if quiet is None:
        return None
    measure, base = quiet
    if kind == "null":
        return _packed(seed, kind, measure, base, _empty(measure, None))
    shop = Workshop(measure)
    found = _found(seed, kind, attempt, measure, shop)
    if found is None:
        return None
    if found.no_trace:
        drawn_as = {"kind": kind, "effects": [e.name for e in found.effects], "paired_gap": size_of(found.change)}
        return _packed(seed, kind, measure, base, _empty(measure, drawn_as))
    return _packed(seed, kind, measure, found.run, _figures(found, shop))


def draw_open(seed: int) -> tuple[Case, Ruler, Found] | None:
    """A single case with all that it hides, for another recording of the same robot; None if it is a null."""
    for attempt in range(ATTEMPTS):
        with suppress(FloatingPointError):
            quiet = quiet_setup(seed, KINDS.index("single"), attempt)
            if quiet is None:
                continue
            measure, shop = quiet[0], Workshop(quiet[0])
            found = _found(seed, "single", attempt, measure, shop)
            if found is not None and found.no_trace:
                return None
            if found is not None:
                return _packed(seed, "single", measure, found.run, _figures(found, shop)), measure, found
    return None


def draw_case(seed: int, kind: str = "mixed") -> Case:
    """The case of a seed; the same seed and kind give the same bytes."""
    kind = resolved_kind(seed, kind)
    for attempt in range(ATTEMPTS):
        # A robot that runs away, as a stiff gap may make it, is no case.
        with suppress(FloatingPointError):
            case = _attempt(seed, kind, attempt)
            if case is not None:
                return case
    raise NoCase(f"Seed {seed} gives no possible case in {ATTEMPTS} draws: use another seed.")


def write_case(case: Case, cases: Path) -> Path:
    """Writes what the diagnosis may see, and nothing else; returns the folder of the case."""
    folder = cases / case.id
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(case.urdf)
    (folder / "robot.yaml").write_text(case.yaml)
    write_log(folder / "log.csv", case.joints, case.log)
    return folder
