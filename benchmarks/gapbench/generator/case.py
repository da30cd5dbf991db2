"""A sealed case as a pure function of its kind and seed: what the diagnosis is given, and the answer.

Case folder: ``robot.urdf``, ``robot.yaml``, ``log.csv`` (`FILES`). Answer: ``<id>.json``, SI units, joint side:

``schema``
    ``blind-answer/2``.
``id``, ``seed``, ``kind``
    Kind is ``null``, ``single``, ``pair`` or ``outside``.
``robot``, ``joints``, ``passive_joints``
    ``pendulum``, ``planar2``, ``spatial3``, ``phantom``, ``six``, ``panda``; its active and its passive joints.
``truth`` (``effects`` is the same list)
    Findings: ``effect``, ``joint`` (a name; null for the whole robot; ``j2+j3`` for a coupling), ``parameters`` as in
    the contract, and ``gap_in_floors``: root mean square of the paired difference to the same run without this effect,
    over time and the joints it reaches. Empty for nulls and for causes outside the catalogue.
``outside``
    null, or the cause outside the catalogue: ``name`` (``friction_warm_up``, ``shaker``, ``soft_contact``,
    ``voltage_sag``, ``drifting_offset``), ``joint`` (null: all), ``parameters``.
``paired_gap``, ``paired_gap_per_joint``, ``gap_in_floors``
    Difference to the run without anything wrong [noise floors], over the joints reached and for each active joint; the
    list of the findings' own gaps (of the cause, for an outside case). 0 and [] for a null.
``beyond_tolerance``, ``drawn_size``
    What of the gap moves of the model within two tolerances cannot explain; the size that was asked for.
``noise_floor``, ``band_hz``
    Per active joint [N m], and the band in which all this is measured.
``alike``
    One list of ``{effect, joint, leaves}`` for single cases; for pairs each entry also has ``of``, the index in
    ``truth`` of the effect that it stands in for: what this recording cannot part from that effect.
``null_kind``, ``inside``
    Of a null: ``normal`` (draws of the tolerance), ``full`` (even draws over the whole of it) or ``effect_inside``,
    with the effect that stays inside the tolerance as ``{effect, joint}``.
``rate``, ``torque_hold``, ``encoder_counts``, ``reference``
    Of the recording.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..makes import NoCase
from .drawing import draw_cause, draw_pair, draw_single
from .effects import SINGLE_EFFECTS, Effect, joint_name, stated_parameters
from .files import robot_yaml, urdf_text
from .outside import NAMES
from .rivals import alike
from .robots import Tolerance
from .setup import (
    CODES,
    TRIES_PER_ROBOT,
    Setup,
    draw_setup,
    generators,
    logged_torque,
    run_of,
    tracks,
)
from .simulate import Run
from .sizing import BAND, Ruler, noise_floor, rms, ruler, size_of

T = TypeVar("T")

KINDS = tuple(CODES)
NULL_KINDS = ("normal", "full", "effect_inside")
INSIDE = ("viscous_friction", "coulomb_friction", "rotor_inertia", "inertial_parameters")
NEARLY_ALL = (1.6, 2.0)  # sigmas: how far an effect goes that stays inside the tolerance
ATTEMPTS = 8 * TRIES_PER_ROBOT


@dataclass(frozen=True)
class Case:
    """Files of a case and its answer."""

    id: str
    urdf: str
    yaml: str
    header: tuple[str, ...]
    log: np.ndarray
    answer: dict


def case_id(seed: int, kind: str) -> str:
    """A name that says nothing about the answer."""
    return "c" + hashlib.sha256(f"sealed case {seed} {kind}".encode()).hexdigest()[:12]


def resolved_kind(seed: int, kind: str) -> str:
    """``mixed`` becomes ``null`` or ``single`` with equal chance, by the seed alone."""
    if kind == "mixed":
        return ("null", "single")[int(np.random.default_rng([seed, 0]).integers(2))]
    if kind not in KINDS:
        raise ValueError(f"No kind {kind!r}: there are {', '.join(KINDS)} and mixed.")
    return kind


def _entry(effect: Effect, change: np.ndarray, setup: Setup) -> dict:
    return {
        "effect": effect.effect,
        "joint": joint_name(effect, setup.owner),
        "parameters": stated_parameters(effect),
        "gap_in_floors": size_of(change),
    }


def _figures(change: np.ndarray, measure: Ruler, size: float) -> dict:
    return {
        "drawn_size": size,
        "paired_gap": size_of(change),
        "paired_gap_per_joint": rms(change).tolist(),
        "beyond_tolerance": measure.beyond_tolerance(change),
        "noise_floor": measure.floor.tolist(),
    }


def _single(seed: int, rng: np.random.Generator, setup: Setup, measure: Ruler) -> tuple[Run, dict] | None:
    # By the seed and not drawn: a block of seeds then holds every effect equally often.
    drawn = draw_single(rng, SINGLE_EFFECTS[seed % len(SINGLE_EFFECTS)], setup, measure)
    if drawn is None:
        return None
    effect, found, size = drawn
    truth = [_entry(effect, found.change, setup)]
    return found.run, {
        "truth": truth,
        **_figures(found.change, measure, size),
        "alike": alike(effect, found.change, measure),
    }


def _pair(seed: int, rng: np.random.Generator, setup: Setup, measure: Ruler) -> tuple[Run, dict] | None:
    drawn = draw_pair(rng, SINGLE_EFFECTS[seed % len(SINGLE_EFFECTS)], setup, measure)
    if drawn is None:
        return None
    effects, found, own, size = drawn
    same = [
        {"of": i, **one}
        for i, (effect, change) in enumerate(zip(effects, own, strict=True))
        for one in alike(effect, change, measure)
    ]
    truth = [_entry(effect, change, setup) for effect, change in zip(effects, own, strict=True)]
    return found.run, {"truth": truth, **_figures(found.change, measure, size), "alike": same}


def _outside(seed: int, rng: np.random.Generator, setup: Setup, measure: Ruler) -> tuple[Run, dict] | None:
    drawn = draw_cause(rng, NAMES[seed % len(NAMES)], setup, measure)
    if drawn is None:
        return None
    cause, found, size = drawn
    joint = None if cause.joint < 0 else setup.owner.links[cause.joint].joint
    outside = {"name": cause.name, "joint": joint, "parameters": dict(cause.parameters)}
    figures = _figures(found.change, measure, size)
    return found.run, {"truth": [], "outside": outside, **figures, "gap_in_floors": [figures["paired_gap"]]}


def _inside(rng: np.random.Generator, setup: Setup) -> tuple[Setup, dict]:
    """The setup with one modelled quantity of one link moved by nearly the whole tolerance: no gap by definition."""
    name, i, tolerance = str(rng.choice(INSIDE)), int(rng.choice(setup.owner.active)), setup.tolerance
    mine, true, sigmas = setup.owner.links[i], setup.truth.links[i], rng.uniform(*NEARLY_ALL)
    if name == "viscous_friction":
        true = replace(true, viscous=mine.viscous * (1.0 + sigmas * tolerance.friction))
    elif name == "coulomb_friction":
        true = replace(true, coulomb=mine.coulomb * (1.0 + sigmas * tolerance.friction))
    elif name == "rotor_inertia":
        true = replace(true, rotor_inertia=mine.rotor_inertia * (1.0 + sigmas * tolerance.rotor_inertia))
    else:
        factor = 1.0 + sigmas * tolerance.inertia * float(rng.choice((-1.0, 1.0)))
        true = replace(true, mass=mine.mass * factor, inertia=tuple(factor * x for x in mine.inertia))
    return replace(setup, truth=setup.truth.with_link(i, true)), {"effect": name, "joint": mine.joint}


def _null(seed: int, attempt: int, robot: str | None, slow: bool) -> Case | None:
    kind = NULL_KINDS[seed // 6 % len(NULL_KINDS)]
    setup, inside = draw_setup(seed, attempt, kind="null", robot=robot, full=kind == "full", slow=slow), None
    if kind == "effect_inside":
        setup, inside = _inside(np.random.default_rng([seed, CODES["null"], attempt, 9]), setup)
    run = run_of(setup)
    if not tracks(run, setup):
        return None
    floor = noise_floor(setup.owner, setup.session, run)
    figures = {"truth": [], "paired_gap": 0.0, "paired_gap_per_joint": [0.0] * len(floor), "beyond_tolerance": 0.0}
    said = {"noise_floor": floor.tolist(), "alike": [], "null_kind": kind, "inside": inside}
    return _packed(seed, "null", setup, run, {**figures, **said})


def _gap(seed: int, kind: str, attempt: int, robot: str | None, slow: bool) -> tuple[Case, Case] | None:
    outside = NAMES[seed % len(NAMES)] if kind == "outside" else ""
    setup = draw_setup(seed, attempt, kind=kind, robot=robot, outside=outside, slow=slow)
    without = run_of(setup)
    if not tracks(without, setup):
        return None
    measure = ruler(setup.owner, setup.truth, setup.tolerance, setup.session, without)
    draw = {"single": _single, "pair": _pair, "outside": _outside}[kind]
    found = draw(seed, generators(seed, kind, attempt + 1000, "effect")["effect"], setup, measure)
    if found is None:
        return None
    run, figures = found
    return _packed(seed, kind, setup, run, figures), _packed(seed, kind, setup, without, figures)


def draw_case(seed: int, kind: str = "mixed", *, robot: str | None = None, slow: bool = False) -> Case:
    """The case of a seed; the same seed and kind give the same bytes.

    Args:
        seed: Of the case.
        kind: Of `KINDS`, or mixed.
        robot: In place of the seed's, for trials.
        slow: Moves as people record them by hand.

    Raises:
        NoCase: If the seed gives none.
    """
    kind = resolved_kind(seed, kind)
    if kind != "null":
        return with_and_without(seed, kind, robot=robot, slow=slow)[0]
    nulls = (_null(seed, attempt, robot, slow) for attempt in range(ATTEMPTS))
    return _first(nulls, seed)


def with_and_without(seed: int, kind: str, *, robot: str | None = None, slow: bool = False) -> tuple[Case, Case]:
    """A case that is no null, and the same motion, noise and encoders without what is wrong with the robot.

    Args:
        seed: Of the case.
        kind: ``single``, ``pair`` or ``outside``.
        robot: In place of the seed's, for trials.
        slow: Moves as people record them by hand.

    Raises:
        NoCase: If the seed gives none.
    """
    return _first((_gap(seed, kind, attempt, robot, slow) for attempt in range(ATTEMPTS)), seed)


def _first(drawn: Iterable[T | None], seed: int) -> T:
    """The first draw that gives something."""
    for one in drawn:
        if one is not None:
            return one
    raise NoCase(f"Seed {seed} gives no possible case in {ATTEMPTS} draws: use another seed.")


def _packed(seed: int, kind: str, setup: Setup, run: Run, figures: dict) -> Case:
    owner, session = setup.owner, setup.session
    joints, name = owner.joints, case_id(seed, kind)
    answer = {
        "schema": "blind-answer/2",
        "id": name,
        "seed": seed,
        "kind": kind,
        "robot": owner.name,
        "joints": list(joints),
        "passive_joints": [passive for passive, _ in owner.passive],
        "effects": figures["truth"],
        "outside": None,
        "gap_in_floors": [one["gap_in_floors"] for one in figures["truth"]],
        "alike": [],
        **figures,
        "band_hz": [0.0, BAND],
        "rate": session.rate,
        "torque_hold": setup.torque_hold,
        "encoder_counts": session.encoder_counts,
        "reference": setup.reference_kind,
    }
    header = ("t", *(f"q.{j}" for j in joints), *(f"tau.{j}" for j in joints))
    log = np.column_stack([run.t, run.measured, logged_torque(run, setup.torque_hold)])
    tolerance: Tolerance = setup.tolerance
    yaml = robot_yaml(owner, torque_hold=setup.torque_hold, encoder_counts=session.encoder_counts, tolerance=tolerance)
    return Case(name, urdf_text(owner), yaml, header, log, answer)


def write_case(case: Case, cases: Path) -> Path:
    """Writes what the diagnosis may see, and nothing else; returns the folder of the case."""
    folder = cases / case.id
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(case.urdf)
    (folder / "robot.yaml").write_text(case.yaml)
    np.savetxt(folder / "log.csv", case.log, fmt="%.10g", delimiter=",", header=",".join(case.header), comments="")
    return folder
