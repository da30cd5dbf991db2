"""A law for what is left: the inputs that a structured rest depends on, its formula, and a model to use now.

The methods: smooth functions of inputs and pairs on held-out blocks against orders of the blocks by chance
(`smooth`), and orthogonal least squares with exchanges over a library of terms with units (`terms`, `search.stepwise`),
its size chosen by blocks that neither choice nor fit has seen, each term tested against chance, the whole repeated on
bootstrap replicates over blocks (`formula_search`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.law.formula_search import (
    STABLE,
    Choice,
    LibraryColumns,
    columns_of,
    search_formula,
    settled,
    without_law,
)
from identification.diagnosis.law.model_to_use import model_of
from identification.diagnosis.law.rest import Rest, rest_of
from identification.diagnosis.law.smooth import frequency_answers, input_curves, input_gains
from identification.diagnosis.rest_law import Dependence, InputGain, Law, LawTerm, Pair
from identification.diagnosis.result import JointGap, Judgement, noise_is_all
from identification.engine.resampling import REPLICATES, block_counts, interval
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.random_streams import random_stream

_LEAST = 0.4  # of the squares of the rest that a formula has to foresee
_MOSTLY = 0.5  # share of the replicates that have to choose an input which no formula names


def with_law(judgement: Judgement, shown: Shown) -> Judgement:
    """The same with what its structured rest depends on, and with its law where there is one.

    Args:
        judgement: What the fits say of the gap.
        shown: The effects that are shown, and their fits.
    """
    left = judgement.unexplained
    # Where the measured torque is noise, the rest is the model's own torque.
    if not left.structured or left.joint is None or noise_is_all(judgement.joints):
        return judgement
    rest = rest_of(shown, left.joint, np.array([joint.noise_floor for joint in judgement.joints]))
    if np.count_nonzero(rest.weight) == 0:
        return judgement
    law, dependence = law_of(rest, judgement.joints)
    return replace(judgement, unexplained=replace(left, law=law, dependence=dependence))


def law_of(rest: Rest, joints: tuple[JointGap, ...]) -> tuple[Law | None, Dependence]:
    """The law of a rest, None where none is stable, and what it depends on.

    Args:
        rest: What is left on one joint.
        joints: Gap of every joint of the robot.
    """
    bare = rest
    columns = columns_of(rest, memory=False)
    before = without_law(rest, columns)
    rest, columns = settled(rest, columns)
    gains = input_gains(rest)
    if gains.frequency is not None:
        # Answers with memory mimic much that has none, so that they come in only where nothing else does it.
        rest, columns = settled(bare, columns_of(bare))
    choice = search_formula(rest, columns, before)
    judged = _judged(rest)
    closed = float(1.0 - choice.held_out[judged].sum() / max(choice.before[judged].sum(), 1e-300))
    # A formula that only mimics an answer with memory is none.
    mimics = gains.clearly_less(choice.held_out)
    stable = bool(choice.chosen) and choice.same >= STABLE and closed >= _LEAST and not mimics
    terms, law = (), None
    if stable:
        terms = _terms(rest, columns, choice)
        law = _law(rest, choice, terms, joints)
    inputs = law.inputs if law is not None else (gains.frequency,) if mimics and gains.frequency else ()
    inputs = inputs or _voted(rest, choice, gains.told)
    dependence = Dependence(
        joint=rest.joint,
        unit=rest.unit,
        inputs=inputs,
        gains=gains.told,
        curves=input_curves(rest, inputs),
        answers=frequency_answers(rest, inputs),
        terms=terms,
        same_terms=choice.same if stable else 0.0,
        rest_closed=closed if stable else 0.0,
        blocks=len(judged),
        model=model_of(rest, columns, choice, lawful=stable),
    )
    return law, dependence


def _judged(rest: Rest) -> Array:
    """Blocks of recordings that no fit may see where there are any, else all: each is held out once."""
    outside = np.flatnonzero(rest.folds < 0)
    return outside if len(outside) else np.arange(len(rest.folds))


def _voted(rest: Rest, choice: Choice, gains: tuple[InputGain, ...]) -> tuple[str, ...]:
    """Inputs that most replicates choose; where nothing is beyond chance, those of the best smooth function that is."""
    voted = rest.named({name for name, votes in choice.input_votes.items() if votes > _MOSTLY})
    if voted:
        return voted
    best = next((one for one in gains if one.gain > one.chance and one.interval[0] > 0.0), None)
    return () if best is None else best.inputs


def _terms(rest: Rest, columns: LibraryColumns, choice: Choice) -> tuple[LawTerm, ...]:
    """Terms with coefficients of the torque that acts on the joint, and their intervals by block bootstrap."""
    at = columns.terms.columns(choice.chosen)
    size = columns.size[at]
    theta = _fitted(columns, rest.folds >= 0, at) / size
    low, high = interval(theta[1:])
    owner = {}
    for k in choice.chosen:
        term = columns.library[k]
        for column, text in zip((columns.terms.first[k], columns.terms.second[k]), term.texts, strict=False):
            owner[int(column)] = (text, term)
    out = []
    for place, column in enumerate(at):
        text, term = owner[column]
        unit = f"{rest.unit}/{term.per}" if term.per and " " not in term.per else rest.unit
        unit = f"{rest.unit}/({term.per})" if " " in term.per else unit
        ends = (-float(high[place]), -float(low[place]))
        out.append(LawTerm(text, unit, -float(theta[0, place]), ends, choice.votes.get(term.kind, 0.0)))
    return tuple(out)


def _fitted(columns: LibraryColumns, seen: Bool[Array, " B"], at: list[int]) -> Float[Array, "D k"]:
    """Coefficients of some columns beside what may move: on all seen blocks, then on draws of them by the bootstrap.

    Only the columns in question and those that may move are summed: the library is large.
    """
    every = [*at, *range(len(columns.size), columns.x.shape[1])]
    products, counts = columns.products.of(every), np.zeros((REPLICATES + 1, len(seen)))
    counts[0, seen] = 1.0
    counts[1:, seen] = block_counts(int(seen.sum()), random_stream("blocks of the coefficients of a law"))
    return np.array([products.freed(drawn, columns.free).fitted(list(range(len(at)))) for drawn in counts])


def _law(rest: Rest, choice: Choice, terms: tuple[LawTerm, ...], joints: tuple[JointGap, ...]) -> Law:
    library = choice.columns.library
    named = frozenset().union(*(library[k].inputs for k in choice.chosen))
    inputs = rest.named(named)
    first = {library[k].texts[0]: library[k].kind for k in choice.chosen}
    told = {first[term.term]: term.coefficient for term in terms if term.term in first}
    closed, interval = _share_of_gap(rest, choice, joints)
    return Law(
        joint=rest.joint,
        inputs=inputs,
        formula=formula_text(terms),
        gap_closed=closed,
        gap_closed_interval=interval,
        valid=rest.ranges(inputs),
        like=looks_like(told.keys(), told.values()),
    )


def formula_text(terms: tuple[LawTerm, ...]) -> str:
    """A sum of terms as one line."""
    out = ""
    for term in terms:
        size = f"{abs(term.coefficient):.3g}" + ("" if term.term == "1" else f"*{term.term}")
        sign = "-" if term.coefficient < 0 else "+"
        out += f" {sign} {size}" if out else f"{'-' if term.coefficient < 0 else ''}{size}"
    return out


def _share_of_gap(rest: Rest, choice: Choice, joints: tuple[JointGap, ...]) -> tuple[float, Pair]:
    """Share of the robot's gap that the choice closes on held-out blocks, with its interval by block bootstrap."""
    judged = _judged(rest)
    counts = np.array([rest.weight[rest.blocks == k].sum() for k in judged])
    gained = (choice.before - choice.held_out)[judged]
    gap = float(np.mean([(joint.tolerated / joint.noise_floor) ** 2 for joint in joints])) - 1.0
    scale = len(joints) * rest.floor**2 * max(gap, 1e-12)
    drawn = block_counts(len(judged), random_stream("blocks of what a law closes"))
    low, high = interval(drawn @ gained / np.maximum(drawn @ counts, 1e-12) / scale)
    return float(gained.sum() / max(counts.sum(), 1e-12) / scale), (float(low), float(high))


# Kinds of terms whose presence decides, the most telling first, and what they are like.
_LIKE: tuple[tuple[str, str], ...] = (
    ("hysteresis that grows with load", "hysteresis of a harmonic drive"),
    ("voltage sag", "voltage sag under load"),
    ("ripple that grows with torque", "torque ripple that grows with torque"),
    ("resonance", "a part on a spring that the model takes for rigid: a tool, a load or a liquid, with its resonance"),
    (
        "first-order answer to the velocity",
        "a hose, cable or belt that creeps: a spring in series with a damper (Maxwell)",
    ),
    ("late answer to the torque", "a torque that was filtered or comes late"),
    ("friction with memory", "friction with memory (Dahl, LuGre, generalised Maxwell slip)"),
    ("friction that changes with time", "friction that changes with time, as it does while a drive warms up"),
    ("damping that changes with time", "friction that changes with time, as it does while a drive warms up"),
    ("gain that changes with time", "a torque constant that changes with time, as it does while a motor warms up"),
    ("force over position by direction", "Coulomb friction by direction and position"),
    ("friction over position", "friction that depends on the position, as of a worn or misaligned screw"),
    ("drift", "an offset that drifts, as the tension of a cable does"),
    ("one-sided spring", "a hose or cable that pulls like a nonlinear spring"),
    ("hardening spring", "a spring that hardens"),
    ("friction by another joint's torque", "friction that grows with the load of another joint"),
    ("friction that grows with load", "friction that grows with load"),
)
_HEATED = "friction that changes with temperature"


def looks_like(kinds: Iterable[str], coefficients: Iterable[float]) -> str | None:
    """The law of the literature that a formula is near, None where there is none.

    Args:
        kinds: Of its terms.
        coefficients: Of its terms, of the torque that acts on the joint.
    """
    found = dict(zip(kinds, coefficients, strict=True))
    if _HEATED in found:
        # Friction opposes motion: a negative coefficient is more friction.
        return f"friction that {'grows' if found[_HEATED] < 0 else 'falls'} with temperature"
    return next((law for kind, law in _LIKE if kind in found), None)
