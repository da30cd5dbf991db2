"""A law for the residual after all findings: the inputs on which it depends, its formula, and a residual model.

A law is a formula for the residual of one joint: a sum of terms times coefficients. An input is a quantity on which
terms depend, such as a position or the time. The inputs are found by smooth functions of one or two of them. Their gain
on held-out blocks is compared with the gain on permuted blocks (`smooth`). The formula is found by orthogonal least
squares with exchanges (`engine.search.stepwise`) over a library of terms with units (`library`). Its size is chosen on
held-out blocks, each term is tested against chance, and the search is repeated on bootstrap replicates over blocks
(`formula_search`).

The residual model is to be added to the corrected model. It is the law, or without a law a sum of terms that predicts
well. The corrected model and its changes within the tolerances were fitted without the law. So the terms of the law are
fitted again to the residual of that model, and other terms are added if they predict held-out blocks better.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.diagnosis.input_names import is_frequency, supply_loads
from identification.diagnosis.judge.findings.gate_state import ShownEffects
from identification.diagnosis.judge.verdict import torques_may_be_noise
from identification.diagnosis.law.formula_search import (
    STABLE,
    Choice,
    LibraryColumns,
    best_size,
    columns_of,
    held_out_losses,
    losses_without_law,
    search_formula,
    with_nuisances_at_bounds,
)
from identification.diagnosis.law.joint_residual import JointResidual, joint_residual
from identification.diagnosis.law.smooth import frequency_responses, input_curves, input_gains
from identification.diagnosis.residual_law import Dependence, InputGain, Law, LawTerm, ModelTerm, Pair, ResidualModel
from identification.diagnosis.result import JointGap, Judgement
from identification.engine.products.block_products import NuisancePrior
from identification.engine.resampling import block_counts, interval
from identification.engine.search.stepwise import extended
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream

_FORMULA_PREDICTS = 0.4  # share of the squared residual that a formula has to predict; with less it is no law
# If no formula is found, an input is named if more than this share of the bootstrap replicates choose it.
_MOSTLY = 0.5
# Kinds of terms, the most specific first, each with the law in the literature that a formula with the term resembles.
_SIMILAR: tuple[tuple[str, str], ...] = (
    ("hysteresis that grows with load", "hysteresis of a harmonic drive"),
    ("voltage sag", "voltage sag under load"),
    ("ripple that grows with torque", "torque ripple that grows with torque"),
    ("resonance", "a part on a spring that the model takes for rigid: a tool, a load or a liquid, with its resonance"),
    (
        "first-order response to the velocity",
        "a hose, cable or belt that creeps: a spring in series with a damper (Maxwell)",
    ),
    ("late response to the torque", "a torque that was filtered or comes late"),
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
_MOST_MODEL_TERMS = 6  # largest number of terms of a residual model; a formula has fewer, as people read it
_MODEL_PREDICTS = 0.3  # share of the squared residual that a residual model has to predict; with less there is none
_SLOW = 0.01  # share of the 90th percentile of the speed below which the sign of the velocity is smoothed
_NUMBER = r"[-+0-9.eE]+"


def with_law(judgement: Judgement, shown: ShownEffects) -> Judgement:
    """The judgement with the inputs on which its structured residual depends, and with the law if one is found.

    Args:
        judgement: Result of the fits.
        shown: The effects that are shown, and their fits.
    """
    unexplained = judgement.unexplained
    # If the measured torque is noise, the residual is only the torque of the model.
    if not unexplained.structured or unexplained.joint is None or torques_may_be_noise(judgement.joints):
        return judgement
    residual = joint_residual(shown, unexplained.joint, np.array([joint.noise_floor for joint in judgement.joints]))
    if np.count_nonzero(residual.weight) == 0:
        return judgement
    law, dependence = law_of(residual, judgement.joints)
    return replace(judgement, unexplained=replace(unexplained, law=law, dependence=dependence))


def law_of(residual: JointResidual, joints: tuple[JointGap, ...]) -> tuple[Law | None, Dependence]:
    """The law of a residual (None if no formula is stable), and the inputs on which the residual depends.

    Args:
        residual: Residual of one joint.
        joints: Gap of every joint of the robot.
    """
    with_free_nuisances = residual
    columns = columns_of(residual, memory=False)
    before = losses_without_law(residual, columns)
    residual, columns = with_nuisances_at_bounds(residual, columns)
    gains = input_gains(residual)
    if gains.frequency is not None:
        # Responses with memory can imitate laws without memory, so they are allowed only if no such law fits.
        residual, columns = with_nuisances_at_bounds(with_free_nuisances, columns_of(with_free_nuisances))
    choice = search_formula(residual, columns, before)
    judged = residual.judged
    predicted = float(1.0 - choice.held_out[judged].sum() / max(choice.before[judged].sum(), 1e-300))
    # If a response with memory predicts clearly better than the formula, the formula only imitates it and is no law.
    imitates = gains.clearly_less(choice.held_out)
    stable = bool(choice.chosen) and choice.same_kinds >= STABLE and predicted >= _FORMULA_PREDICTS and not imitates
    terms, law = (), None
    if stable:
        terms = _terms(residual, choice)
        law = _law(residual, choice, terms, joints)
    inputs: tuple[str, ...] = ()
    if law is not None:
        inputs = law.inputs
    elif imitates and gains.frequency:
        inputs = (gains.frequency,)
    inputs = inputs or _inputs_without_law(residual, choice, gains.listed)
    dependence = Dependence(
        joint=residual.joint,
        unit=residual.unit,
        inputs=inputs,
        gains=gains.listed,
        curves=input_curves(residual, inputs),
        responses=frequency_responses(residual, inputs),
        terms=terms,
        same_terms=choice.same_kinds if stable else 0.0,
        predicted_share=predicted if stable else 0.0,
        blocks=len(judged),
        model=model_of(residual, choice, contains_law=stable),
    )
    return law, dependence


def _inputs_without_law(residual: JointResidual, choice: Choice, gains: tuple[InputGain, ...]) -> tuple[str, ...]:
    """Inputs that more than half of the replicates choose; if none, those of the best significant smooth function."""
    voted = residual.named({name for name, votes in choice.input_votes.items() if votes > _MOSTLY})
    if voted:
        return voted
    best = next((one for one in gains if one.gain > one.chance and one.interval[0] > 0.0), None)
    return () if best is None else best.inputs


def _terms(residual: JointResidual, choice: Choice) -> tuple[LawTerm, ...]:
    """Terms of the torque on the joint, with coefficients and their intervals by block bootstrap."""
    columns = choice.columns
    at, texts = columns.terms.columns(choice.chosen), columns.texts(choice.chosen)
    theta = _coefficients(residual, columns, at) / columns.size[at]
    low, high = interval(theta[1:])
    out = []
    for place, column in enumerate(at):
        text, term = texts[column]
        unit = f"{residual.unit}/{term.per}" if term.per and " " not in term.per else residual.unit
        unit = f"{residual.unit}/({term.per})" if " " in term.per else unit
        ends = (-float(high[place]), -float(low[place]))
        out.append(LawTerm(text, unit, -float(theta[0, place]), ends, choice.votes.get(term.kind, 0.0)))
    return tuple(out)


def _coefficients(residual: JointResidual, columns: LibraryColumns, at: list[int]) -> Float[Array, "D k"]:
    """Coefficients of some columns, fitted with the nuisances to all blocks that fits may use, then to each draw.

    Products are summed for these columns and the nuisances only, as the library is large.
    """
    products = columns.products.of([*at, *columns.nuisances])
    weights = residual.block_weights("blocks of the coefficients of a law")
    return np.array([products.summed_without(drawn, columns.prior).fitted(list(range(len(at)))) for drawn in weights])


def _law(residual: JointResidual, choice: Choice, terms: tuple[LawTerm, ...], joints: tuple[JointGap, ...]) -> Law:
    """The law of a chosen formula, with its share of the gap and the range in which it was fitted."""
    library = choice.columns.library
    inputs = residual.named(choice.columns.inputs(choice.chosen))
    kinds = {library[k].texts[0]: library[k].kind for k in choice.chosen}
    closed, ends = _share_of_gap(residual, choice, joints)
    return Law(
        joint=residual.joint,
        inputs=inputs,
        formula=formula_text(terms),
        gap_closed=closed,
        gap_closed_interval=ends,
        valid=residual.ranges(inputs),
        like=similar_law({kinds[term.term]: term.coefficient for term in terms if term.term in kinds}),
    )


def formula_text(terms: tuple[LawTerm, ...]) -> str:
    """A sum of terms as one line."""
    out = ""
    for term in terms:
        size = f"{abs(term.coefficient):.3g}" + ("" if term.term == "1" else f"*{term.term}")
        sign = "-" if term.coefficient < 0 else "+"
        out += f" {sign} {size}" if out else f"{'-' if term.coefficient < 0 else ''}{size}"
    return out


def _share_of_gap(residual: JointResidual, choice: Choice, joints: tuple[JointGap, ...]) -> tuple[float, Pair]:
    """Share of the robot's gap that the choice closes on held-out blocks, with its interval by block bootstrap."""
    judged = residual.judged
    counts = np.array([residual.weight[residual.blocks == k].sum() for k in judged])
    gained = (choice.before - choice.held_out)[judged]
    gap = float(np.mean([(joint.tolerated / joint.noise_floor) ** 2 for joint in joints])) - 1.0
    scale = len(joints) * residual.floor**2 * max(gap, 1e-12)
    drawn = block_counts(len(judged), random_stream("blocks of what a law closes"))
    low, high = interval(drawn @ gained / np.maximum(drawn @ counts, 1e-12) / scale)
    return float(gained.sum() / max(counts.sum(), 1e-12) / scale), (float(low), float(high))


def similar_law(coefficients: Mapping[str, float]) -> str | None:
    """The law in the literature that a formula resembles; None if there is none.

    Args:
        coefficients: Coefficient of each kind of term of the formula, for the torque that acts on the joint.
    """
    if _HEATED in coefficients:
        # Friction opposes motion: a negative coefficient is more friction.
        return f"friction that {'grows' if coefficients[_HEATED] < 0 else 'falls'} with temperature"
    return next((law for kind, law in _SIMILAR if kind in coefficients), None)


def model_of(residual: JointResidual, choice: Choice, *, contains_law: bool) -> ResidualModel | None:
    """The residual model with the smallest error on held-out blocks; None if it predicts too little.

    Args:
        residual: Residual of the joint.
        choice: The formula that was chosen together with the corrected model's coefficients.
        contains_law: True if the formula is shown as the law, so that the model contains it.
    """
    columns, count = choice.columns, len(choice.columns.size)
    no_prior = NuisancePrior(np.zeros((0, 0)), np.zeros(0))
    plain = replace(columns, x=columns.x[:, :count], products=columns.products.of(list(range(count))), prior=no_prior)
    start = choice.chosen if contains_law else ()
    loss = held_out_losses(residual, plain, _MOST_MODEL_TERMS, start)
    whole = plain.products.summed((residual.folds >= 0).astype(float))
    path = extended(plain.terms, whole, start, _MOST_MODEL_TERMS)
    size = min(best_size(loss), len(path) - 1)
    predicted = float(1.0 - loss[size].sum() / max(plain.products.total.sum(), 1e-300))
    if not path[size] or predicted < _MODEL_PREDICTS:
        return None
    at = plain.terms.columns(path[size])
    theta = -whole.fitted(at) / plain.size[at]
    texts = plain.texts(path[size])
    terms, states = residual_terms(residual, [(texts[k][0], c) for k, c in zip(at, theta.tolist(), strict=True)])
    inputs = residual.named(plain.inputs(path[size]))
    speed = f"v.{residual.joint}"
    fast = float(np.percentile(np.abs(residual.series(speed)), 90)) if speed in residual.inputs else 1.0
    needed = [_simulator_input(residual, name) for name in inputs if not is_frequency(name)]
    # Inputs of a filter are named in its expression.
    needed += [name for name in residual.inputs if name not in needed and any(repr(name) in state for state in states)]
    bands = residual.ranges(tuple(name for name in inputs if is_frequency(name)))
    return ResidualModel(
        residual.joint,
        residual.unit,
        terms,
        states,
        residual.ranges(tuple(needed)),
        predicted,
        contains_law,
        _SLOW * fast,
        bands,
    )


def residual_terms(
    residual: JointResidual, terms: list[tuple[str, float]]
) -> tuple[tuple[ModelTerm, ...], tuple[str, ...]]:
    """Terms with their code, and expressions of the states that they need.

    Args:
        residual: Residual of the joint, with the names of the joints.
        terms: Text and coefficient of each term.
    """
    states: list[str] = []
    out = tuple(ModelTerm(text, _code(residual, text, states), coefficient) for text, coefficient in terms)
    return out, tuple(states)


def _simulator_input(residual: JointResidual, name: str) -> str:
    """Name of the input that a simulator has: the position in place of the displacement since the last reversal."""
    return name.replace("dx.", "q.", 1) if name == f"dx.{residual.joint}" else name


def _code(residual: JointResidual, text: str, states: list[str]) -> str:
    """A term's text as a Python expression over inputs ``x["name"]``; functions with memory become states ``s[k]``.

    Args:
        residual: Residual of the joint, with the names of the joints.
        text: Text of the term.
        states: Expressions of the states so far; new ones are added.
    """
    for name, factory in (("bristle", "Bristle"), ("slip", "Slip")):
        for found in re.findall(rf"{name}\(dx/({_NUMBER})\)", text):
            state = f"{factory}({f'q.{residual.joint}'!r}, {found})"
            text = text.replace(f"{name}(dx/{found})", _state(states, state))
    filters = (("low", "Low", "Hz"), ("late", "Late", "s"), ("resonator", "Resonator", "Hz"),
               ("resonator_rate", "ResonatorRate", "Hz"))  # fmt: skip
    for name, factory, unit in filters:
        for found in re.findall(rf"\b{name}\(([a-z]+, {_NUMBER} {unit}(?:, {_NUMBER})?)\)", text):
            of, *numbers = found.replace(f" {unit}", "").split(", ")
            state = f"{factory}({f'{of}.{residual.joint}'!r}, {', '.join(numbers)})"
            text = text.replace(f"{name}({found})", _state(states, state))
    for lag, mean in re.findall(rf"load\(({_NUMBER}) s, ({_NUMBER})\)", text):
        state = f"Load({supply_loads(residual.inputs, residual.joint)!r}, {lag}, {mean})"
        text = text.replace(f"load({lag} s, {mean})", _state(states, state))
    text = re.sub(r"\|([^|]*)\|", r"abs(\1)", text).replace("^", "**").replace("sign(", "side(")
    others = sorted((f"{kind}.{name}" for name in residual.others for kind in ("q", "v", "tau")), key=len, reverse=True)
    spelled = [(name, name) for name in others]
    spelled += [(kind, f"{kind}.{residual.joint}") for kind in ("q", "v", "a", "tl", "tau", "temp")] + [("t", "t")]
    # Names are first replaced by placeholders, so that no name is searched for in the replacement of another.
    for mark, (short, _) in enumerate(spelled):
        text = re.sub(rf"(?<![\w.@]){re.escape(short)}(?![\w.(@])", f"@{mark}@", text)
    return re.sub(r"@(\d+)@", lambda found: f"x[{spelled[int(found[1])][1]!r}]", text)


def _state(states: list[str], expression: str) -> str:
    """Code of a state, such as ``s[0]``; its expression is added to ``states`` if they do not contain it."""
    if expression not in states:
        states.append(expression)
    return f"s[{states.index(expression)}]"
