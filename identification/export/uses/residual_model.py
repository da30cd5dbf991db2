"""Writes the model of the residual as ``residual.py``, which needs only NumPy, and as the table ``residual.csv``."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.csv_cells import text_cell
from identification.diagnosis.input_names import input_of
from identification.diagnosis.result import Diagnosis
from identification.export.file_names import RESIDUAL, RESIDUAL_TABLE
from identification.export.uses.feedforward import loaded
from identification.notes import Code, Note
from identification.words.numbers_and_names import number, percent
from phantom_dyn import __version__

if TYPE_CHECKING:
    from identification.diagnosis.residual_law import ResidualModel

_PLACES = 41  # number of values of an input in the table (of a velocity: in both directions together)
_AXES = 2  # number of inputs that vary in the table; the others have the middle of their range


def residual_of(diagnosis: Diagnosis) -> ResidualModel | None:
    """The residual model of a diagnosis; None without one."""
    found = diagnosis.unexplained.dependence
    return None if found is None else found.model


def residual_code(model: ResidualModel) -> str:
    """The text of ``residual.py``."""
    functions = Path(__file__).with_name("residual_functions.txt").read_text(encoding="utf-8")
    constants = {"JOINT": model.joint, "UNIT": model.unit, "SLOW": model.slow, "VALID": dict(model.valid)}
    lines = [f"{name} = {value!r}" for name, value in constants.items()]
    terms = [f"        {term.coefficient!r} * ({term.code}),  # {term.text!a}" for term in model.terms]
    lines += ["", "", "def terms(x, s):", '    """Terms of the sum, from inputs and states."""', "    return ("]
    lines += [*terms, "    )", "", "", "def states():", '    """Histories of the inputs, at the start of a motion."""']
    lines += [f"    return [{', '.join(model.states)}]"]
    return (
        f'"""{_docstring(model)}"""\n\nimport numpy as np\nfrom numpy import cos, exp, sin  # noqa: F401\n\n'
        + "\n".join(lines)
        + "\n"
        + functions
    )


def _docstring(model: ResidualModel) -> str:
    """The docstring of the file: its use, its accuracy, and the ranges in which it is valid."""
    kind = (
        "It is the law in the report, fitted to the residual of the corrected model. Further terms correct the errors\n"
        "that this model has because it was fitted without the law."
        if model.contains_law
        else "It is the sum of terms with the smallest error on held-out data, not a law: use it only within its data."
    )
    bands = "".join(
        f"\nIts response to {input_of(name)!a} has memory, and starts at rest at the first call. It is known from "
        f"{number(low)} to {number(high)} Hz."
        for name, (low, high) in model.bands.items()
    )
    ranges = "\n".join(f"    {name!a}: {number(low)} to {number(high)}" for name, (low, high) in model.valid.items())
    return f"""Torque on one joint that the corrected model lacks. Written by phantom-dyn {__version__}.

{kind}
It predicts {percent(model.predicted_share)} of the sum of squares of that joint's residual, on held-out data.\
{bands}

    residual = Residual()
    torque = residual.torque({{"t": t, "q.<joint>": q, "v.<joint>": v, ...}})    # once for each step

The torque acts on the joint JOINT, in UNIT: add it to the generalised forces in a simulation of the corrected model,
and subtract it from a feedforward. Names of inputs are t for time, and for each joint q position, v velocity,
a acceleration, tl torque through the transmission and tau drive torque (both of the given model without the findings),
and temp temperature. Beyond VALID, the value at the end of the range is used, and outside(x) names these inputs:
{ranges}
"""


def residual_table(model: ResidualModel, diagnosis: Diagnosis) -> str:
    """The text of ``residual.csv``: the torque as a function of one or two inputs.

    The other inputs have the middle of their range. The table shows a steady state: the states of the model are those
    after a long motion in the direction of the velocity with constant inputs, and a load has its usual value.

    Args:
        model: The residual model.
        diagnosis: The diagnosis, with the inputs in the order of their importance, and the id of the run.
    """
    law = loaded(residual_code(model), RESIDUAL)
    axes = _axes(model, diagnosis)
    middle = {name: 0.5 * (low + high) for name, (low, high) in model.valid.items()}
    speed = f"v.{model.joint}"
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["joint", *(text_cell(name) for name in axes), "torque", "run"])
    for place in product(*axes.values()):
        at = {**middle, **dict(zip(axes, place, strict=True))}
        torque = sum(law["terms"](at, _settled_states(law, at, speed)))
        table.writerow([text_cell(model.joint), *place, float(torque), diagnosis.run])
    return text.getvalue()


def _settled_states(law: Mapping[str, Any], at: Mapping[str, float], speed: str) -> list[float]:
    """Steady states of the model after a long motion in the direction of the velocity with constant inputs.

    Args:
        law: Names that ``residual.py`` defines.
        at: Value of each input.
        speed: Name of the joint's velocity among the inputs.
    """
    direction = law["side"](at.get(speed, 0.0))
    out: list[float] = []
    for state in law["states"]():
        if isinstance(state, law["ResonatorRate"]):
            out.append(0.0)
        elif isinstance(state, law["Low"] | law["Late"] | law["Resonator"]):
            out.append(at[state.name])
        else:
            out.append(1.0 if isinstance(state, law["Load"]) else direction)
    return out


def _axes(model: ResidualModel, diagnosis: Diagnosis) -> dict[str, list[float]]:
    """Values of the inputs that vary in the table: the most important ones; the velocity if the model has states."""
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
    """The note in the report that names the two files."""
    numbers = {"files": (RESIDUAL, RESIDUAL_TABLE), "lawful": model.contains_law, "memory": bool(model.bands)}
    return Note(Code.RESIDUAL_HELD, model.joint, {**numbers, "closed": model.predicted_share})
