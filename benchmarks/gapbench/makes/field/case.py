"""One case: a pure function of kind and seed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .. import enough_beyond
from ..plain_numbers import plain
from . import files, gap, outside
from .dynamics import link_torque, mass_and_bias
from .effects import EFFECTS, OF_COMMANDS, TURNING_ONLY, Effect, coarse
from .lookalikes import alike
from .motions import draw_motion
from .plant import sound_plant
from .records import Recorder, band_of, columns, draw_recorder, torque_noise, written
from .robots import FINE, KINDS, Robot, draw_robot
from .simulate import STEP, Run, Task
from .world import Scale, World, moved, scale_of

Array = np.ndarray
Rng = np.random.Generator
STREAMS = {"null": 1, "single": 2, "pair": 3, "outside": 4}
SMALLEST, LARGEST = 0.5, 40.0  # sizes that are asked for [noise floors]
NO_TRACE = 0.2  # noise floors: what leaves less is not there
CLOSE = 1.3  # factor within which a size counts as reached
TRIES = 8  # runs that look for a size
MOVES = 0.25  # share of the time that a joint with an effect moves at least
FRICTION = (
    "viscous_friction",
    "coulomb_friction",
    "direction_dependent_friction",
    "stribeck_friction",
    "presliding_friction",
    "load_dependent_friction",
    "joint_coupling",
)


@dataclass(frozen=True)
class Setting:
    """Robot, motion, noise and log that every run of a case shares, and its run without any effect.

    ``known`` is what the controller knows of the model, see `feedforward`.
    """

    robot: Robot
    motion: str
    task: Task
    known: bool | None
    world: World
    recorder: Recorder
    scale: Scale
    run: Run
    view: gap.View
    floor: Array
    config: str


def _inertia(robot: Robot) -> Array:
    """What each joint accelerates at its home posture, rotor included, shape ``(n,)``."""
    n = robot.true.n
    big, bias = np.zeros((n, n)), np.zeros(n)
    mass_and_bias(robot.given.numbers(), robot.each("home"), np.zeros(n), big, bias)
    return np.diag(big) + robot.rotor


def feedforward(robot: Robot, ref: Array, known: bool | None) -> tuple[Array, Array]:
    """Speed of a reference and the torque that the controller adds, each of shape ``(K, n)``.

    Args:
        robot: With its given model.
        ref: Reference at every step.
        known: The controller knows the whole model, or gravity alone; None: nothing of it.
    """
    speed = np.gradient(ref, STEP, axis=0)
    if known is None:
        return speed, np.zeros_like(ref)
    push = np.gradient(speed, STEP, axis=0)
    feed = link_torque(robot.given, ref, speed * known, push * known) + robot.rotor * push * known
    rubs = robot.coulomb * np.tanh(speed / (0.03 * robot.each("speed"))) + robot.viscous * speed
    return speed, feed + rubs * known


def _task(robot: Robot, ref: Array, inertia: Array, known: bool | None, rng: Rng) -> Task:
    """Reference, gains of some hertz, and what the controller knows of the model."""
    speed, feed = feedforward(robot, ref, known)
    rate = 2.0 * np.pi * rng.uniform(4.0, 9.0)
    # Stiff enough that friction leaves a few percent of the way.
    rubbing = robot.coulomb + robot.viscous * robot.each("speed")
    kp = np.maximum(inertia * rate**2, rubbing / (0.03 * robot.each("swing")))
    kd = 2.0 * rng.uniform(0.5, 0.9) * np.sqrt(inertia * kp)
    still = np.zeros(len(ref), dtype=bool)
    return Task(ref, speed, feed, kp, kd, np.zeros_like(ref), still)


def _hidden(steps: int, torque: Array, band: float, rng: Rng) -> Array:
    """Torque noise of the drives that no log shows, held for a millisecond, shape ``(K, n)``."""
    return np.repeat(torque_noise(rng, -(-steps // 4), torque, 1000.0, band), 4, axis=0)[:steps]


def _setting(which: int, rng: Rng, *, command: bool) -> Setting:
    """Everything but the effect; ``command`` asks for a log of commanded torques."""
    small = KINDS[which % len(KINDS)](np.random.default_rng(0))
    configured = bool(rng.random() < 0.6) or small.mjcf
    robot = draw_robot(rng, which, configured=configured)
    motion, ref = draw_motion(robot, int(rng.integers(100)), rng)
    in_sensor = not command and bool(rng.random() < 0.5)
    inertia = _inertia(robot)
    known = bool(rng.random() < 0.7) if robot.kind.feedforward else None
    task = _task(robot, ref, inertia, known, rng)
    # Coarse encoders are stated: what is not stated would be a gap.
    counts = robot.kind.counts if configured else max(robot.kind.counts, 4.0 * FINE)
    quantum = np.where(robot.given.linear, 1e-6, 2.0 * np.pi / counts)
    nothing = np.zeros_like(ref)
    world = World(sound_plant(robot), robot.true, quantum, None, task.held, nothing)
    calm = moved(world, task)
    scale = scale_of(calm, inertia, robot.each("speed"))
    recorder = draw_recorder(robot, scale.seconds, scale.torque, in_sensor=in_sensor, rng=rng)
    hidden = _hidden(len(ref), scale.torque, band_of(recorder.rate), rng)
    if not configured:
        recorder = replace(recorder, constants={})
    if not in_sensor:
        task = replace(task, extra=hidden)
    said = files.config(
        robot,
        source="current" if in_sensor and configured else "command",
        counts=configured and not recorder.constants and counts < 4.0 * FINE,
        drives=recorder.constants,
        rotors=configured and not robot.kind.mjcf,
    )
    # Standing still costs more than sliding on every robot, but in a sound one not so much that the log would show it.
    plain = world.plant
    world = replace(world, plant=plain._replace(static=np.zeros_like(plain.static)))
    floor = gap.noise_floor(robot, moved(world, task), recorder, quantum)
    world = replace(world, plant=plain._replace(static=np.minimum(plain.static, 0.5 * floor)))
    base = moved(world, task)
    return Setting(
        robot, motion, task, known, world, recorder, scale, base, gap.seen(robot, base, recorder), floor, said
    )


def _usable(run: Run, setting: Setting) -> bool:
    """The robot still follows its reference."""
    miss = np.abs(run.reading - setting.task.ref).max(axis=0)
    return bool(np.all(np.isfinite(miss)) and np.all(miss < np.maximum(0.5 * setting.scale.reach, 0.05)))


def _traced(setting: Setting, world: World, without: tuple[World, Run]) -> tuple[Run, gap.Trace | None]:
    """Runs a world and measures its change against another one; None where the robot loses its way."""
    other, before = without
    run = moved(world, setting.task)
    if not _usable(run, setting):
        return run, None
    robot, recorder, floor = setting.robot, setting.recorder, setting.floor
    if not np.array_equal(world.quantum, other.quantum):
        return run, gap.rounding(before, recorder, other.quantum, world.quantum, robot, floor)
    view = setting.view if before is setting.run else gap.seen(robot, before, recorder)
    return run, gap.trace(robot, view, gap.seen(robot, run, recorder), floor)


@dataclass(frozen=True)
class Sized:
    """An effect with its strength, the run that shows it and its trace."""

    effect: Effect
    size: float
    run: Run
    trace: gap.Trace
    beyond: float


def _sized(setting: Setting, effect: Effect, target: float, *, judged: bool) -> Sized | None:
    """Looks for the strength that leaves a gap [noise floors]; None where nothing does.

    Args:
        setting: Of the case.
        effect: To be sized.
        target: Gap to reach [noise floors].
        judged: The catalogue has it, so it must also be more than the tolerances explain.
    """
    size, least, best = min(effect.start, effect.most), 0.0, None
    floor = (setting.world, setting.run)
    for _ in range(TRIES):
        run, found = _traced(setting, effect.put(setting.world, size), floor)
        if found is None:
            size *= 0.3
            continue
        reached = found.gap
        if reached < 1e-3:
            if size >= effect.most or size > 1e3 * effect.start:
                return None
            size = min(10.0 * size, effect.most)
            continue
        beyond = gap.beyond_tolerance(setting.robot, found) if judged else reached
        best = Sized(effect, size, run, found, beyond)
        wanted = target / reached
        if judged and not enough_beyond(reached, beyond):
            least = 1.6 * size
        next_size = min(max(size * float(np.clip(wanted, 0.05, 20.0)), least), effect.most)
        if 1.0 / CLOSE < next_size / size < CLOSE:
            break
        size = next_size
    if best is None or best.trace.gap < NO_TRACE or not enough_beyond(best.trace.gap, best.beyond):
        return None
    return best


def _joint(setting: Setting, rng: Rng, *, linear: bool, but: str | None = None) -> int | None:
    """A joint that moves enough."""
    kind, moving = setting.robot.kind, setting.scale.moving
    fit = [
        j
        for j, joint in enumerate(kind.joints)
        if moving[j] >= MOVES * min(1.0, moving.max()) and (linear or not joint.linear) and joint.name != but
    ]
    return int(rng.choice(fit)) if fit else None


def _effect(setting: Setting, which: int, rng: Rng, but: str | None = None) -> Effect | None:
    law = EFFECTS[which % len(EFFECTS)]
    j = _joint(setting, rng, linear=law not in TURNING_ONLY or law is coarse, but=but)
    return None if j is None else law(setting.robot, setting.scale, j, rng)


def _target(rng: Rng) -> float:
    return float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))


def _entry(one: Sized, share: float) -> dict:
    return {
        "effect": one.effect.name,
        "joint": one.effect.joint,
        "parameters": one.effect.parameters(one.size),
        "gap_in_floors": share,
    }


def _drawn(
    setting: Setting, world: World, run: Run, parts: Sequence[tuple[Sized, float]], cause: Effect | None
) -> tuple[dict[str, bytes], dict]:
    """Files and answer of a case whose effects are settled."""
    robot, recorder = setting.robot, setting.recorder
    log = columns(robot, run, setting.task.ref, recorder, world.quantum)
    robot_file = ("robot.xml", files.mjcf(robot)) if robot.kind.mjcf else ("robot.urdf", files.urdf(robot))
    out = {robot_file[0]: robot_file[1].encode(), f"log.{recorder.ending}": written(log, recorder.ending)}
    if setting.config:
        out["robot.yaml"] = setting.config.encode()
    entries = [] if cause else [_entry(one, share) for one, share in parts]
    each = np.max([one.trace.each for one, _ in parts], axis=0) if parts else np.zeros(robot.true.n)
    shares = [share for _, share in parts]
    twins = [
        {"of": i, **twin}
        for i, (one, _) in enumerate(parts)
        for twin in ([] if cause else alike(robot, one.effect, one.size, one.trace))
    ]
    answer = {
        "kind": "outside" if cause else ("null", "single", "pair")[len(parts)],
        "robot": f"user_{robot.kind.name}",
        "motion": setting.motion,
        "joints": list(robot.names),
        "effects": entries,
        "truth": entries,
        "outside": {"name": cause.name, "joint": cause.joint, **cause.parameters(parts[0][0].size)} if cause else None,
        "alike": twins,
        "paired_gap": min(shares) if shares else 0.0,
        "paired_gap_per_joint": each.tolist(),
        "gap_in_floors": shares,
        "beyond_tolerance": max((one.beyond for one, _ in parts), default=0.0),
        "noise_floor": setting.floor.tolist(),
        "band_hz": [0.0, band_of(recorder.rate)],
        "rate_hz": recorder.rate,
        "seconds": setting.scale.seconds,
        "log": recorder.ending,
    }
    return out, plain(answer)  # type: ignore[return-value]  # a dictionary stays one


def _null(setting: Setting) -> tuple[dict[str, bytes], dict]:
    return _drawn(setting, setting.world, setting.run, (), None)


def _one(setting: Setting, seed: int, rng: Rng) -> Sized | None:
    effect = _effect(setting, seed, rng)
    return effect and _sized(setting, effect, _target(rng), judged=True)


def _single(setting: Setting, seed: int, rng: Rng) -> tuple[dict[str, bytes], dict] | None:
    one = _one(setting, seed, rng)
    return one and _single_files(setting, one)


def _single_files(setting: Setting, one: Sized) -> tuple[dict[str, bytes], dict]:
    return _drawn(setting, one.effect.put(setting.world, one.size), one.run, ((one, one.trace.gap),), None)


def _outside(setting: Setting, seed: int, rng: Rng) -> tuple[dict[str, bytes], dict] | None:
    j = _joint(setting, rng, linear=True)
    if j is None:
        return None
    cause = outside.CAUSES[seed % len(outside.CAUSES)](setting.robot, setting.scale, j, rng)
    one = _sized(setting, cause, _target(rng), judged=False)
    if not one:
        return None
    return _drawn(setting, cause.put(setting.world, one.size), one.run, ((one, one.trace.gap),), cause)


def _pair(setting: Setting, seed: int, rng: Rng) -> tuple[dict[str, bytes], dict] | None:
    first = _effect(setting, seed, rng)
    if first is None:
        return None
    which = seed + 1 + int(rng.integers(len(EFFECTS) - 1))
    second = _effect(setting, which, rng, but=first.joint if first.name in FRICTION else None)
    if second is None:
        return None
    one, two = (_sized(setting, x, 2.0 * _target(rng), judged=True) for x in (first, second))
    if one is None or two is None:
        return None
    alone = [(x.effect.put(setting.world, x.size), x.run) for x in (one, two)]
    both = second.put(alone[0][0], two.size)
    run, less_two = _traced(setting, both, alone[0])
    _, less_one = _traced(setting, both, alone[1])
    if less_one is None or less_two is None or min(less_one.gap, less_two.gap) < NO_TRACE:
        return None
    return _drawn(setting, both, run, ((one, less_one.gap), (two, less_two.gap)), None)


MAKERS: dict[str, Callable[[Setting, int, Rng], tuple[dict[str, bytes], dict] | None]] = {
    "single": _single,
    "pair": _pair,
    "outside": _outside,
}


@dataclass(frozen=True)
class Case:
    """A case: the files that a diagnosis may see, by name, and the answer."""

    files: dict[str, bytes]
    answer: dict


def case_id(seed: int, kind: str) -> str:
    """Name of a case, which tells nothing."""
    return hashlib.sha256(f"field:{kind}:{seed}".encode()).hexdigest()[:16]


def resolved_kind(seed: int, kind: str) -> str:
    """``mixed`` made ``null`` or ``single``, by the parity of a hash of the seed."""
    if kind == "mixed":
        return ("null", "single")[hashlib.sha256(f"field:{seed}".encode()).digest()[0] % 2]
    if kind not in STREAMS:
        raise ValueError(f"No kind '{kind}': there are {', '.join(STREAMS)} and mixed.")
    return kind


def _begun(seed: int, kind: str) -> tuple[Setting, Rng]:
    rng = np.random.default_rng((20261, STREAMS[kind], seed))
    command = kind == "pair" or (kind == "single" and EFFECTS[seed % len(EFFECTS)] in OF_COMMANDS)
    return _setting(seed, rng, command=command), rng


def draw_open(seed: int) -> tuple[dict[str, bytes], Setting, Sized] | None:
    """Files of a single case with all that they hide, for another recording of the same robot; None if it is a null."""
    setting, rng = _begun(seed, "single")
    one = _one(setting, seed, rng)
    return None if one is None else (_single_files(setting, one)[0], setting, one)


def draw_case(seed: int, kind: str) -> Case:
    """The case of a seed and a kind; an effect that leaves no trace makes a null of it.

    Args:
        seed: Whole number from 0 on; below 1000 for development.
        kind: ``null``, ``single``, ``pair``, ``outside`` or ``mixed``.
    Raises:
        ValueError: If there is no such kind.
    """
    kind = resolved_kind(seed, kind)
    setting, rng = _begun(seed, kind)
    made = MAKERS[kind](setting, seed, rng) if kind in MAKERS else None
    written_files, answer = made or _null(setting)
    head = {"schema": "blind-answer/2", "id": case_id(seed, kind), "seed": seed, "make": "field"}
    return Case(written_files, {**head, **answer})


def write_case(case: Case, folder: Path) -> Path:
    """Writes what a diagnosis may see into a folder of the case's own; returns that."""
    place = folder / case.answer["id"]
    place.mkdir(parents=True, exist_ok=True)
    for name, content in case.files.items():
        (place / name).write_bytes(content)
    return place
