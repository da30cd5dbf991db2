"""What the diagnosis proposes to record next, in sentences, and its reference motion as a CSV file."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from identification.csv_cells import header_line
from identification.next_experiment.separation import Pair
from identification.next_experiment.trials import KnownMass, Trial
from identification.notes import Code, Note
from identification.words.diagnosis_words import percent
from identification.words.notes_on_findings import Rivalry, pairs_words
from phantom_dyn.motion import Motion


@dataclass(frozen=True)
class Proposal:
    """The recording to make next.

    Attributes:
        experiment: Entry of ``diagnosis.json``; None where nothing is proposed.
        motion: The reference motion.
        notes: On what no recording would separate.
    """

    experiment: dict | None = None
    motion: Motion | None = None
    notes: tuple[Note, ...] = ()


def proposal_words(separated: tuple[Pair, ...], trial: Trial, reference: str, power: float) -> str:
    """One sentence: which motion to record, and which rivals it separates."""
    load = stated = ""
    if trial.mass is not None:
        load, stated = f" with {_mass_words(trial.mass)}", f", write {_entry(trial.mass)}"
    if trial.gains is not None:
        load = f" with the gains of the position controllers at {percent(trial.gains)} of those in robot.yaml"
        stated = ", write these gains as its controller"
    # What is known of a recording counts only where it is written down.
    stated += " beside its file name in recordings.yaml," if stated else ""
    motion = f"{trial.candidate.shapes.duration:g} s, {trial.candidate.kind}"
    safe = "at most half of the recorded range beyond its ends, and twice the recorded speeds and torques"
    return (
        f"Record the motion of {reference}{load} ({motion}, {safe}; obstacles are not looked at){stated} and "
        f"diagnose it together with this recording: with a probability of {percent(power)} it separates "
        f"{pairs_words(_effects_of(separated))}."
    )


def not_separated(pairs: tuple[Pair, ...]) -> Note:
    """A note on rivals that no safe motion separates."""
    return Note(Code.NOT_SEPARATED, None, {"pairs": _effects_of(pairs)})


def _effects_of(pairs: tuple[Pair, ...]) -> tuple[Rivalry, ...]:
    return tuple((pair.one.effects, pair.other.effects) for pair in pairs)


def _mass_words(mass: KnownMass) -> str:
    x, y, z = mass.center
    return f"a known mass of {mass.mass:g} kg at ({x:g}, {y:g}, {z:g}) m of {mass.frame}"


def _entry(mass: KnownMass) -> str:
    """The mass as ``recordings.yaml`` states it."""
    return f"payload: {{mass: {mass.mass:g}, center: [{', '.join(f'{x:g}' for x in mass.center)}]}}"


def reference_text(motion: Motion, joint_names: tuple[str, ...]) -> str:
    """CSV with ``t``, ``q_ref.<joint>``, ``v_ref.<joint>`` and ``a_ref.<joint>``; nothing is rounded."""
    names = ["t", *(f"{kind}.{joint}" for kind in ("q_ref", "v_ref", "a_ref") for joint in joint_names)]
    rows = np.column_stack([motion.t, motion.q, motion.v, motion.a])
    out = io.StringIO()
    np.savetxt(out, rows, delimiter=",", header=header_line(names), comments="", fmt="%.17g")
    return out.getvalue()
