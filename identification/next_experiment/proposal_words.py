"""The proposed experiment as sentences, and its reference motion as a CSV file."""

from __future__ import annotations

import io

import numpy as np

from identification.csv_cells import header_line
from identification.next_experiment.hypotheses import Hypothesis
from identification.next_experiment.separation import Pair
from identification.next_experiment.trials import KnownMass, Trial
from identification.words.diagnosis_words import joined, on_place, percent
from identification.words.effect_words import words_of
from phantom_dyn.motion import Motion

# What to do beside recording motion that separates effects from their twins where no motion does.
_CHANGES = {
    "weighing": "weigh a link or the load, or calibrate the torque",
    "data sheet": "take the rotor inertia from the drive's data sheet",
    "link encoder": "put an encoder on the link",
    "level": "put a level on the base, or mount the robot another way up",
    "timing": "measure the torque, or record with another controller gain",
}

_MOST_TOLD = 3
"""Causes that a sentence separates from others at most; of more it tells the first, `diagnosis.json` has all pairs."""


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
        f"{_pairs_words(separated)}."
    )


def nothing_separates(pairs: tuple[Pair, ...]) -> str:
    """One sentence: which rivals no safe motion separates, and which change would."""
    by = {words_of(at).separated_by for pair in pairs for one in (pair.one, pair.other) for at in one.effects}
    changes = [words for change, words in _CHANGES.items() if change in by]
    advice = (
        f": to tell them apart, {joined(changes, ', or ')}"
        if changes
        else ": take either of them, as both predict the same there, or record faster motions, if they are safe"
    )
    return f"No safe motion that was tried separates {_pairs_words(pairs)}{advice}."


def _pairs_words(pairs: tuple[Pair, ...]) -> str:
    """Pairs as ``a from b and c``, the hypothesis of most pairs first."""
    left = list(dict.fromkeys((_hypothesis_words(pair.one), _hypothesis_words(pair.other)) for pair in pairs))
    said = []
    while left:
        names = [name for pair in left for name in pair]
        most = max(dict.fromkeys(names), key=names.count)
        others = [other for pair in left for other in pair if most in pair and other != most]
        said.append(f"{most} from {joined(others)}")
        left = [pair for pair in left if most not in pair]
    return (
        joined(said, ", and ") if len(said) <= _MOST_TOLD else f"{said[0]}, and {len(said) - 1} more causes from others"
    )


def _hypothesis_words(one: Hypothesis) -> str:
    return joined([f"{words_of(at).name} {on_place(at.effect, at.joint)}" for at in one.effects], " with ")


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
