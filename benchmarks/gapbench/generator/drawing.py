"""Effects at the sizes that are asked for, each measured on the run that has it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .effects import SINGLE_EFFECTS, WHOLE, Effect
from .guess import first_guess, largest_magnitude
from .outside import draw_outside, sound
from .plant import Outside
from .recipes import Recipe, draw_recipe, realised
from .setup import Setup, run_of, tracks
from .simulate import Run
from .sizing import ENOUGH_BEYOND, SHARE_BEYOND, Ruler, size_of

SIZES = (0.5, 16.0)  # noise floors, drawn evenly in the logarithm
NEAR, CLOSE = 1.35, 1.8  # a measured size within this factor of the wanted one is taken at once; at the end
RUNS, SATURATION_RUNS = 4, 7  # to reach a size
LEAST_OF_A_PAIR = 1.0  # [noise floors]: each effect's own difference
APART = 0.5  # of an effect of a pair: what the other one, scaled at will, leaves of it
FAMILIES = (
    SINGLE_EFFECTS[:6],
    ("backlash", "transmission_compliance"),
    ("input_delay", "actuator_lag"),
    ("torque_constant", "payload", "inertial_parameters", "rotor_inertia"),
    ("torque_offset", "base_tilt", "parasitic_spring", "encoder_offset", "payload"),
    ("encoder_eccentricity", "cogging"),
)


@dataclass(frozen=True)
class Measured:
    """A run with something wrong and its paired difference to the run without."""

    run: Run
    change: np.ndarray

    @property
    def size(self) -> float:
        """Of the difference [noise floors]."""
        return size_of(self.change)


def drawn_size(rng: np.random.Generator, least: float = SIZES[0]) -> float:
    """A size, evenly in the logarithm."""
    return float(np.exp(rng.uniform(*np.log((least, SIZES[1])))))


def _measured(setup: Setup, measure: Ruler, *effects: Effect, outside: Outside | None = None) -> Measured | None:
    run = run_of(setup, *effects, outside=outside)
    return Measured(run, measure.change(run)) if tracks(run, setup) else None


def _enlarged(measure: Ruler, change: np.ndarray) -> float:
    """Factor by which a change has to grow until tolerance leaves enough of it; 0 if it never does."""
    size, factor = size_of(change), 1.0
    while factor < 40.0:
        left = measure.beyond_tolerance(factor * change)
        if left >= min(SHARE_BEYOND * factor * size, ENOUGH_BEYOND):
            return factor
        factor *= 1.3
    return 0.0


def _least(recipe: Recipe, measure: Ruler) -> float:
    """Magnitude below which nothing happens: a limit above the largest torque."""
    if recipe.effect != "torque_saturation":
        return 0.0
    return 1.0 / float(np.abs(measure.run.command[:, measure.truth.active.index(recipe.joint)]).max())


def _next(tried: list[tuple[float, float]], wanted: float, least: float) -> float:
    """The next magnitude from those tried and their sizes: between two of them, else in proportion."""
    below = max((one for one in tried if one[1] < wanted), default=None)
    above = min((one for one in tried if one[1] >= wanted), default=None)
    if below and above and least < below[0] < above[0]:
        low, high = (np.log(one[0] - least) for one in (below, above))
        share = np.log(wanted / below[1]) / np.log(above[1] / below[1])
        return least + float(np.exp(low + np.clip(share, 0.1, 0.9) * (high - low)))
    m, size = tried[-1]
    # Beyond a limit the controller asks for ever more: the size grows faster than what is cut off.
    power = 0.5 if least else 1.0
    return least + (m - least) * float(np.clip((wanted / size) ** power, 0.05, 20.0))


def sized(recipe: Recipe, setup: Setup, measure: Ruler, size: float) -> tuple[Effect, Measured] | None:
    """The effect at the wanted size, or larger where tolerance could explain too much; None if it cannot be."""
    m, largest = first_guess(recipe, measure, size), largest_magnitude(recipe, measure)
    if m <= 0.0:
        return None
    m, wanted, checked = min(m, largest), size, False
    least, tried = _least(recipe, measure), []
    runs = SATURATION_RUNS if least else RUNS
    for count in range(runs):
        effect = realised(recipe, m)
        found = _measured(setup, measure, effect)
        if found is None or found.size < 1e-3:
            return None
        tried.append((m, found.size))
        off = wanted / found.size
        near = 1.0 / NEAR < off < NEAR or (count == runs - 1 and 1.0 / CLOSE < off < CLOSE)
        if near and not checked:
            factor = _enlarged(measure, found.change)
            checked, wanted = True, wanted * factor
            if factor == 1.0:
                return effect, found
            off, near = factor, False
        left = measure.beyond_tolerance(found.change) if checked and near else 0.0
        if checked and near and left >= 0.9 * min(SHARE_BEYOND * found.size, ENOUGH_BEYOND):
            return effect, found
        if m >= largest and off > 1.0:
            return None
        m = min(_next(tried, wanted, least), largest)
    return None


def draw_single(
    rng: np.random.Generator, name: str, setup: Setup, measure: Ruler, least: float = SIZES[0]
) -> tuple[Effect, Measured, float] | None:
    """An effect of the robot, its run and the size that was drawn; None where this draw is impossible."""
    recipe, size = draw_recipe(rng, name, setup.owner), drawn_size(rng, least)
    found = sized(recipe, setup, measure, size) if recipe else None
    return (*found, size) if found else None


def _may_join(one: Effect, other: Effect) -> bool:
    """Two effects that are no twins by their kind: of other families, or of one family at other joints."""
    if one.effect == other.effect or (one.effect.startswith("encoder_") and other.effect.startswith("encoder_")):
        return one.effect == other.effect and WHOLE not in (one.joint, other.joint) and one.joint != other.joint
    related = any(one.effect in family and other.effect in family for family in FAMILIES)
    return not related or (WHOLE not in (one.joint, other.joint) and one.joint != other.joint)


def _apart(change: np.ndarray, other: np.ndarray) -> bool:
    own, beside = change.reshape(-1), other.reshape(-1)
    rest = own - (own @ beside) / (beside @ beside) * beside
    return bool(rest @ rest >= APART**2 * (own @ own))


def draw_pair(
    rng: np.random.Generator, first: str, setup: Setup, measure: Ruler
) -> tuple[tuple[Effect, Effect], Measured, list[np.ndarray], float] | None:
    """Two effects, the run with both, and what each one changes beside the other."""
    one = draw_single(rng, first, setup, measure, LEAST_OF_A_PAIR)
    if one is None:
        return None
    for _ in range(3):
        name = str(rng.choice(SINGLE_EFFECTS))
        recipe, size = draw_recipe(rng, name, setup.owner), drawn_size(rng, LEAST_OF_A_PAIR)
        if recipe is None or not _may_join(one[0], Effect(name, recipe.joint, {}, recipe.second)):
            continue
        other = sized(recipe, setup, measure, size)
        if other is None or not _apart(one[1].change, other[1].change) or not _apart(other[1].change, one[1].change):
            continue
        both = _measured(setup, measure, one[0], other[0])
        if both is None:
            continue
        own = [both.change - other[1].change, both.change - one[1].change]
        if min(size_of(x) for x in own) >= LEAST_OF_A_PAIR:
            return (one[0], other[0]), both, own, one[2]
    return None


def draw_cause(
    rng: np.random.Generator, name: str, setup: Setup, measure: Ruler
) -> tuple[Outside, Measured, float] | None:
    """A cause outside the catalogue at about the size that was drawn."""
    size, make = drawn_size(rng), draw_outside(rng, name, measure)
    m, wanted = size, size
    for count in range(RUNS):
        cause = make(m)
        if not sound(cause, setup.truth):
            return None
        found = _measured(setup, measure, outside=cause)
        if found is None or found.size < 1e-3:
            return None
        off = wanted / found.size
        if 1.0 / NEAR < off < NEAR or (count == RUNS - 1 and 1.0 / CLOSE < off < CLOSE):
            off = _enlarged(measure, found.change)
            if off < 1.1:
                return (cause, found, size) if off else None
            wanted *= off
        m *= float(np.clip(off, 0.1, 20.0))
    return None
