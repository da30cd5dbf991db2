"""Prepares the report's section on the law of the residual: its inputs, its formula, and curves over each input."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from identification.diagnosis.input_names import input_of
from identification.diagnosis.result import Unexplained
from identification.reporting.charts.chart import AFTER, BEFORE, Panel, chart
from identification.reporting.charts.chart_marks import Curve, Ribbon
from identification.words.diagnosis_words import capital
from identification.words.law_words import dependence_sentences, input_words, inputs_words
from identification.words.numbers_and_names import number, percent

if TYPE_CHECKING:
    from identification.diagnosis.residual_law import Dependence, FrequencyResponse, InputGain, Law

_ROWS = 8  # number of inputs and pairs of inputs in the table


def law_view(residual: Unexplained) -> dict[str, Any] | None:
    """Values of the section, by their names in the template; None if no law was searched.

    ``terms`` contains text, coefficient, interval and unit of each term, and the share of resampled fits that choose
    the term. ``gains`` contains inputs, the share of the residual that they predict, its interval, and whether this
    share exceeds chance. ``chance`` is the share that can be predicted by chance. ``figures`` are curves over each
    input, and gain and phase over frequency for inputs with a frequency response.
    """
    found = residual.dependence
    if found is None:
        return None
    others = found.gains[_ROWS:]
    shown = [*found.gains[:_ROWS], *(gain for gain in others if set(gain.inputs) == set(found.inputs))]
    return {
        "joint": found.joint,
        "sentences": dependence_sentences(found, residual.law),
        "formula": "" if residual.law is None else f"{residual.law.formula} [{found.unit}]",
        "terms": _terms(found, residual.law),
        "gains": [_gain(gain, found.joint) for gain in shown],
        "chance": percent(max((gain.chance for gain in found.gains), default=0.0)),
        "figures": [
            *(Markup(_figure(found, name)) for name in dict.fromkeys(curve.input for curve in found.curves)),
            *(Markup(_response_figure(found, response)) for response in found.responses),
        ],
    }


def _terms(found: Dependence, law: Law | None) -> list[tuple[str, ...]]:
    """Rows of the table of terms; none without a law."""
    if law is None:
        return []
    return [
        (
            "constant" if term.term == "1" else term.term,
            number(term.coefficient),
            f"{number(term.interval[0])} to {number(term.interval[1])}",
            term.unit,
            percent(term.chosen),
        )
        for term in found.terms
    ]


def _gain(gain: InputGain, joint: str) -> tuple[str, ...]:
    """Row of the table of inputs."""
    sure = gain.gain > gain.chance and gain.interval[0] > 0.0
    return (
        capital(inputs_words(gain.inputs, joint)),
        percent(gain.gain) if gain.gain > 0.0 else "none",
        f"{percent(max(gain.interval[0], 0.0))} to {percent(max(gain.interval[1], 0.0))}",
        "yes" if sure else "no",
    )


def _figure(found: Dependence, name: str) -> str:
    """Draws the torque over one input, with one curve for each direction of motion if there are two."""
    curves = [curve for curve in found.curves if curve.input == name]
    lines, ribbons = [], []
    for curve, colour in zip(curves, (BEFORE, AFTER), strict=False):
        x, middle, low, high = (np.array(part) for part in (curve.x, curve.middle, curve.low, curve.high))
        lines.append(Curve(x, middle, colour, 1.8, curve.direction))
        ribbons.append(Ribbon(x, low, high, colour))
    label = f"{'force' if found.unit == 'N' else 'torque'} [{found.unit}]"
    words = input_words(name, found.joint)
    panel = Panel(label, tuple(lines), zero=True, ribbons=tuple(ribbons))
    return chart((panel,), f"{words} [{curves[0].unit}]", (5.7, 3.0), f"Torque on {found.joint} over {words}")


def _response_figure(found: Dependence, response: FrequencyResponse) -> str:
    """Draws gain and phase of a frequency response."""
    x = np.array(response.hz)
    gain = f"gain [{response.unit}]" if response.unit else "gain"
    panels = [
        Panel(
            label,
            (Curve(x, np.array(middle), BEFORE, 1.8, ""),),
            ribbons=(Ribbon(x, np.array(low), np.array(high), BEFORE),),
        )
        for label, middle, low, high in (
            (gain, response.gain, response.gain_low, response.gain_high),
            ("phase [deg]", response.phase, response.phase_low, response.phase_high),
        )
    ]
    words = input_words(input_of(response.input), found.joint)
    title = f"Response of the torque on {found.joint} to {words} over the frequency"
    return chart(tuple(panels), f"frequency of {words} [Hz]", (5.7, 4.6), title)
