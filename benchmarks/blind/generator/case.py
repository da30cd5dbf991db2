"""A sealed case as a pure function of its kind and seed: what the diagnosis is given, and the answer.

Case folder: ``robot.urdf``, ``robot.yaml``, ``log.csv`` (`FILES`). Answer: ``<id>.json``, SI units, joint side:

``schema``
    ``blind-answer/2``.
``id``, ``seed``, ``kind``
    Kind is ``null``, ``single``, ``pair`` or ``outside``.
``robot``, ``joints``, ``passive_joints``
    ``pendulum``, ``planar2``, ``spatial3``, ``phantom``, ``six``, ``panda``; its active and its passive joints in order.
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
    Of a null: ``normal`` (draws of the tolerance), ``full`` (even draws over the whole of it) or ``effect_inside``, with
    the effect that stays inside the tolerance as ``{effect, joint}``.
``rate``, ``torque_hold``, ``encoder_counts``, ``reference``
    Of the recording.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from benchmarks.blind.generator.effects import SINGLE_EFFECTS, Effect, draw_recipe, plant_with
from benchmarks.blind.generator.reference import KINDS, draw_reference
from benchmarks.blind.generator.rivals import alike
from benchmarks.blind.generator.robots import ROBOTS, Table, Tolerance, draw_table, perturbed, robot_yaml, urdf_text
from benchmarks.blind.generator.simulate import Run, Session, feedforward, simulate
from benchmarks.blind.generator.sizing import BAND, over_reached, paired_gap, ruler, sized

SIZES = (0.5, 16.0)  # noise floors, drawn evenly in the logarithm
NOISE = (0.01, 0.03)  # disturbance over the torque of the motion, drawn evenly in the logarithm


@dataclass(frozen=True)
class Setup:
    """A robot, its model and a session, before any effect.

    Attributes:
        owner: The model that the diagnosis is given.
        truth: The robot that moves.
        tolerance: What the model states about itself.
        torque_hold: ``zoh`` or ``instant``, as the log is written.
        reference_kind: Of the motion.
        session: Reference, noise and encoder.
    """

    owner: Table
    truth: Table
    tolerance: Tolerance
    torque_hold: str
    reference_kind: str
    session: Session


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
    if kind not in ("null", "single"):
        raise ValueError(f"No kind {kind!r}: there are null, single and mixed.")
    return kind


def _disturbance(rng: np.random.Generator, n: int, rate: float, level: np.ndarray) -> np.ndarray:
    """Torque noise, white and first-order coloured in equal parts within the band, ``(n, nv)`` [N m]."""
    white = rng.normal(size=(n, len(level))) * np.sqrt(0.5 * rate / (2.0 * BAND))
    keep = np.exp(-2.0 * np.pi * rng.uniform(5.0, 15.0) / rate)
    coloured = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.normal(size=(n, len(level))), axis=0)
    return level * np.sqrt(0.5) * (white + coloured)


def draw_setup(seed: int, attempt: int = 0, *, robot: str | None = None, tolerance: Tolerance | None = None) -> Setup:
    """Robot, truth, motion and noise of a seed; ``attempt`` counts redraws of an impossible motion."""
    rng = {
        name: np.random.default_rng([seed, attempt, i]) for i, name in enumerate(("robot", "truth", "motion", "noise"))
    }
    tolerance = tolerance or Tolerance()
    name = robot or ROBOTS[int(rng["robot"].integers(len(ROBOTS)))]
    owner = draw_table(rng["robot"], name)
    rate = float(rng["motion"].choice((500.0, 1000.0)))
    n = round(rate * rng["motion"].uniform(18.0, 20.0))
    kind = str(rng["motion"].choice(KINDS, p=(0.25, 0.15, 0.6)))
    reference = draw_reference(rng["motion"], name, kind, np.arange(n) / rate)
    noise = rng["noise"]
    level = np.exp(noise.uniform(*np.log(NOISE))) * np.sqrt(np.mean(feedforward(owner, reference, rate) ** 2, axis=0))
    counts = 4096 * int(np.exp(noise.uniform(np.log(4), np.log(128.999))))
    hold = str(noise.choice(("zoh", "instant")))
    dither = noise.normal(size=reference.shape) * 0.2 * 2.0 * np.pi / counts
    session = Session(
        rate, reference, _disturbance(noise, n, rate, level), counts, dither, float(noise.uniform(3.0, 6.0))
    )
    return Setup(owner, perturbed(rng["truth"], owner, tolerance), tolerance, hold, kind, session)


def quiet(setup: Setup) -> Setup:
    """The same setup without any noise and with an ideal encoder."""
    session, none = setup.session, np.zeros_like(setup.session.reference)
    return replace(setup, session=replace(session, disturbance=none, dither=none, encoder_counts=0))


def run_of(setup: Setup, effect: Effect | None) -> Run:
    """The recording of the setup with the effect in the robot."""
    return simulate(plant_with(effect, setup.truth), setup.owner, setup.session)


def logged_torque(run: Run, torque_hold: str) -> np.ndarray:
    """The torque column: the held value, or at the sample itself the mean of the holds on both sides of it."""
    if torque_hold == "zoh":
        return run.command
    before = np.vstack([run.command[:1], run.command[:-1]])
    return 0.5 * (before + run.command)


def _tracks(run: Run, setup: Setup) -> bool:
    """The robot went where it was sent, and not through its joint limits."""
    error = np.abs(run.q[:-1] - setup.session.reference)
    return bool(np.isfinite(run.q).all() and error.max() < 0.6 and np.abs(run.q).max() < 3.0)


def _drawn_effect(seed: int, attempt: int, setup: Setup, without: Run) -> tuple[Effect, Run, dict] | None:
    rng = np.random.default_rng([seed, attempt, 9])
    measure = ruler(setup.owner, setup.truth, setup.tolerance, setup.session, without)
    size = float(np.exp(rng.uniform(*np.log(SIZES))))
    # By the seed and not drawn: a block of seeds then holds every effect equally often.
    effect = sized(draw_recipe(rng, SINGLE_EFFECTS[seed % len(SINGLE_EFFECTS)], setup.owner), measure, size)
    if effect is None:
        return None
    run = run_of(setup, effect)
    if not _tracks(run, setup):
        return None
    reached = rms_reached(measure.change(effect))
    gap = paired_gap(run, without, setup.truth, setup.session, measure.floor)
    figures = {
        "drawn_size": size,
        "size": measure.size(effect),
        "beyond_tolerance": measure.beyond_tolerance(effect),
        "paired_gap": over_reached(np.where(reached, gap, 0.0)),
        "paired_gap_per_joint": gap.tolist(),
        "noise_floor": measure.floor.tolist(),
        "alike": alike(effect, measure),
    }
    return effect, run, figures


def rms_reached(change: np.ndarray) -> np.ndarray:
    """Which joints a change of torque ``(n, nv)`` reaches at all."""
    return np.sqrt(np.mean(change**2, axis=0)) > 1e-6


def draw_case(seed: int, kind: str = "mixed") -> Case:
    """The case of a seed; the same seed and kind give the same bytes."""
    kind = resolved_kind(seed, kind)
    for attempt in range(20):
        setup = draw_setup(seed, attempt)
        without = run_of(setup, None)
        if not _tracks(without, setup):
            continue
        if kind == "null":
            return _packed(seed, kind, setup, without, [], {"paired_gap": 0.0})
        drawn = _drawn_effect(seed, attempt, setup, without)
        if drawn is not None:
            effect, run, figures = drawn
            joint = None if effect.effect == "payload" else setup.owner.joints[effect.joint]
            entry = {"effect": effect.effect, "joint": joint, "parameters": dict(effect.parameters)}
            return _packed(seed, kind, setup, run, [entry], figures)
    raise RuntimeError(f"Seed {seed} gives no possible case in 20 draws: use another seed.")


def _packed(seed: int, kind: str, setup: Setup, run: Run, effects: list[dict], figures: dict) -> Case:
    joints, session = setup.owner.joints, setup.session
    name = case_id(seed, kind)
    answer = {
        "schema": "blind-answer/1",
        "id": name,
        "seed": seed,
        "kind": kind,
        "robot": setup.owner.name,
        "joints": list(joints),
        "effects": effects,
        **figures,
        "band_hz": [0.0, BAND],
        "rate": session.rate,
        "torque_hold": setup.torque_hold,
        "encoder_counts": session.encoder_counts,
        "reference": setup.reference_kind,
    }
    header = ("t", *(f"q.{j}" for j in joints), *(f"tau.{j}" for j in joints))
    log = np.column_stack([run.t, run.measured, logged_torque(run, setup.torque_hold)])
    yaml = robot_yaml(
        setup.owner, torque_hold=setup.torque_hold, encoder_counts=session.encoder_counts, tolerance=setup.tolerance
    )
    return Case(name, urdf_text(setup.owner), yaml, header, log, answer)


def write_case(case: Case, cases: Path) -> Path:
    """Writes what the diagnosis may see, and nothing else; returns the folder of the case."""
    folder = cases / case.id
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(case.urdf)
    (folder / "robot.yaml").write_text(case.yaml)
    np.savetxt(folder / "log.csv", case.log, fmt="%.10g", delimiter=",", header=",".join(case.header), comments="")
    return folder
