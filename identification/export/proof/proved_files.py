"""Files of a diagnosis that may be handed out, each with what it leaves in its header."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from identification.diagnosis.written import WrittenFile
from identification.export.file_names import FEEDFORWARD, GOES_WITH, ISAAC, MJCF, RANDOMISATION, RESIDUAL, URDF, YAML
from identification.export.headers import with_header
from identification.export.proof.judged_files import Proof
from identification.notes import Code, Note


def proved(
    texts: dict[str, str], proof: Proof | None, *, moved_mjcf: bool = False
) -> tuple[dict[str, str], tuple[WrittenFile, ...], tuple[Note, ...]]:
    """Files that may be handed out, the error that each leaves (also in its header), and why others may not.

    Args:
        texts: By name.
        proof: What they are compared with; None where no torque was judged.
        moved_mjcf: True if poses have moved joints of the MJCF: what it leaves then is not known.
    """
    if proof is None:
        return texts, tuple(WrittenFile(name, {}, {}) for name in texts if name not in GOES_WITH), ()
    checks: dict[str, Callable[[str], WrittenFile]] = {
        YAML: proof.of_yaml,
        URDF: proof.of_urdf,
        MJCF: lambda _: proof.of_mjcf(),
        RANDOMISATION: proof.of_randomisation,
        FEEDFORWARD: proof.of_feedforward,
        ISAAC: proof.of_actuators,
        RESIDUAL: proof.of_residual,
    }
    kept, records, refused = dict(texts), [], []
    for name, check in checks.items():
        if name not in texts:
            continue
        record = check(texts[name])
        if name == MJCF and moved_mjcf:
            record = replace(record, rms_left={}, rms_given={})
        records.append(record)
        if record.refused:
            del kept[name]
            refused.append(Note(Code.REFUSED, None, {"files": (name,), "problem": record.refused}))
        else:
            kept[name] = with_header(texts[name], record, proof.diagnosis, proof.fitted)
    for name, other in GOES_WITH.items():
        if name in kept and other not in kept:
            del kept[name]
            refused.append(Note(Code.NOT_ALONE, None, {"files": (name,), "other": other}))
    return kept, tuple(records), tuple(refused)
