"""Sentences of notes on files: why a file was not written, what it cannot contain, and how it was checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from identification.notes import Code, Note
from identification.words.numbers_and_names import filled, percent

_QUANTITIES = {
    "rotor_inertia": "rotor inertias: put them into {config} (rotor_inertia [kg m^2 or kg])",
    "stiffness": "springs (stiffness)",
    "offset": "constant torques [N m or N]",
    "torque_constant": "torque constants (true over logged torque)",
    "delay": "delays [s]",
    "reference_delay": "delays of the references of position controllers [s]",
    "lag": "lags [s]",
    "play": "play (gap [rad or m])",
    "transmission": "springs of transmissions (stiffness)",
    "cogging": "cogging (largest amplitude)",
    "coupling": "couplings (ratio)",
    "spring_behind_play": "a spring behind a play (stiffness)",
    "zeros_in_chain": "the zeros of encoders in a closed chain [rad or m]",
}
"""Words for the quantities of a corrected model that a file may have no place for."""


def _with_small_first_letter(text: str) -> str:
    return f"{text[:1].lower()}{text[1:]}"


def _with_file_name(words: str | Callable[[Note], str]) -> Callable[[Note], str]:
    """Function that builds the sentence of a note, preceded by the name of the file if the note has one.

    Args:
        words: Template of the sentence, or function that builds it. In the sentence "it" means the file.
    """
    make = filled(words) if isinstance(words, str) else words
    return lambda note: f"{note.files[0]}: {_with_small_first_letter(make(note))}" if note.files else make(note)


def _values(note: Note) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in note.numbers["values"].items())


def _names(files: tuple[str, ...]) -> str:
    return " and ".join(files) if len(files) < 3 else ", ".join(files)


def _not_written(note: Note) -> str:
    return f"{_names(note.files)} {'was' if len(note.files) == 1 else 'were'} not written: {note.numbers['problem']}"


def _no_place(note: Note) -> str:
    what = _QUANTITIES[note.numbers["quantity"]].format(config=note.numbers.get("config", ""))
    return f"It has no place for {what}: {_values(note)}."


def _no_place_for_effect(note: Note) -> str:
    words = note.numbers["words"]
    size = note.numbers["parameter"].replace("_", " ")
    return f"It has no place for {words.lost or words.name} ({size}): {_values(note)}."


def _no_place_for_drive(note: Note) -> str:
    n = note.numbers
    if n["actuators"] == 1:
        why = f"its actuator is <{n['kind']}>, whose feedback would change too. A <motor> has a place for it."
    else:
        why = f"the file has {'several actuators' if n['actuators'] else 'no actuator'} there."
    return f"It has no place for what was found of the drive of {note.joint} ({_values(note)}): {why}"


def _no_place_for_loops(note: Note) -> str:
    config = note.numbers["config"]
    what = f"keep {config} beside it" if note.numbers["kept"] else f"state them under loops in a {config}"
    return f"It has no place for closed loops: {what}."


def _no_place_for_gravity(note: Note) -> str:
    numbers = ", ".join(f"{x:g}" for x in note.numbers["gravity"])
    return f"It has no place for gravity: state gravity: [{numbers}] in a {note.numbers['config']} beside it."


def _no_place_for_links(note: Note) -> str:
    return (
        f"{_names(note.files)} have no place for where {', '.join(note.numbers['names'])} sits: their passive joints "
        "follow formulas, which do not hold for links of other lengths; corrected.yaml has it, for --with."
    )


def _no_place_for_poses(note: Note) -> str:
    where = ", ".join(note.numbers.get("names", ()))
    what = {
        "elasticity": f"the elasticity under load of {where}",
        "base": "base_pose, where the base stands in its cell",
        "tool": f"tool_pose, where the target sits on {where}",
    }[note.numbers["quantity"]]
    return f"{_names(note.files)} have no place for {what}."


def _places_not_in_it(note: Note) -> str:
    names = ", ".join(note.numbers["names"])
    if note.numbers["given"]:
        return f"{note.files[0]}: the corrected place of {names} in the given file is not in it."
    return f"{note.files[0]} has no place for the corrected place of {names}."


def _as_it_was_given(note: Note) -> str:
    names = ", ".join(note.numbers["names"])
    return f"{note.files[0]} has no place for what poses showed: it has {names} as given."


def _nearest_body(note: Note) -> str:
    n = note.numbers
    return (
        f"No body can have the inertia that was found for {n['body']}: the corrected files have the nearest possible "
        f"one, {100 * n['distance']:.2g} % away (mass {n['mass']:.4g} kg for {n['found']:.4g} kg)."
    )


def _locked_can_move(note: Note) -> str:
    n = note.numbers
    return f"{', '.join(n['names'])} can move in it: to fix them, name them under lock in a {n['config']} beside it."


def _only_motors(note: Note) -> str:
    what, but = "shapes, sensors and actuators", ""
    if note.numbers["of_urdf"]:
        what, but = "limits of torque and speed", f", but for limits that {note.numbers['config']} states"
    return f"It lacks {what} of the given file{but}; a motor drives each joint."


def _rotor_unknown(note: Note) -> str:
    n = note.numbers
    return (
        f"The rotor inertia of {', '.join(n['names'])} is not known, so a hundredth of what the joint moves is taken: "
        f"state rotor_inertia in {n['config']}."
    )


def _checked(note: Note) -> str:
    n = note.numbers
    out = f"loaded again with {n['loaded_with']}, it needs the same torques"
    if n["difference"] is None:
        out = f"not loaded again, as {n['unchecked']}"
    elif n["difference"] > 0:
        out += f": they differ by at most {n['difference']:.1g} of the largest"
    return f"{note.files[0]}: {out}."


def _rolled_out(note: Note) -> str:
    n = note.numbers
    changes = ", ".join(f"{joint} {one:.3g} {unit} before and {two:.3g} after" for joint, one, two, unit in n["places"])
    return (
        f"{note.files[0]}: rolled out in MuJoCo for {n['seconds']:g} s under the logged torque, it is this far from "
        f"the recorded motion (root mean square): {changes}."
    )


def _residual_held(note: Note) -> str:
    n = note.numbers
    what = "the law, and the error that its absence caused" if n["lawful"] else "a sum of terms that is no law"
    out = (
        f"residual.py holds the torque on joint {note.joint} that the corrected model lacks ({what}): it predicts "
        f"{percent(n['closed'])} of the squares of what is left there on held-out data."
    )
    if n["memory"]:
        out += " It depends on past inputs; residual.csv leaves them out and holds the values for constant inputs."
    return out


def _within_tolerance(note: Note) -> str:
    count = note.numbers["count"]
    moved = (
        f"The {count} quantities that moved within tolerance are"
        if count > 1
        else "The quantity that moved within tolerance is"
    )
    if note.numbers["held"]:
        return f"{moved} in the corrected files."
    return f"{moved} not in the corrected files: no body can have these values."


def _other_numbers(note: Note) -> str:
    out = (
        "The corrected files have sizes and changes within tolerance that were fitted together. The stated sizes, "
        "without changes that are uncertain, would leave a larger gap."
    )
    if unstated := note.numbers["unstated"]:
        changes = "one uncertain change" if unstated == 1 else f"{unstated} uncertain changes"
        out += f" corrected.yaml lists {changes} under adjusted that the report leaves out."
    return out


def _one_recording_only(note: Note) -> str:
    return f"The corrected model lacks effects that act in one recording only: {', '.join(note.numbers['effects'])}."


FILE_WORDS: Mapping[Code, Callable[[Note], str]] = {
    Code.NOT_WRITTEN: _not_written,
    Code.NOT_ALONE: filled("{files[0]} was not written: it goes with {other}."),
    Code.WRITTEN_WRONG: filled(
        "{files[0]} was not written: loaded again with {loaded_with}, it needs torques that differ by "
        "{difference:.2g} of the largest from the corrected model's, which is an error of phantom-dyn."
    ),
    Code.REFUSED: filled("{files[0]} was not written: {problem}."),
    Code.NO_PLACE: _with_file_name(_no_place),
    Code.NO_PLACE_FOR_EFFECT: _with_file_name(_no_place_for_effect),
    Code.NO_PLACE_FOR_DRIVE: _with_file_name(_no_place_for_drive),
    Code.NO_PLACE_FOR_LOOPS: _with_file_name(_no_place_for_loops),
    Code.NO_PLACE_FOR_GRAVITY: _with_file_name(_no_place_for_gravity),
    Code.NO_PLACE_FOR_LINKS: _no_place_for_links,
    Code.NO_PLACE_FOR_POSES: _no_place_for_poses,
    Code.PLACES_NOT_IN_IT: _places_not_in_it,
    Code.LOOPS_STAY_OPEN: filled("{files[0]} has no place for what poses showed: with its joints moved, {problem}"),
    Code.LOOPS_AS_DRAWN: filled(
        "{files[0]} has no place for what poses showed: where its loops close follows from how it is drawn."
    ),
    Code.AS_IT_WAS_GIVEN: _as_it_was_given,
    Code.GIVEN_FILE_NOT_IN_IT: _with_file_name(
        "The given file is not in it, so it lacks the shapes, sensors and actuators of that file: {problem}"
    ),
    Code.NEAREST_BODY: _nearest_body,
    Code.SAME_TORQUES: filled(
        "No body can have all inertias that were found: the files have possible bodies with the same torques."
    ),
    Code.LOCKED_CAN_MOVE: _with_file_name(_locked_can_move),
    Code.NO_SHAPES: _with_file_name(
        "The given file is no URDF, so this one has bodies, joints and frames, and no shapes."
    ),
    Code.ONLY_MOTORS: _with_file_name(_only_motors),
    Code.REDUCED_LAW: _with_file_name("It has, {words.kept}: {joint}."),
    Code.ROTOR_UNKNOWN: _with_file_name(_rotor_unknown),
    Code.NEEDS_NEWER_MUJOCO: _with_file_name(
        "Delays and cogging (dcmotor) need MuJoCo 4.0 or newer; cogging takes no command: leave ctrl at 0."
    ),
    Code.DELAYS_CUT: _with_file_name(
        "Its delays are cut short where the timestep is below {shortest:g} s: raise nsample there."
    ),
    Code.FILE_REMARK: _with_file_name("{sentence}"),
    Code.CHECKED: _checked,
    Code.ROLLED_OUT: _rolled_out,
    Code.RESIDUAL_HELD: _residual_held,
    Code.WITHIN_TOLERANCE: _within_tolerance,
    Code.OTHER_NUMBERS: _other_numbers,
    Code.ONE_RECORDING_ONLY: _one_recording_only,
}
