"""A residual model to use beside the corrected model: the law, or a sum of terms that fits without being one.

The corrected model is what it is: its moves within the tolerances were fitted without the law. So the terms of the law
are fitted to what that model leaves as it is, and others join them where held-out blocks ask for it.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from identification.diagnosis.input_names import is_frequency, supply_loads
from identification.diagnosis.law.formula_search import Choice, LibraryColumns, best_size, cross_validated
from identification.diagnosis.law.rest import Rest
from identification.diagnosis.rest_law import ModelTerm, ResidualModel
from identification.engine.products.block_products import Free
from identification.engine.search.stepwise import extended

_MOST = 6
_LEAST = 0.3  # of the rest's squares that a model has to foresee to be worth using
_SLOW = 0.01  # of the fast end of the speeds, below which a direction is rounded off

_NUMBER = r"[-+0-9.eE]+"


def model_of(rest: Rest, columns: LibraryColumns, choice: Choice, *, lawful: bool) -> ResidualModel | None:
    """The model with the smallest error on held-out blocks, None where it foresees too little.

    Args:
        rest: What is left on the joint.
        columns: The library on it.
        choice: The formula that was chosen with the model free to move.
        lawful: True if it is shown as the law.
    """
    count = len(columns.size)
    free = Free(np.zeros((0, 0)), np.zeros(0))
    plain = replace(columns, x=columns.x[:, :count], products=columns.products.of(list(range(count))), free=free)
    start = choice.chosen if lawful else ()
    loss = cross_validated(rest, plain, _MOST, start)
    whole = plain.products.summed((rest.folds >= 0).astype(float))
    path = extended(plain.terms, whole, start, _MOST)
    size = min(best_size(loss), len(path) - 1)
    closed = float(1.0 - loss[size].sum() / max(plain.products.total.sum(), 1e-300))
    if not path[size] or closed < _LEAST:
        return None
    at = plain.terms.columns(path[size])
    theta = -whole.fitted(at) / plain.size[at]
    texts = {}
    for k in path[size]:
        term = plain.library[k]
        texts |= dict(zip((int(plain.terms.first[k]), int(plain.terms.second[k])), term.texts, strict=False))
    inputs = frozenset().union(*(plain.library[k].inputs for k in path[size]))
    terms, states = residual_terms(rest, list(zip((texts[column] for column in at), theta.tolist(), strict=True)))
    speed = f"v.{rest.joint}"
    fast = float(np.percentile(np.abs(rest.series(speed)), 90)) if speed in rest.inputs else 1.0
    needed = [_measured(rest, name) for name in rest.named(inputs) if not is_frequency(name)]
    # What a filter takes in is in its expression.
    needed += [name for name in rest.inputs if name not in needed and any(repr(name) in state for state in states)]
    bands = rest.ranges(tuple(name for name in rest.named(inputs) if is_frequency(name)))
    ranges = rest.ranges(tuple(needed))
    return ResidualModel(rest.joint, rest.unit, terms, states, ranges, closed, lawful, _SLOW * fast, bands)


def residual_terms(rest: Rest, terms: list[tuple[str, float]]) -> tuple[tuple[ModelTerm, ...], tuple[str, ...]]:
    """Terms with their code, and the states that these need.

    Args:
        rest: Names the joints.
        terms: Text and coefficient of each.
    """
    states: list[str] = []
    out = tuple(ModelTerm(text, _code(rest, text, states), coefficient) for text, coefficient in terms)
    return out, tuple(states)


def _measured(rest: Rest, name: str) -> str:
    """The input that a simulator has: a displacement since the last reversal is the position's own history."""
    return name.replace("dx.", "q.", 1) if name == f"dx.{rest.joint}" else name


def _code(rest: Rest, text: str, states: list[str]) -> str:
    """A term's text as an expression of Python over ``x["name"]``; histories become states.

    Args:
        rest: Names the joints.
        text: Of the term.
        states: Expressions of the states so far; new ones are added.
    """
    for name, factory in (("bristle", "Bristle"), ("slip", "Slip")):
        for found in re.findall(rf"{name}\(dx/({_NUMBER})\)", text):
            state = f"{factory}({f'q.{rest.joint}'!r}, {found})"
            text = text.replace(f"{name}(dx/{found})", _state(states, state))
    filters = (("low", "Low", "Hz"), ("late", "Late", "s"), ("resonator", "Resonator", "Hz"),
               ("resonator_rate", "ResonatorRate", "Hz"))  # fmt: skip
    for name, factory, unit in filters:
        for found in re.findall(rf"\b{name}\(([a-z]+, {_NUMBER} {unit}(?:, {_NUMBER})?)\)", text):
            of, *numbers = found.replace(f" {unit}", "").split(", ")
            state = f"{factory}({f'{of}.{rest.joint}'!r}, {', '.join(numbers)})"
            text = text.replace(f"{name}({found})", _state(states, state))
    for lag, mean in re.findall(rf"load\(({_NUMBER}) s, ({_NUMBER})\)", text):
        state = f"Load({supply_loads(rest.inputs, rest.joint)!r}, {lag}, {mean})"
        text = text.replace(f"load({lag} s, {mean})", _state(states, state))
    text = re.sub(r"\|([^|]*)\|", r"abs(\1)", text).replace("^", "**").replace("sign(", "side(")
    others = sorted((f"{kind}.{name}" for name in rest.others for kind in ("q", "v", "tau")), key=len, reverse=True)
    spelled = [(name, name) for name in others]
    spelled += [(kind, f"{kind}.{rest.joint}") for kind in ("q", "v", "a", "tl", "tau", "temp")] + [("t", "t")]
    # Marks first: what stands for one name must not be searched for the next.
    for mark, (short, _) in enumerate(spelled):
        text = re.sub(rf"(?<![\w.@]){re.escape(short)}(?![\w.(@])", f"@{mark}@", text)
    return re.sub(r"@(\d+)@", lambda found: f"x[{spelled[int(found[1])][1]!r}]", text)


def _state(states: list[str], expression: str) -> str:
    if expression not in states:
        states.append(expression)
    return f"s[{states.index(expression)}]"
