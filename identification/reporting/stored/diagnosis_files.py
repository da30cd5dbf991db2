"""Writes the files of a diagnosis: ``diagnosis.json`` (schema ``gap-diagnosis/3``), report, models, proposed motion.

If one file cannot be written, no file is written.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from identification.diagnosis.columns.structure import STRUCTURES
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import (
    Adjusted,
    Bound,
    Diagnosis,
    EffectAt,
    Finding,
    JointGap,
    NotTestable,
    Unexplained,
)
from identification.diagnosis.written import WrittenFile
from identification.engine.claims import Claim
from identification.export.all_files import export_texts, incomplete_file_notes
from identification.export.file_names import NAMES as ALWAYS
from identification.export.file_names import OPTIONAL
from identification.file_sets import with_run, write_together
from identification.files import (
    looks_like_log,
    require_not_read,
    require_own,
    require_own_file,
    require_writable,
    require_writable_folder,
    temporary_beside,
)
from identification.words.diagnosis_words import finding_name
from identification.words.note_words import sentences
from phantom_dyn.errors import UsageError
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import looks_like_robot

if TYPE_CHECKING:
    from identification.diagnosis.residual_law import Dependence
    from identification.geometry.result import GeometryResult

SCHEMA = "gap-diagnosis/3"

Json = dict[str, "Json"] | list["Json"] | str | float | int | bool | None

INDEX, REPORT, NEXT = "diagnosis.json", "report.html", "next.csv"
MODELS = (*ALWAYS, *OPTIONAL)
"""Names of the files with models and laws."""
DEPENDENCE_KEYS = {"predicted_share": "rest_closed", "responses": "answers"}
"""Keys in the file for fields of `Dependence` whose name differs from the key."""
_NAMELESS = frozenset(structure.name for structure in STRUCTURES)


def to_json(diagnosis: Diagnosis) -> dict[str, Json]:
    """The content of ``diagnosis.json`` as plain types, with all digits, and null for numbers that are not finite."""
    frames, in_poses, geometry = ({}, [], {}) if diagnosis.geometry is None else _pose_entries(diagnosis.geometry)
    return {
        "schema": SCHEMA,
        "verdict": diagnosis.verdict,
        "run": diagnosis.run,
        "robot": diagnosis.robot,
        "gap": _plain(asdict(diagnosis.gap)),
        # Residuals by regime are left out: ``corrected.yaml`` has them for the next diagnosis.
        "joints": [_plain_without("left", joint) for joint in diagnosis.joints],
        "band_hz": _plain(diagnosis.band_hz),
        **frames,
        "findings": [*(_finding(finding) for finding in diagnosis.findings), *in_poses],
        "minor": [_finding(finding) for finding in diagnosis.minor],
        "adjusted": [_plain_without("hides", adjusted) for adjusted in diagnosis.adjusted],
        "unexplained": _unexplained(diagnosis.unexplained),
        "bounds": [_plain_without("words", bound) for bound in diagnosis.bounds],
        "not_testable": [_plain_without("words", entry) for entry in diagnosis.not_testable],
        "data_warnings": list(sentences(diagnosis.data_warnings)),
        "next_experiment": _plain(diagnosis.next_experiment),
        "rollout": _plain(diagnosis.rollout),
        "ledger": [_claim(claim) for claim in diagnosis.ledger],
        "files": [_file(file) for file in diagnosis.files],
        "seconds": _plain(diagnosis.seconds),
        "version": diagnosis.version,
        **geometry,
    }


def _pose_entries(found: GeometryResult) -> tuple[dict[str, Json], list[Json], dict[str, Json]]:
    """Parts of the file on poses: the entry ``frames``, the findings, and the entry ``geometry``."""
    from identification.reporting.stored.geometry_json import findings_json, frames_json, geometry_json

    findings = [_plain(one) for one in findings_json(found.findings)]
    return {"frames": _plain(frames_json(found))}, findings, {"geometry": _plain(geometry_json(found))}


def json_text(diagnosis: Diagnosis) -> str:
    """The text of ``diagnosis.json``, ending in a newline."""
    return json.dumps(to_json(diagnosis), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _finding(finding: Finding) -> Json:
    optional = {
        "law": finding.law,
        "recording": finding.recording,
        # For an effect defined by a user, as readers of the JSON may not have the user's file.
        "name": None if finding.words is None else finding_name(finding),
    }
    return {
        "effect": finding.effect,
        "joint": finding.joint,
        "regime": finding.regime,
        "parameters": {name: _plain(asdict(value)) for name, value in finding.parameters.items()},
        "share": _plain(finding.share),
        "gap_closed": _plain(finding.gap_closed),
        "gap_closed_interval": _plain(finding.gap_closed_interval),
        "probability": _plain(finding.probability),
        "rivals": [
            {"effects": [_effect_at(at) for at in rival.effects], "probability": _plain(rival.probability)}
            for rival in finding.rivals
        ],
        "verdict": finding.verdict,
        **{key: value for key, value in optional.items() if value is not None},
    }


def _file(file: WrittenFile) -> Json:
    """A model file with its errors, or with the reason if it was not written."""
    return _plain_without("refused", file) | ({"refused": file.refused} if file.refused else {})


def _plain_without(left_out: str, entry: Adjusted | Bound | JointGap | NotTestable | WrittenFile) -> dict[str, Json]:
    """All fields of an entry except ``left_out``, as plain JSON types."""
    return {name: _plain(value) for name, value in vars(entry).items() if name != left_out}


def _effect_at(at: EffectAt) -> Json:
    return {"effect": at.effect, "joint": at.joint} | ({} if at.recording is None else {"recording": at.recording})


def _claim(claim: Claim[EffectAt]) -> Json:
    return {
        "effects": [_effect_at(at) for at in claim.effects],
        "gates": [_plain(asdict(result)) for result in claim.gates],
        "outcome": claim.outcome,
        # Structures without a name in the catalogue are left out.
        "instead": [_effect_at(at) for at in claim.instead if at.effect not in _NAMELESS],
        "figures": _plain(claim.figures),
        "judged_by": claim.judged_by,
    }


def _unexplained(unexplained: Unexplained) -> Json:
    return {
        "fraction_of_explainable": _plain(unexplained.fraction_of_explainable),
        "structured": _plain(unexplained.structured),
        "where": {"joint": unexplained.joint, "regime": unexplained.regime, "times": _plain(unexplained.times)},
        "law": None if unexplained.law is None else _plain(asdict(unexplained.law)),
    } | ({} if unexplained.dependence is None else {"dependence": _dependence(unexplained.dependence)})


def _dependence(found: Dependence) -> Json:
    """The dependence of the residual on inputs, without the model, which has its own file."""
    apart = ("gains", "curves", "responses", "terms", "model")
    out = {DEPENDENCE_KEYS.get(name, name): _plain(value) for name, value in vars(found).items() if name not in apart}
    curves = [
        {"torque" if name == "middle" else name: _plain(part) for name, part in asdict(curve).items()}
        for curve in found.curves
    ]
    return out | {
        "gains": [_plain(asdict(gain)) for gain in found.gains],
        "curves": curves,
        DEPENDENCE_KEYS["responses"]: [_plain(asdict(response)) for response in found.responses],
        "terms": [_plain(asdict(term)) for term in found.terms],
    }


def _plain(value: object) -> Json:
    """Converts a value to plain JSON types; a number that is not finite becomes null, as JSON cannot express it."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(entry) for entry in value]
    raise TypeError(f"a diagnosis holds no {type(value).__name__}")


def check_targets(out: Path | None, json_file: Path | None, read: Iterable[str | Path | None] = ()) -> None:
    """Check before the diagnosis that all output files can be written and overwrite no file of the user.

    Args:
        out: Output folder; None for no folder.
        json_file: Additional file for the JSON; None for none.
        read: Input files.

    Raises:
        UsageError: If an output file is an input file, a file of the user, of the wrong kind, or cannot be written.
    """
    names = (INDEX, REPORT, NEXT, *MODELS)
    if out is not None:
        require_writable_folder(out, names)
        require_not_read(read, (out / name for name in names))
        require_own(out, names, index=INDEX, unmarked=(NEXT,))
    if json_file is not None:
        require_writable(json_file, "--json")
        require_not_read(read, [json_file])
        if looks_like_log(json_file) or looks_like_robot(str(json_file)):
            raise UsageError(
                f"--json {json_file} ends as a recording or a robot does, which would be overwritten: name a file "
                "that ends in .json"
            )
        require_own_file(json_file, "--json")


def write_outputs(
    diagnosis: Diagnosis,
    robot: Robot,
    *,
    out: Path | None,
    json_file: Path | None,
    known: tuple[KnownEffect, ...] = (),
    config: Path | None = None,
    on_missing: Callable[[str], None] | None = None,
    completed: Callable[[Diagnosis], Diagnosis] = lambda diagnosis: diagnosis,
) -> tuple[Path, ...]:
    """Write ``diagnosis.json``, ``report.html`` and ``corrected.yaml`` into a folder, and the JSON to another file.

    A proposed motion is written as ``next.csv``. The corrected model as URDF and MJCF, ranges for training and a
    feedforward law are written if possible. Files of an earlier run that this run cannot write are removed, so that
    nobody takes them for files of this run.

    Args:
        diagnosis: The diagnosis.
        robot: The given robot, for ``corrected.yaml`` (source and hash) and the report (shape).
        out: The folder, which is created if it is missing; its other files are kept. None for no folder.
        json_file: Additional file for the JSON; None for none.
        known: Effects that the given model already contains.
        config: The ``robot.yaml`` that was given; None for the one in the folder of the robot's file.
        on_missing: Called with a sentence on each file that is not written, and each finding that a file lacks.
        completed: Called with the diagnosis after the models are made; adds the proposed experiment.

    Returns:
        Paths of the written files.

    Raises:
        UsageError: If a file cannot be written; no file is written then.
        ParameterError: If a finding has a parameter that is not finite; no file is written then.
    """
    check_targets(out, json_file)
    texts: dict[str, str] = {}
    if out is not None:
        before = len(diagnosis.notes)
        models, diagnosis = export_texts(diagnosis, robot, folder=out, known=known, config=config)
        if on_missing is not None:
            for remark in sentences(incomplete_file_notes(diagnosis.notes[before:])):
                on_missing(remark)
        diagnosis = completed(diagnosis)
        linked_files = (INDEX, *models, *([] if diagnosis.next_motion is None else [NEXT]))
        texts = {REPORT: _report(diagnosis, robot, linked_files), **models}
        if diagnosis.next_motion is not None:
            from identification.next_experiment.advise import reference_text  # loads the planning of motions

            texts[NEXT] = reference_text(diagnosis.next_motion, robot.joint_names)
            diagnosis = _with_digest(diagnosis, texts[NEXT])
        texts = {name: with_run(name, text, diagnosis.run) for name, text in texts.items()}
        texts[INDEX] = json_text(diagnosis)
    elif json_file is not None:
        diagnosis = completed(diagnosis)
    return _write(texts, out, json_file, json_text(diagnosis))


def write_diagnosis_alone(diagnosis: Diagnosis, *, out: Path | None, json_file: Path | None) -> tuple[Path, ...]:
    """Write only ``diagnosis.json`` into a folder, and the JSON to another file.

    Other files of an earlier run in the folder are removed.

    Args:
        diagnosis: The diagnosis.
        out: The folder, which is created if it is missing; None for no folder.
        json_file: Additional file for the JSON; None for none.

    Returns:
        Paths of the written files.

    Raises:
        UsageError: If a file cannot be written; no file is written then.
    """
    check_targets(out, json_file)
    text = json_text(diagnosis)
    return _write({} if out is None else {INDEX: text}, out, json_file, text)


def _write(texts: dict[str, str], out: Path | None, json_file: Path | None, json_content: str) -> tuple[Path, ...]:
    """Writes files into a folder, and JSON to another file, all or none; returns their paths."""
    with ExitStack() as renamed:
        if json_file is not None:
            renamed.enter_context(temporary_beside(json_file)).write_text(json_content, encoding="utf-8")
        if out is not None:
            write_together(out, texts, obsolete=(REPORT, NEXT, *MODELS))
    places = [] if out is None else [out / name for name in (INDEX, REPORT, *texts) if name in texts]
    return tuple(dict.fromkeys([*places, *([] if json_file is None else [json_file])]))


def _with_digest(diagnosis: Diagnosis, reference: str) -> Diagnosis:
    """The diagnosis with the SHA-256 of the proposed motion, whose file cannot contain the id of the run."""
    if diagnosis.next_experiment is None:
        return diagnosis
    digest = hashlib.sha256(reference.encode()).hexdigest()
    return replace(diagnosis, next_experiment={**diagnosis.next_experiment, "reference_sha256": digest})


def _report(diagnosis: Diagnosis, robot: Robot, linked_files: tuple[str, ...]) -> str:
    # The report loads libraries for pages and figures, which the JSON alone does not need.
    from identification.reporting.page.diagnosis_report import report_html

    return report_html(diagnosis, robot, linked_files=linked_files)
