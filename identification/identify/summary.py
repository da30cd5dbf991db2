"""The identification in a few lines for the terminal."""

from __future__ import annotations

from identification.identify.result import Identification
from identification.identify.words import error_percent, export_sentence, headline, relative_cell, value_cell


def summary(found: Identification) -> str:
    """What was found, a line for each fact."""
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
        doubt = "" if parameter.identified else " (not told from zero)"
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
