"""Section of the report on the law of the residual: its inputs, curves over them, and its formula."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from identification.diagnosis.input_names import base_of
from identification.diagnosis.result import Unexplained
from identification.reporting.charts.chart import AFTER, BEFORE, Panel, chart
from identification.reporting.charts.chart_marks import Curve, Ribbon
from identification.words.diagnosis_words import capital
from identification.words.law_words import dependence_sentences, input_words, inputs_words
from identification.words.numbers_and_names import number, percent

if TYPE_CHECKING:
    from identification.diagnosis.residual_law import Dependence, FrequencyResponse, InputGain, Law

_ROWS = 8  # inputs and pairs that are shown


def law_view(left: Unexplained) -> dict[str, Any] | None:
    """Values of the section on the residual, by their names in the template; None if no law was looked for.

    ``terms`` has text, coefficient, interval and unit of each term, and how often it is chosen. ``gains`` has inputs,
    the share that they predict, its interval, and whether that is beyond chance. ``chance`` is the share that chance
    predicts. ``figures`` are curves over each input; for a frequency they are gain and phase over it.
    """
    found = left.dependence
    if found is None:
        return None
    others = found.gains[_ROWS:]
    shown = [*found.gains[:_ROWS], *(gain for gain in others if set(gain.inputs) == set(found.inputs))]
    return {
        "joint": found.joint,
        "sentences": dependence_sentences(found, left.law),
        "formula": "" if left.law is None else f"{left.law.formula} [{found.unit}]",
        "terms": _terms(found, left.law),
        "gains": [_gain(gain, found.joint) for gain in shown],
        "chance": percent(max((gain.chance for gain in found.gains), default=0.0)),
        "figures": [
            *(Markup(_figure(found, name)) for name in dict.fromkeys(curve.input for curve in found.curves)),
            *(Markup(_response_figure(found, response)) for response in found.responses),
        ],
    }


def _terms(found: Dependence, law: Law | None) -> list[tuple[str, ...]]:
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
    sure = gain.gain > gain.chance and gain.interval[0] > 0.0
    return (
        capital(inputs_words(gain.inputs, joint)),
        percent(gain.gain) if gain.gain > 0.0 else "none",
        f"{percent(max(gain.interval[0], 0.0))} to {percent(max(gain.interval[1], 0.0))}",
        "yes" if sure else "no",
    )


def _figure(found: Dependence, name: str) -> str:
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
    words = input_words(base_of(response.input), found.joint)
    title = f"Response of the torque on {found.joint} to {words} over the frequency"
    return chart(tuple(panels), f"frequency of {words} [Hz]", (5.7, 4.6), title)
