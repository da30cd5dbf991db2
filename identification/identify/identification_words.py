"""Words for an identification: sentences and table cells of the report, and the summary on the terminal."""

from __future__ import annotations

import numpy as np

from identification.identify.identification import IdentifiedModel, Parameter
from identification.words.diagnosis_words import capital, parameter_name
from identification.words.effect_words import effect_words
from identification.words.numbers_and_names import NO_BREAK, number, with_std, with_unit

IDENTIFIABILITY = {"alone": "alone", "combination": "in combination", "none": "not at all"}
"""Words for each value of a parameter's identifiability in ``identification.json``."""


def error_percent(share: float) -> str:
    """A relative error as a percentage with two digits, three from 99.5 to 99.9 %; a dash if it is not finite."""
    value = 100 * share
    if not np.isfinite(value):
        return "–"
    if value < 10:
        return f"{value:.2g}{NO_BREAK}%"
    return f"{value:.1f}{NO_BREAK}%" if 99.45 <= value < 99.95 else f"{value:.0f}{NO_BREAK}%"


def headline(found: IdentifiedModel) -> str:
    """A sentence on the number of estimated parameters and on how well they predict held-out data."""
    sure = sum(parameter.identified for parameter in (*found.base, *found.others))
    before = np.array([joint.given for joint in found.joints])
    after = np.array([joint.relative for joint in found.joints])
    head = f"{found.rank} parameters were estimated, {sure} of them more than two standard deviations from zero"
    if not np.isfinite(after).any():
        return f"{head}."
    low, high = error_percent(float(np.nanmin(after))), error_percent(float(np.nanmax(after)))
    error = low if low == high else f"{low} to {high}"
    given = error_percent(float(np.nanmedian(before)))
    middle = "" if len(found.joints) == 1 else " in the median"
    return f"{head}; on held-out data the torque error is {error} (given model: {given}{middle})."


def law_cell(parameter: Parameter, parameters: tuple[Parameter, ...]) -> str:
    """Law of a friction or drive parameter, with the name of the parameter if its law has several parameters."""
    law = capital(effect_words(parameter.effect or "").name.removeprefix("a "))
    several = sum((p.joint, p.effect) == (parameter.joint, parameter.effect) for p in parameters) > 1
    return f"{law}: {parameter_name(parameter.name.rpartition('.')[2])}" if several else law


def value_cell(parameter: Parameter) -> str:
    """Value with its standard deviation and unit."""
    return with_unit(with_std(parameter.value, parameter.std), parameter.unit)


def relative_cell(parameter: Parameter) -> str:
    """Relative standard deviation as a percentage; a dash if it is not finite."""
    relative = 100 * parameter.relative_std
    if not np.isfinite(relative):
        return "–"
    return f"{relative:.2g} %" if relative < 100 else "over 100 %"


def error_cells(found: IdentifiedModel) -> list[tuple[str, ...]]:
    """Rows of the table of errors, one for each joint.

    The columns are: joint; relative torque error of the given model and of the identified model on held-out data;
    relative error of the identified model on the samples of the fit; RMS error on held-out data; RMS difference between
    the exported model with all parameters and the fit of the base parameters; unit; number of samples.
    """
    return [
        (
            joint.joint,
            error_percent(joint.given),
            error_percent(joint.relative),
            error_percent(joint.fitted),
            number(joint.rms),
            number(difference),
            joint.unit,
            str(joint.samples),
        )
        for joint, difference in zip(found.joints, found.departure, strict=True)
    ]


def export_sentence(difference: float, tolerance: float, loaded_with: str) -> str:
    """A sentence on how much the torques of an exported model differ after its file was loaded again."""
    if not loaded_with:
        return "It was not loaded again."
    if difference == 0:
        return f"Loaded again with {loaded_with}, its torques are the same."
    return (
        f"Loaded again with {loaded_with}, its torques differ by at most {difference:.1g} of the largest "
        f"(allowed: {tolerance:g})."
    )


def summary(found: IdentifiedModel) -> str:
    """The summary for the terminal."""
    lines = [headline(found), f"held out: {found.held_out}; band 0 to {found.band_hz[1]:.3g} Hz; {found.estimator}"]
    for joint in found.joints:
        lines.append(
            f"  {joint.joint}: torque error {error_percent(joint.relative)}, given model {error_percent(joint.given)}"
        )
    if found.bias:
        lines.append(found.bias)
    if found.others:
        lines.append("friction and drives:")
    for parameter in found.others:
        doubt = "" if parameter.identified else " (not distinguished from zero)"
        lines.append(f"  {parameter.name}: {value_cell(parameter)}, {relative_cell(parameter)}{doubt}")
    lines.append(
        f"links: {len(found.base)} base parameters, {sum(p.identified for p in found.base)} of them not zero; "
        f"condition number {found.condition:.3g}"
    )
    lines += [f"warning: {warning}" for warning in found.warnings]
    for export in found.exports:
        if export.text:
            lines.append(f"{export.file}: {export_sentence(export.difference, export.tolerance, export.loaded_with)}")
        lines += [f"  {note}" for note in export.left_out]
    return "\n".join(lines)
