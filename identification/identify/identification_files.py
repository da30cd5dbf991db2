"""Writes the files of an identification: ``identification.json`` (schema ``identification/1``), models and report.

If one of these files cannot be written, none is.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from uuid import uuid4

from identification.export.file_names import MJCF, URDF
from identification.file_sets import with_run, write_together
from identification.files import require_not_read, require_own, require_writable_folder
from identification.identify.identification import Export, IdentifiedModel, Parameter

SCHEMA = "identification/1"

Json = dict[str, "Json"] | list["Json"] | str | float | int | bool | None

NAMES = ("identification.json", "report.html", URDF, MJCF)


def to_json(found: IdentifiedModel, *, run: str = "") -> dict[str, Json]:
    """The content of ``identification.json``. Numbers are not rounded; a number that is not finite becomes None."""
    return {
        "schema": SCHEMA,
        "run": run,
        "robot": found.robot,
        "recordings": list(found.recordings),
        "estimator": found.estimator,
        "friction_terms": list(found.terms),
        "band_hz": [*found.band_hz],
        "samples": found.samples,
        "rank": found.rank,
        "rank_of_exciting_motion": found.excitable,
        "condition_number": _number(found.condition),
        "bias_of_least_squares": found.bias or None,
        "base_parameters": [_parameter(parameter) for parameter in found.base],
        "friction_and_actuator_parameters": [
            {"joint": parameter.joint, "effect": parameter.effect, **_parameter(parameter)}
            for parameter in found.others
        ],
        "not_identified": [{"name": u.name, "unit": u.unit, "why": u.why} for u in found.unidentified],
        "bodies": [
            {"body": b.body, "this_recording": {**b.this_recording}, "any_motion": {**b.any_motion}}
            for b in found.bodies
        ],
        "held_out": found.held_out,
        "joints": [
            {
                "joint": joint.joint,
                "unit": joint.unit,
                "rms": _number(joint.rms),
                "relative_error": _number(joint.relative),
                "relative_error_given_model": _number(joint.given),
                "relative_error_fit": _number(joint.fitted),
                "full_model_rms_from_fit": _number(departure),
                "hold_out_samples": joint.samples,
            }
            for joint, departure in zip(found.joints, found.departure, strict=True)
        ],
        "full_model": found.full_words,
        "exports": [_export(export) for export in found.exports],
        "warnings": list(found.warnings),
        "seconds": found.seconds,
        "version": found.version,
    }


def json_text(found: IdentifiedModel, *, run: str = "") -> str:
    """The text of ``identification.json``; ``run`` is the id that all files of one run contain."""
    return json.dumps(to_json(found, run=run), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _parameter(parameter: Parameter) -> dict[str, Json]:
    """Entry of one parameter."""
    return {
        "name": parameter.name,
        "value": _number(parameter.value),
        "std": _number(parameter.std),
        "relative_std": _number(parameter.relative_std),
        "unit": parameter.unit,
        "regroups": parameter.regroups or None,
        "identified": parameter.identified,
        "why_not": parameter.why or None,
    }


def _export(export: Export) -> dict[str, Json]:
    """Entry of one model file."""
    return {
        "file": export.file,
        "written": bool(export.text),
        "loaded_again_with": export.loaded_with or None,
        "largest_relative_difference": _number(export.difference),
        "tolerance": export.tolerance,
        "notes": list(export.left_out),
    }


def _number(value: float) -> float | None:
    """The number, or None if it is not finite, which JSON cannot express."""
    return float(value) if math.isfinite(value) else None


def check_folder(out: Path, read: Iterable[str | Path | None] = ()) -> None:
    """Raise an error if the files cannot be written into a folder, or would replace an input or a file of the user.

    Args:
        out: The folder.
        read: Input files.

    Raises:
        UsageError: If ``out`` is no folder, a file to write is a folder or an input, or writing is not allowed.
    """
    require_writable_folder(out, NAMES)
    require_not_read(read, (out / name for name in NAMES))
    require_own(out, NAMES, index=NAMES[0])


def write_outputs(found: IdentifiedModel, out: Path) -> tuple[Path, ...]:
    """Write ``identification.json``, ``report.html`` and the models into a folder, which is created if it is missing.

    Model files of an earlier run that are not written again are removed, so that all files are of one run.

    Args:
        found: The identification.
        out: The folder; other files in it are kept.

    Returns:
        Paths of the written files.

    Raises:
        UsageError: If a file cannot be written; then none is.
    """
    # Imported here, because libraries of the report take long to load.
    from identification.identify.identification_report import report_html

    check_folder(out)
    texts = {"identification.json": json_text(found), "report.html": report_html(found)}
    texts |= {export.file: export.text for export in found.exports if export.text}
    run, index = uuid4().hex, NAMES[0]
    stamped = {name: with_run(name, text, run) for name, text in texts.items() if name != index}
    stamped[index] = json_text(found, run=run)
    write_together(out, stamped, obsolete=NAMES)
    return tuple(out / name for name in texts)
