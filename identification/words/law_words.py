"""Sentences on the law of the residual: the inputs that it depends on, and its formula."""

from __future__ import annotations

from typing import TYPE_CHECKING

from identification.diagnosis.input_names import input_of, is_frequency
from identification.diagnosis.result import Unexplained
from identification.words.diagnosis_words import joined, place, share_words
from identification.words.numbers_and_names import number, percent

if TYPE_CHECKING:
    from identification.diagnosis.residual_law import Dependence, Law

_KINDS = {
    "q": "the position",
    "v": "the velocity",
    "a": "the acceleration",
    "dx": "the displacement since the last reversal",
    "tl": "the transmitted torque",
    "tau": "the drive torque",
    "temp": "the drive temperature",
}


def input_words(name: str, joint: str) -> str:
    """``the velocity`` of the joint itself, ``the velocity of j2`` of another joint, or ``the frequency of ...``."""
    if is_frequency(name):
        return f"the frequency of {input_words(input_of(name), joint)}"
    kind, _, of = name.partition(".")
    if kind == "t":
        return "time"
    return _KINDS.get(kind, kind) + ("" if of == joint else f" of {of}")


def inputs_words(names: tuple[str, ...], joint: str) -> str:
    """Several inputs in one phrase."""
    return joined([input_words(name, joint) for name in names])


def law_line(left: Unexplained) -> str:
    """One line with the law of the residual, or the inputs that it depends on; empty if neither is known."""
    found, law = left.dependence, left.law
    if found is None or not found.inputs:
        return ""
    on = f"What is left on {place('', found.joint)} depends on {inputs_words(found.inputs, found.joint)}"
    if law is None:
        return f"{on}; no formula stands out."
    like = f", looks most like {law.like}" if law.like else ""
    share = share_words(law.gap_closed, law.gap_closed_interval)
    return f"{on}: {law.formula} [{found.unit}] closes {share} of the gap{like}."


def dependence_sentences(found: Dependence, law: Law | None) -> list[str]:
    """Sentences of the report on the inputs of the residual and its formula."""
    if not found.inputs:
        return [f"No recorded input predicts what is left on {place('', found.joint)} better than chance."]
    has_gain = law is not None or any(set(gain.inputs) == set(found.inputs) for gain in found.gains)
    out = [f"It depends on {inputs_words(found.inputs, found.joint)}."]
    if not has_gain:
        inputs = "it" if len(found.inputs) == 1 else "them"
        out.append(
            f"Most formulas that are fitted to random draws of the recording use {inputs}, but smooth functions of "
            "other inputs predict more."
        )
    dynamic = [input_words(input_of(name), found.joint) for name in found.inputs if is_frequency(name)]
    if dynamic:
        out.append(
            f"Its response to {joined(dynamic)} has a gain and a phase that change with the frequency: it "
            "depends on past values, too."
        )
    if law is None:
        out.append(
            "No short formula is shown: when stretches of the recording are drawn at random again and again, the best "
            "terms change."
        )
        return out
    out.append(
        f"The formula closes {share_words(law.gap_closed, law.gap_closed_interval)} of the gap and "
        f"{percent(found.predicted_share)} of the squares of what is left, on {found.blocks} stretches that neither "
        "its choice nor its fit has seen."
    )
    out.append(
        f"In {percent(found.same_terms)} of random draws of these stretches the formula has terms of the same kinds."
    )
    if law.like:
        out.append(f"It looks most like {law.like}.")
    ranges = [
        f"{name} from {number(low)} to {number(high)}" + (" Hz" if is_frequency(name) else "")
        for name, (low, high) in law.valid.items()
    ]
    if ranges:
        out.append(f"It is known to hold only where there was data: {joined(ranges)}.")
    return out
