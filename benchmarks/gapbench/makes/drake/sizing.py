"""Seeks the magnitude of an effect by repeated runs, until its paired difference has the size that was drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import enough_beyond
from .causes import drawn_cause
from .departures import Departures, none
from .effects import NAMES, Effect, drawn_effect
from .measure import Ruler, ruler, size_of
from .outside import NAMES as CAUSES
from .robots import Robot
from .session import Setup, drawn_setup, with_fine
from .simulate import Run, simulated
from .tolerance import Columns, Workshop, beyond_tolerance, tolerance_columns

SIZES = (0.5, 40.0)  # noise floors; drawn evenly in the logarithm
NO_TRACE = 0.5  # noise floors: a paired difference below that, or less beyond the tolerance, is no gap
FINE = 0.5  # noise floors: what bristles and current loops of a null may leave at a joint
LOOP = 0.1  # the same for the loops alone: they delay every joint alike, and a recording shows half a floor of that
VISIBLE = 1.0  # noise floors: what each effect of a pair changes beside the other
TRIES = 5
NEAR = 1.2  # a size within that factor is the one that was drawn
APART = 0.75  # of the energy of one of a pair's changes: no more may be a multiple of the other's
COUPLES = (
    ("coulomb_friction", "payload"),
    ("backlash", "coulomb_friction"),
    ("transmission_compliance", "viscous_friction"),
    ("torque_constant", "viscous_friction"),
    ("cogging", "payload"),
    ("input_delay", "coulomb_friction"),
    ("rotor_inertia", "stribeck_friction"),
    ("torque_offset", "presliding_friction"),
    ("base_tilt", "viscous_friction"),
    ("parasitic_spring", "coulomb_friction"),
    ("load_dependent_friction", "torque_offset"),
    ("encoder_eccentricity", "viscous_friction"),
    ("torque_saturation", "payload"),
    ("transmission_compliance", "cogging"),
    ("joint_coupling", "torque_constant"),
    ("direction_dependent_friction", "actuator_lag"),
    ("inertial_parameters", "stribeck_friction"),
    ("encoder_offset", "coulomb_friction"),
    ("encoder_quantization", "payload"),
)


@dataclass(frozen=True)
class Found:
    """Effects at the magnitudes that were sought, the run with them, and what they change [noise floors]."""

    effects: tuple[Effect, ...]
    magnitudes: tuple[float, ...]
    run: Run
    change: np.ndarray
    own: tuple[np.ndarray, ...]
    wanted: float
    outside: bool = False
    no_trace: bool = False


def follows(run: Run, setup: Setup) -> bool:
    """Whether the robot keeps to its reference: by a quarter of its travel, and at no more than twice its speed."""
    parts, wanted = setup.truth, setup.session.motion.q
    far = np.abs(run.motor - wanted).max(axis=0) / parts.array("reach")
    fast = np.abs(run.speed).max(axis=0) / parts.array("speed")
    return bool(far.max() < 0.25 and fast.max() < 2.0)


def run_with(setup: Setup, changes: list[tuple[Effect, float]]) -> Run | None:
    """A run with these effects; None where the robot does not keep to its reference."""
    robot: Robot = setup.truth
    of: Departures = none(len(robot.parts))
    for effect, magnitude in changes:
        robot, of = effect.change(robot, of, magnitude)
    try:
        run = simulated(robot, of, setup.session)
    except (FloatingPointError, np.linalg.LinAlgError):
        return None
    return run if follows(run, setup) else None


def quiet_setup(seed: int, kind: int, attempt: int) -> tuple[Ruler, Run] | None:
    """A session whose null is one: bristles and current loops made finer until they leave as little as they may."""
    setup = drawn_setup(seed, kind, attempt)
    for _ in range(4):
        run = run_with(setup, [])
        if run is None:
            return None
        measure = ruler(setup, run)
        if measure.fine.max() < FINE and measure.loop.max() < LOOP:
            return measure, run
        loop = np.minimum(0.6 * LOOP / np.maximum(measure.loop, 1e-9), 1.0)
        # What the loops leave goes with them; the rest is friction.
        rest = np.sqrt(np.maximum(measure.fine**2 - measure.loop**2, 1e-18))
        setup = with_fine(setup, np.minimum(0.6 * FINE / rest, 1.0), loop)
    return None


def _sought(effect: Effect, wanted: float, measure: Ruler) -> tuple[float, Run, np.ndarray] | None:
    """A magnitude whose change has about the wanted size, or the largest plausible one."""
    best: tuple[float, float, Run, np.ndarray] | None = None
    s, tried = min(effect.start * wanted, effect.most), []
    for _ in range(TRIES):
        run = run_with(measure.setup, [(effect, s)])
        if run is None:
            # More than the robot can be moved with.
            s *= 0.5
            continue
        change = measure.change(run)
        size = size_of(change)
        miss = abs(np.log(max(size, 1e-6) / wanted))
        if best is None or miss < best[0]:
            best = (miss, s, run, change)
        if miss < np.log(NEAR) or (size < wanted and s >= effect.most):
            break
        tried.append((np.log(s), np.log(max(size, 1e-6))))
        slope = 1.0
        if len(tried) > 1 and abs(tried[-1][0] - tried[-2][0]) > 1e-3:
            slope = float(np.clip((tried[-1][1] - tried[-2][1]) / (tried[-1][0] - tried[-2][0]), 0.4, 3.0))
        s = float(min(s * np.exp(np.clip(np.log(wanted / max(size, 1e-6)) / slope, -3.0, 3.0)), effect.most))
    return None if best is None else best[1:]


def _size(rng: np.random.Generator, low: float = SIZES[0]) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(SIZES[1]))))


def _sizes(change: np.ndarray, shop: Workshop, columns: Columns) -> tuple[float, float]:
    """What a change is to the torque, and what of that the tolerances cannot explain [noise floors]."""
    return size_of(change), beyond_tolerance(change, shop, columns)


def drawn_single(rng: np.random.Generator, seed: int, kind: str, measure: Ruler, shop: Workshop) -> Found | None:
    """One effect or one cause outside, by the seed; larger by four once where the tolerance hides it."""
    outside = kind == "outside"
    name = (CAUSES if outside else NAMES)[seed % len(CAUSES if outside else NAMES)]
    effect = drawn_cause(rng, name, measure) if outside else drawn_effect(rng, name, measure)
    if effect is None:
        return None
    wanted, columns = _size(rng), tolerance_columns(shop)
    found = _sought(effect, wanted, measure)
    if found is None:
        return None
    sizes = _sizes(found[2], shop, columns)
    if min(sizes) < NO_TRACE and wanted * 4.0 <= SIZES[1]:
        wanted *= 4.0
        larger = _sought(effect, wanted, measure)
        if larger is not None:
            found, sizes = larger, _sizes(larger[2], shop, columns)
    magnitude, run, change = found
    no_trace = min(sizes) < NO_TRACE
    if not no_trace and not outside and not enough_beyond(*sizes):
        return None
    return Found((effect,), (magnitude,), run, change, (change,), wanted, outside, no_trace)


def _share(change: np.ndarray, of: np.ndarray) -> float:
    """Share of a change's energy that a multiple of another one explains."""
    along = float((change * of).sum())
    return along**2 / max(float((change**2).sum()) * float((of**2).sum()), 1e-30)


def drawn_pair(rng: np.random.Generator, seed: int, measure: Ruler, shop: Workshop) -> Found | None:
    """A plausible couple by the seed, each of a size of its own, and each visible beside other and tolerance."""
    effects = [drawn_effect(rng, name, measure) for name in COUPLES[seed % len(COUPLES)]]
    if None in effects:
        return None
    wanted = _size(rng, 1.0)
    alone = [_sought(e, wanted * rng.uniform(0.5, 1.0), measure) for e in effects if e is not None]
    found = [one for one in alone if one is not None]
    if len(found) < 2:
        return None
    both = [(e, one[0]) for e, one in zip(effects, found, strict=True) if e is not None]
    run = run_with(measure.setup, both)
    if run is None:
        return None
    change = measure.change(run)
    own = (change - found[1][2], change - found[0][2])
    columns = tolerance_columns(shop)
    if any(size_of(x) < VISIBLE or not enough_beyond(*_sizes(x, shop, columns)) for x in own) or _share(*own) > APART:
        return None
    magnitudes = tuple(one[0] for one in found)
    return Found(tuple(e for e, _ in both), magnitudes, run, change, own, wanted)
