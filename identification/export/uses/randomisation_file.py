"""``randomisation.yaml`` (schema ``phantom-dyn-randomisation/1``): ranges for training in simulation."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.model.terms import KnownEffect
from identification.diagnosis.result import Bound, Finding
from identification.export.uses.mjcf_ranges import FieldRange, mjcf_ranges, without_fields
from identification.export.uses.randomisation import Randomisation, found_range, unseen_range
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.model.settings_file import settings_text

SCHEMA = "phantom-dyn-randomisation/1"
_TIMES = ("delay", "time_constant")


def randomisation_text(randomisation: Randomisation, known: tuple[KnownEffect, ...] = ()) -> str:
    """The text of ``randomisation.yaml``; nothing is rounded.

    Args:
        randomisation: What the robot may be.
        known: Effects that belong to the given model already.
    """
    try:
        fields = [_field_entry(field) for field in mjcf_ranges(randomisation, known)]
        note = _note(without_fields(randomisation, known))
    except PhantomDynError as error:
        fields, note = [], {"mjcf_note": str(error)}
    content = {
        "schema": SCHEMA,
        "robot": randomisation.robot.name,
        "control_step": randomisation.control_step,
        "found": _found_entries(randomisation),
        "correlation": randomisation.correlation.tolist(),
        "unseen": [
            {
                "effect": bound.effect,
                "joint": bound.joint,
                "parameter": bound.parameter,
                "unit": bound.unit,
                "range": list(unseen_range(bound)),
                **_steps(randomisation, bound.parameter, *unseen_range(bound)),
            }
            for bound in randomisation.unseen
        ],
        "mjcf": fields,
        **note,
    }
    return settings_text(content)


def _found_entries(randomisation: Randomisation) -> list[dict[str, object]]:
    out, place = [], 0
    for finding, effect in zip(randomisation.findings, randomisation.found, strict=True):
        parameters = effect_named(effect.effect).parameters(randomisation.robot, effect.joint)
        each = max(len(effect.theta) // len(parameters), 1)
        for k in range(len(effect.theta)):
            parameter = parameters[k // each]
            name = parameter.name + (f"[{k % each}]" if each > 1 else "")
            low, high = found_range(randomisation, place)
            out.append(
                {
                    "effect": effect.effect,
                    "joint": effect.joint,
                    "parameter": name,
                    "unit": parameter.unit,
                    "value": float(effect.theta[k]),
                    "std": float(randomisation.std[place]),
                    "range": [low, high],
                    "probability": _probability(finding),
                    **_steps(randomisation, parameter.name, low, high),
                }
            )
            place += 1
    return out


def _probability(finding: Finding) -> float | None:
    return float(finding.probability) if np.isfinite(finding.probability) else None


def _steps(randomisation: Randomisation, parameter: str, low: float, high: float) -> dict[str, object]:
    """A range of times in control steps."""
    if parameter not in _TIMES or randomisation.control_step is None:
        return {}
    return {"control_steps": [low / randomisation.control_step, high / randomisation.control_step]}


def _field_entry(field: FieldRange) -> dict[str, object]:
    return {
        "element": field.element,
        "name": field.name,
        "attribute": field.attribute,
        "index": field.index,
        "value": field.value,
        "range": list(field.found),
        "unseen_range": list(field.unseen),
        **({"needs": dict(field.needs)} if field.needs else {}),
    }


def _note(bounds: tuple[Bound, ...]) -> dict[str, str]:
    if not bounds:
        return {}
    names = dict.fromkeys(b.effect if b.joint is None else f"{b.effect} on {b.joint}" for b in bounds)
    return {"mjcf_note": f"Not seen and no number of corrected.xml, see unseen: {', '.join(names)}."}
