"""Sentences of notes on findings, and on the experiment that would separate rivals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from identification.diagnosis.result import EffectAt
from identification.notes import Code, Note
from identification.words.diagnosis_words import joined, joints_words, on_place
from identification.words.effect_words import words_of
from identification.words.numbers_and_names import NO_BREAK, filled, number, with_unit

RivalPair = tuple[Sequence[EffectAt], Sequence[EffectAt]]
"""Two explanations of the same residual, each given by its effects."""

CHANGES = {
    "weighing": "weigh a link or the load, or calibrate the torque",
    "data sheet": "take the rotor inertia from the drive's data sheet",
    "link encoder": "put an encoder on the link",
    "level": "put a level on the base, or mount the robot another way up",
    "timing": "measure the torque, or record with another controller gain",
}
"""Measurements that separate effects with the same torque in every motion, by `EffectWords.separated_by`."""
_MOST_PAIRS = 3
"""Largest number of causes that a sentence lists with their rivals; of more causes, only the first one is listed."""
_SUMS = 3
"""Largest number of sums of inertial parameters that a sentence lists."""


def pairs_words(pairs: Sequence[RivalPair]) -> str:
    """Pairs as ``a from b and c``, beginning with the explanation that is in most pairs."""
    remaining = list(dict.fromkeys((_hypothesis_words(one), _hypothesis_words(other)) for one, other in pairs))
    phrases = []
    while remaining:
        names = [name for pair in remaining for name in pair]
        most = max(dict.fromkeys(names), key=names.count)
        others = [other for pair in remaining for other in pair if most in pair and other != most]
        phrases.append(f"{most} from {joined(others)}")
        remaining = [pair for pair in remaining if most not in pair]
    if len(phrases) <= _MOST_PAIRS:
        return joined(phrases, ", and ")
    return f"{phrases[0]}, and {len(phrases) - 1} more causes from others"


def _hypothesis_words(effects: Sequence[EffectAt]) -> str:
    """Effects of one explanation with their joints, as ``a payload on joint j3 with play on joint j2``."""
    return joined([f"{words_of(at).name} {on_place(at.effect, at.joint)}" for at in effects], " with ")


def _not_separated(note: Note) -> str:
    pairs: Sequence[RivalPair] = note.numbers["pairs"]
    by = {words_of(at).separated_by for pair in pairs for effects in pair for at in effects}
    changes = [words for change, words in CHANGES.items() if change in by]
    advice = (
        f": to tell them apart, {joined(changes, ', or ')}"
        if changes
        else ": take either of them, as both predict the same there, or record faster motions, if they are safe"
    )
    return f"No safe motion that was tried separates {pairs_words(pairs)}{advice}."


def _no_experiment(note: Note) -> str:
    problem = note.numbers.get("problem", "the fits of the rivals cannot be compared; take a longer recording.")
    return f"No further experiment is proposed: {problem}"


def _implausible_size(note: Note) -> str:
    n = note.numbers
    where = n["effect"].replace("_", " ") + ("" if note.joint is None else f" on {note.joint}")
    return (
        f"The {n['parameter'].replace('_', ' ')} of {where} comes out as {_sized(n['value'], n['unit'])}, which is "
        f"not plausible ({_range(n['least'], n['most'], n['unit'])}): {n['because']}."
    )


def _sized(value: float, unit: str) -> str:
    return with_unit(number(value), unit)


def _range(low: float | None, high: float | None, unit: str) -> str:
    """The plausible range, in words."""
    if low is not None and high is not None:
        return f"{number(low)} to {_sized(high, unit)} is"
    if low is not None:
        return f"at least {_sized(low, unit)} is"
    return f"at most {_sized(float('inf') if high is None else high, unit)} is"


def _missing_part(note: Note) -> str:
    n = note.numbers
    return (
        f"Of what the wrong inertial parameters explain, {100.0 * n['share']:.0f} % would be explained if the robot "
        f"lacked {' and '.join(n['parts'])} ({n['mass']:.3g} kg), which the model carries on a fixed or locked joint: "
        "check whether it is mounted."
    )


def _possible_load(note: Note) -> str:
    mass, std, center = note.numbers["mass"], note.numbers["std"], note.numbers["center"]
    place = ", ".join(f"{x:.3g}" for x in center)
    return (
        f"A load of {mass:.3g} ± {std:.2g} kg with its centre at ({place}) m in the frame of {note.joint}, and "
        "with an inertia of its own as a bar or a disc has, makes the same torques as these wrong inertial parameters: "
        "if such a body is mounted there, it is the cause."
    )


def _model_in_common(note: Note) -> str:
    files = " and ".join(note.numbers["files"])
    return (
        f"Links, friction and constant torques were first fitted to {files}: the result is how the other recordings "
        "differ from that, and not how they differ from the given model. Files of a corrected model are not written; "
        "for these, diagnose the recordings without a load by themselves."
    )


def _zeros_compared(note: Note) -> str:
    n = note.numbers
    sizes = f"{n['by_torque']:.3g} {n['unit']} by the torques and {n['by_pose']:.3g} {n['unit']} by the poses"
    end = "they agree" if n["agree"] else "they differ, so that one of the two has another cause"
    return f"The zero of {note.joint} is off by {sizes}: {end}."


def _drive_sum(note: Note) -> str:
    n = note.numbers
    parts = (
        "back-EMF, viscous friction and the delay of its reference" if n["late"] else "back-EMF and viscous friction"
    )
    return (
        f"The voltage of {note.joint} shows only a sum: {parts} make {n['sum']:.3g} ± {n['std']:.2g} {n['unit']} "
        f"together. By the motor constants in robot.yaml, {n['back_emf']:.3g} of it is back-EMF; the parts "
        f"are as accurate as these constants{' and the delay that is attributed to the bus' if n['late'] else ''}."
    )


def _perhaps_volts(note: Note) -> str:
    n = note.numbers
    seen = (
        "viscous friction and a torque constant, or what looks like one, were found together"
        if n["found"]
        else "viscous friction was found, and a torque constant may be the cause of another finding"
    )
    return (
        f"On {joints_words(list(n['joints']))} {seen}. This also happens if the torque columns contain voltages: if "
        "tau is in volts, name the columns u.<joint>, and state torque_constant, resistance and gear_ratio of the "
        "drives in robot.yaml."
    )


def _held_torque(note: Note) -> str:
    return (
        f"The viscous friction of {joints_words(list(note.numbers['joints']))} may be none: a position controller that "
        "holds each reference for a row of the log changes its torque within the row, and a torque that is read once "
        "per row, always at the same time after a new reference, looks like viscous friction of up to kp/2 times the "
        "time between rows. Record the mean torque of each row, or every step of the controller."
    )


def _center_to_write(note: Note) -> str:
    n = note.numbers
    # A tenth of a millimetre is below the accuracy of every finding; + 0.0 removes the sign of zero.
    center = ", ".join(f"{round(x, 4) + 0.0:g}" for x in n["center"])
    return (
        f"The place of the payload counts from the frame of joint {note.joint}. From the payload_frame {n['frame']}, "
        f"from which a recordings.yaml counts it, it is center: [{center}]."
    )


def _one_sided(note: Note) -> str:
    parts = [with_unit(f"{name} {low:.3g} to {high:.3g}", unit) for name, low, high, unit in note.numbers["intervals"]]
    where = f" of {note.joint}" if note.joint else ""
    return (
        f"The inertial parameters{where} lie on the limit of what a real body can have, so that they are "
        f"uncertain in one direction only. Changes of the model, 95{NO_BREAK}% intervals: {', '.join(parts)}."
    )


def _sums(note: Note) -> str:
    sums = [f"{name} for {whole}" for name, whole in note.numbers["sums"].items()]
    where = f" of {note.joint}" if note.joint else ""
    return (
        f"The motion shows some inertial parameters{where} only in sums with others. So a number stands for its sum, "
        f"and may be one that no body has alone: {'; '.join(sums[:_SUMS])}{', and so on' if len(sums) > _SUMS else ''}."
    )


FINDING_WORDS: Mapping[Code, Callable[[Note], str]] = {
    Code.IMPLAUSIBLE_SIZE: _implausible_size,
    Code.FRICTION_DRIVES: filled(
        "The friction of {joint}, that of the model and of all findings together, pushes in the direction of the "
        "motion. No friction does that, so another cause must be at work there."
    ),
    Code.MISSING_PART: _missing_part,
    Code.POSSIBLE_LOAD: _possible_load,
    Code.DRIVE_SUM: _drive_sum,
    Code.PERHAPS_VOLTS: _perhaps_volts,
    Code.HELD_TORQUE: _held_torque,
    Code.CENTER_TO_WRITE: _center_to_write,
    Code.ONE_SIDED: _one_sided,
    Code.SUMS: _sums,
    Code.MODEL_IN_COMMON: _model_in_common,
    Code.ZEROS_COMPARED: _zeros_compared,
    Code.NO_EXPERIMENT: _no_experiment,
    Code.NOT_SEPARATED: _not_separated,
}
