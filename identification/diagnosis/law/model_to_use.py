"""A residual model to use beside the corrected model: the law, or a sum of terms that fits without being one.

The corrected model is what it is: its moves within the tolerances were fitted without the law. So the terms of the law
are fitted to what that model leaves as it is, and others join them where held-out blocks ask for it.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from identification.diagnosis.law.formula_search import Choice, Columns, best_size, cross_validated
from identification.diagnosis.law.rest import Rest
from identification.diagnosis.law.selection import Free, stepwise
from identification.diagnosis.rest_law import ModelTerm, ResidualModel

Array = np.ndarray

_MOST = 6
_LEAST = 0.3  # of the rest's squares that a model has to foresee to be worth using
_SLOW = 0.01  # of the fast end of the speeds, below which a direction is rounded off

_NUMBER = r"[-+0-9.eE]+"


def model_of(rest: Rest, columns: Columns, choice: Choice, *, lawful: bool) -> ResidualModel | None:
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
    loss = cross_validated(rest, plain, _MOST)
    whole = plain.products.summed((rest.folds >= 0).astype(float))
    path = [(), *stepwise(plain.terms, whole, _MOST)]
    size = min(best_size(loss), len(path) - 1)
    closed = float(1.0 - loss[size].sum() / max(loss[0].sum(), 1e-300))
    if size == 0 or closed < _LEAST:
        return None
    at = plain.terms.columns(path[size])
    theta = -whole.fitted(at) / plain.size[at]
    texts = {}
    for k in path[size]:
        term = plain.library[k]
        texts |= dict(zip((int(plain.terms.first[k]), int(plain.terms.second[k])), term.texts, strict=False))
    inputs = frozenset().union(*(plain.library[k].inputs for k in path[size]))
    needed = tuple(name for name in rest.inputs if name in inputs)
    states: list[str] = []
    terms = tuple(
        ModelTerm(texts[column], _code(rest, texts[column], states), float(value))
        for column, value in zip(at, theta, strict=True)
    )
    speed = f"v.{rest.joint}"
    fast = float(np.percentile(np.abs(rest.series(speed)), 90)) if speed in rest.inputs else 1.0
    same = lawful and set(path[size]) == set(choice.chosen)
    ranges = rest.ranges(tuple(_measured(rest, name) for name in needed))
    return ResidualModel(rest.joint, rest.unit, terms, tuple(states), ranges, closed, same, _SLOW * fast)


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
            text = text.replace(f"{name}(dx/{found})", _state(states, f'{factory}("q.{rest.joint}", {found})'))
    for lag, mean in re.findall(rf"load\(({_NUMBER}) s, ({_NUMBER})\)", text):
        names = tuple(name for name in rest.inputs if name.startswith("tau."))
        own = f"tau.{rest.joint}"
        loads = names if own in names else (f"tl.{rest.joint}", *names)
        text = text.replace(f"load({lag} s, {mean})", _state(states, f"Load({loads!r}, {lag}, {mean})"))
    others = sorted((f"{kind}.{name}" for name in rest.others for kind in ("q", "v", "tau")), key=len, reverse=True)
    held = {}
    for number, name in enumerate(others):
        if name in text:
            held[f"@{number}@"] = f"x[{name!r}]"
            text = re.sub(rf"(?<![\w.]){re.escape(name)}(?![\w.])", f"@{number}@", text)
    text = re.sub(r"\|([^|]*)\|", r"abs(\1)", text).replace("^", "**").replace("sign(", "side(")
    for kind in ("q", "v", "tl", "tau", "temp"):
        text = re.sub(rf"(?<![\w.@\"\[']){kind}(?![\w.(@])", f"x['{kind}.{rest.joint}']", text)
    text = re.sub(r"(?<![\w.@\"\['])t(?![\w.(@])", "x['t']", text)
    for mark, name in held.items():
        text = text.replace(mark, name)
    return text


def _state(states: list[str], expression: str) -> str:
    if expression not in states:
        states.append(expression)
    return f"s[{states.index(expression)}]"
