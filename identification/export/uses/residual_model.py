"""Residual model to use now: ``residual.py``, which needs NumPy alone, and ``residual.csv``, a table for simulators."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.csv_cells import text_cell
from identification.diagnosis.input_names import base_of
from identification.diagnosis.result import Diagnosis
from identification.notes import Code, Note
from identification.words.numbers_and_names import number, percent
from phantom_dyn import __version__

if TYPE_CHECKING:
    from identification.diagnosis.rest_law import ResidualModel

_PLACES = 41  # of the table over one input, of its two directions over a velocity
_AXES = 2  # inputs of the table; others are in the middle of their range


def residual_of(diagnosis: Diagnosis) -> ResidualModel | None:
    """The residual model that a diagnosis offers, None without one."""
    found = diagnosis.unexplained.dependence
    return None if found is None else found.model


def residual_code(model: ResidualModel) -> str:
    """The text of ``residual.py``."""
    functions = Path(__file__).with_name("residual_functions.txt").read_text(encoding="utf-8")
    constants = {"JOINT": model.joint, "UNIT": model.unit, "SLOW": model.slow, "VALID": dict(model.valid)}
    lines = [f"{name} = {value!r}" for name, value in constants.items()]
    terms = [f"        {term.coefficient!r} * ({term.code}),  # {term.text!a}" for term in model.terms]
    lines += ["", "", "def terms(x, s):", '    """Terms of the sum, from inputs and states."""', "    return ("]
    lines += [*terms, "    )", "", "", "def states():", '    """Histories, fresh."""']
    lines += [f"    return [{', '.join(model.states)}]"]
    return (
        f'"""{_docstring(model)}"""\n\nimport numpy as np\nfrom numpy import cos, exp, sin  # noqa: F401\n\n'
        + "\n".join(lines)
        + "\n"
        + functions
    )


def _docstring(model: ResidualModel) -> str:
    kind = (
        "It is the law that the report shows, fitted to what the corrected model leaves, with terms that make up for\n"
        "how the absence of the law has bent that model."
        if model.lawful
        else "It is a sum of terms with the smallest error on held-out data, no law: trust it within its data only."
    )
    bands = "".join(
        f"\nIts answer to {base_of(name)!a} has memory, from rest at the first call; it is known from "
        f"{number(low)} to {number(high)} Hz."
        for name, (low, high) in model.bands.items()
    )
    ranges = "\n".join(f"    {name!a}: {number(low)} to {number(high)}" for name, (low, high) in model.valid.items())
    return f"""Torque on one joint that the corrected model lacks. Written by phantom-dyn {__version__}.

{kind}
It foresees {percent(model.rest_closed)} of the squares of what the corrected model leaves there, on held-out data.\
{bands}

    residual = Residual()
    torque = residual.torque({{"t": t, "q.<joint>": q, "v.<joint>": v, ...}})    # once a step

The torque acts on the joint JOINT, in UNIT: add it to the generalised forces of a simulation of the corrected model,
and take it from a feedforward. Inputs by name: q position, v velocity, a acceleration, tl torque that the transmission
passes on and tau drive torque, both of the given model without what was found, temp temperature, each of a joint, and
t time. Beyond VALID the value at the end of the
range holds, and outside(x) names the inputs that are there:
{ranges}
"""


def loaded(code: str) -> dict[str, Any]:
    """The names that the text of a ``residual.py`` defines."""
    names: dict[str, Any] = {"__name__": "residual"}
    exec(compile(code, "residual.py", "exec"), names)
    return names


def residual_table(model: ResidualModel, diagnosis: Diagnosis) -> str:
    """The text of ``residual.csv``: the torque over one or two inputs, the others in the middle of their ranges.

    Histories are at their ends, where a long motion in the direction of the velocity brings them; a load is the usual,
    and an answer with memory is what inputs that stay leave of it: the table has no frequency.

    Args:
        model: What is written.
        diagnosis: Says which inputs matter most, and the run.
    """
    law = loaded(residual_code(model))
    axes = _axes(model, diagnosis)
    middle = {name: 0.5 * (low + high) for name, (low, high) in model.valid.items()}
    speed = f"v.{model.joint}"
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["joint", *(text_cell(name) for name in axes), "torque", "run"])
    for place in product(*axes.values()):
        at = {**middle, **dict(zip(axes, place, strict=True))}
        torque = sum(law["terms"](at, _ends(law, at, speed)))
        table.writerow([text_cell(model.joint), *place, float(torque), diagnosis.run])
    return text.getvalue()


def _ends(law: Mapping[str, Any], at: Mapping[str, float], speed: str) -> list[float]:
    direction = law["side"](at.get(speed, 0.0))
    ends: list[float] = []
    for state in law["states"]():
        if isinstance(state, law["ResonatorRate"]):
            ends.append(0.0)
        elif isinstance(state, law["Low"] | law["Late"] | law["Resonator"]):
            ends.append(at[state.name])
        else:
            ends.append(1.0 if isinstance(state, law["Load"]) else direction)
    return ends


def _axes(model: ResidualModel, diagnosis: Diagnosis) -> dict[str, list[float]]:
    """Places of the inputs of the table: those that the law names first; the velocity where there are histories."""
    found = diagnosis.unexplained.dependence
    speed = f"v.{model.joint}"
    wanted = [name for name in (() if found is None else found.inputs) if name in model.valid]
    wanted += [name for name in model.valid if name not in wanted]
    if model.states and speed in model.valid and speed not in wanted[:_AXES]:
        wanted.insert(0, speed)
    out: dict[str, list[float]] = {}
    for name in wanted[:_AXES]:
        low, high = model.valid[name]
        if name == speed and low < 0.0 < high:
            steps = np.geomspace(1e-3, 1.0, _PLACES // 2)
            out[name] = [*(low * steps[::-1]).tolist(), 0.0, *(high * steps).tolist()]
        else:
            out[name] = np.linspace(low, high, _PLACES).tolist()
    return out


def residual_note(model: ResidualModel) -> Note:
    """A note on the two files."""
    numbers = {"files": ("residual.py", "residual.csv"), "lawful": model.lawful, "memory": bool(model.bands)}
    return Note(Code.RESIDUAL_HELD, model.joint, {**numbers, "closed": model.rest_closed})
