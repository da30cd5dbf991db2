"""Sentences of notes on recordings, controllers, recordings at rest, events, and simulated motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from identification.data.recording import time_text
from identification.diagnosis.evidence import SimulatedPositions
from identification.notes import Code, Note
from identification.words.diagnosis_words import joined, joints_words
from identification.words.numbers_and_names import NO_BREAK, filled

_STATE_IT = "State controller: {{kind: pd, kp: ..., kd: ...}} of {joint} in robot.yaml if you know them"


def _motion_only(note: Note) -> str:
    n = note.numbers
    files = n["file"] + (f" and {n['more']} more" if n.get("more") else "")
    unused = " The torque of the log is not used." if n["has_torque"] else ""
    return (
        f"{files}: positions and references only: the torque is what the controllers ask for at the recorded motion, "
        f"so that findings are as accurate as their gains{_gains_stated(n.get('gains', {}))}.{unused}"
    )


def _held_seen(note: Note) -> str:
    n = note.numbers
    return (
        f"{n['file']}: each reference is taken as held until the next row, {1e3 * n['row']:.3g} ms later: read so, "
        f"far less is left than with references that act at once. They then act {5e2 * n['row']:.3g} ms late on "
        "average, which is no gap. If the drive follows references as they come, state reference_hold: instant in "
        "robot.yaml, and that delay is found."
    )


def _reference_of_step(note: Note) -> str:
    n = note.numbers
    return (
        f"{n['file']}: each reference is taken as that of the step before its row, {1e3 * n['row']:.3g} ms earlier: "
        "positions after a step were logged beside the reference of that step, as simulated environments do. Read so, "
        "far less is left."
    )


def _gains_stated(gains: Mapping[str, tuple[float, float, float]]) -> str:
    """Clause on the gains that the robot's file states; joints with equal gains are named together."""
    if not gains:
        return ""
    alike: dict[str, list[str]] = {}
    for joint, (kp, kd, lag) in gains.items():
        behind = f", references behind a filter of {lag:.4g} s" if lag else ""
        alike.setdefault(f"kp {kp:.4g}, kd {kd:.4g}{behind}", []).append(joint)
    said = "; ".join(f"{', '.join(joints)} {numbers}" for numbers, joints in alike.items())
    return f", which the actuators of the robot's file state ({said})"


def _gains_estimated(note: Note) -> str:
    n = note.numbers
    return (
        f"No gains of {note.joint} are stated: kp = {n['kp']:.3g} ± {n['kp_std']:.2g} {n['kp_unit']} and "
        f"kd = {n['kd']:.3g} ± {n['kd_std']:.2g} {n['kd_unit']} were estimated from its motion. They are as accurate "
        f"as the {' and the '.join(n['determined_by'])} of the model, and kd includes viscous friction that the model "
        f"lacks; positions alone show kd/kp = {n['ratio']:.3g} ± {n['ratio_std']:.2g} s. "
        f"{_STATE_IT.format(joint=note.joint)}."
    )


def _gain_by_friction(note: Note) -> str:
    n = note.numbers
    return (
        f"No gains of {note.joint} are stated: with the masses of the model kp is {n['kp']:.3g} {n['unit']}, and the "
        f"joint would have less friction than the model states. With kp = {n['scale'] * n['kp']:.3g} {n['unit']} its "
        f"friction is that of the model, and the robot is heavier; this was used. {_STATE_IT.format(joint=note.joint)}"
        ", as positions alone do not separate a gain from a load."
    )


def _strays_under_control(note: Note) -> str:
    n = note.numbers
    return (
        f"The torque that is asked for shows no gap, yet under its controller {note.joint} strays by "
        f"{n['error']:.3g} {n['unit']} from the recorded motion, {n['error'] / n['noise']:.0f} times the noise of its "
        "readings: a disturbance, or an effect too fast for the band of this recording (play, sticking). Record "
        "faster, or with torque."
    )


def _rests_apart(note: Note) -> str:
    n = note.numbers
    steps = f" ({n['steps']:.1f} steps of its reading)" if n["steps"] is not None else ""
    return (
        f"{note.joint} rests {n['shift']:.3g} {n['unit']}{steps} apart under loads of opposite sign of "
        f"{n['least']:.2g} to {n['most']:.2g} {n['load_unit']}, by {n['rests']} rests; loads below "
        f"{100 * n['counted']:.0f} % of the largest are not counted."
    )


def _event(note: Note) -> str:
    n = note.numbers
    out = ":".join(f"{edge:.2f}" for edge in n["exclude"])
    return (
        f"{n['file']}: from {n['start']:.2f} to {n['stop']:.2f} s a torque of up to {n['torque']:.3g} {n['unit']} acts "
        f"on joint {note.joint} that neither the model nor a finding explains: if it was a push or a "
        f"contact, leave it out with --exclude {out}, or record its force in columns f.<frame>.x, .y and .z."
    )


def _poses_left_out(note: Note) -> str:
    count = note.numbers["count"]
    what = "pose lies" if count == 1 else "poses lie"
    files = ", ".join(note.numbers["recordings"])
    return f"{files}: {count} measured {what} more than six noise levels from all others and were left out."


def _search_without_end(note: Note) -> str:
    base = " Check that the sensors of the base are fastened to it." if note.numbers["floating"] else ""
    return (
        f"The search for causes was stopped after {note.numbers['fits']} sets of effects: many explain some of this "
        f"gap, and none explains it. So its cause is most likely none of the catalogue.{base}"
    )


def _open_arrival(note: Note) -> str:
    n = note.numbers
    return (
        f"The voltage of {note.joint} was read once in {1e3 * n['frame']:.3g} ms while a reference was held, and no "
        f"reading shows when in that time the next one came. The effect is as large as viscous friction of up to "
        f"{n['viscous']:.2g} {n['unit']}, and was fitted with the others."
    )


def _drive_drops(note: Note) -> str:
    n = note.numbers
    return (
        f"{n['file']}: beyond an error of {n['beyond']:.3g} {n['unit']} the drive of {note.joint} puts out at most "
        f"{n['most']:.3g} V, for {100 * n['share']:.2g} % of the time: it protects itself. The torque includes this, "
        "except that it may begin and end between two readings."
    )


def _recordings_unlike(note: Note) -> str:
    fit, misfit, joints = (list(note.numbers[name]) for name in ("fit", "misfit", "joints"))
    return (
        f"The given model fits {joined(fit)} within noise, in motion of the same kind, and not {joined(misfit)}, on "
        f"{joints_words(joints)}. If something was different there, such as a load, diagnose again with --changed and "
        "what it was."
    )


def _drive_protected(note: Note) -> str:
    n = note.numbers
    angle, torque = n["units"]
    share = "" if n["of_supply"] is None else f" and drops_to: {n['of_supply']:.2g}"
    return (
        f"{n['file']}: beyond an error of about {n['beyond']:.2g} {angle} the motion of {note.joint} needs about "
        f"{n['most']:.2g} {torque}, where its controller asks for {n['asked']:.2g} {torque} and more, for "
        f"{100 * n['share']:.2g} % of the time: its drive may protect itself, which no effect describes. Record with "
        f"smaller errors; a controller of kind duty states it as drops_beyond: {n['beyond']:.2g}{share}."
    )


def _recorded_past_limits(note: Note) -> str:
    n = note.numbers
    return (
        f"{n['file']}: {note.joint} goes up to {n['past']:.3g} {n['unit']} past the model's limits of "
        f"{n['lower']:.4g} to {n['upper']:.4g} {n['unit']}, first at t = {time_text(n['t'])} s: a simulator that keeps "
        f"limits would stop it there. If the log counts {note.joint} from another zero, write q.{note.joint}: "
        f"{{from: q.{note.joint}, offset: ...}} into a column map (--columns), or sign: -1 or a unit if those are "
        "wrong; else correct the limits in the robot file."
    )


def _runs_past_limit(note: Note) -> str:
    n = note.numbers
    return (
        f"{n['file']}: in {n['windows']} of {n['of']} simulated windows {note.joint} runs past the limit of "
        f"{n['limit']:.4g} {n['unit']} of the {n['model']} model, first at t = {time_text(n['t'])} s, where the "
        "recording comes up to it and stays: a stop may have held it there, and the simulation has none."
    )


def _runs_past_limits(note: Note) -> str:
    n = note.numbers
    places = [f"{joint} past {limit:.4g} {unit} in {windows}" for joint, limit, unit, windows in n["places"]]
    return (
        f"{n['file']}: in {n['of']} simulated windows joints run past limits of the {n['model']} model that "
        f"the recording comes up to and keeps ({', '.join(places)}): stops may have held them there, and the "
        "simulation has none."
    )


def _drive(note: Note) -> str:
    return "the stated controllers" if note.numbers["controlled"] else "the recorded torque"


def _shorter_horizon(note: Note) -> str:
    return (
        f"Simulated motion under {_drive(note)} is compared over {note.numbers['seconds']:g} s: over longer "
        "times the noise of the start would become a large part of the error."
    )


def _closed_loop(note: Note) -> str:
    n = note.numbers
    before, after = (float(np.sqrt(sum(x**2 for x in n[name].values()))) for name in ("before", "after"))
    return (
        f"Under the stated controllers and the recorded references simulated positions stray by {before:.3g} from the "
        f"recorded ones within {n['seconds']:g} s (root mean square over windows, summed over joints) with the given "
        f"model and by {after:.3g} with the corrected one."
    )


def _runs_away(note: Note) -> str:
    return (
        f"No motion was simulated under {_drive(note)}: the simulated robot runs away within "
        f"{note.numbers['t']:.2g} s of a recorded state, with the given or the corrected model."
    )


def _not_simulated(note: Note) -> str:
    problem = str(note.numbers["problem"])
    return f"No motion was simulated under {_drive(note)}: {problem[:1].lower()}{problem[1:]}"


def _other_band(note: Note) -> str:
    edge, first = note.numbers["edge"], note.numbers["first"]
    why = "noise of higher frequencies hides it" if edge < first else "most of it is left out"
    return f"The gap shows in a band of 0 to {edge:.2g} Hz; in 0 to {first:.2g} Hz, as chosen from the data, {why}."


MOTION_WORDS: Mapping[Code, Callable[[Note], str]] = {
    Code.TORQUE_ASKED: filled("{file}: without torque columns, the torque is what its controllers asked for."),
    Code.MOTION_ONLY: _motion_only,
    Code.HELD_SEEN: _held_seen,
    Code.REFERENCE_OF_STEP: _reference_of_step,
    Code.GAINS_ESTIMATED: _gains_estimated,
    Code.GAIN_BY_FRICTION: _gain_by_friction,
    Code.GAIN_OR_CONSTANT: filled(
        "The torque constant of {joint} and the gain of its controller cannot be separated by positions: the ratio "
        "of {ratio:.3g} is that of their product."
    ),
    Code.OFFSET_OR_ZERO: filled(
        "The torque offset of {joint} and another zero of its references, such as the trim of a servo, cannot be "
        "separated by positions: q_ref.{joint}: {{from: q_ref.{joint}, offset: {zero:.4g}}} in a column map has the "
        "same effect."
    ),
    Code.STRAYS_UNDER_CONTROL: _strays_under_control,
    Code.RESTS_APART: _rests_apart,
    Code.CONTROLLER_GIVES_WAY: filled(
        "Part of it is how far the controller of {joint} gives way under load: state its gain kp in robot.yaml to "
        "separate the two."
    ),
    Code.EVENT: _event,
    Code.POSES_LEFT_OUT: _poses_left_out,
    Code.SOFT_FRICTION: filled(
        "With this file friction changes sign as softly as MuJoCo's does: the recording looks simulated by it, and "
        "this softness does not count as a gap."
    ),
    Code.BRAKED: filled(
        "In rests of {file} the drive of {joint} gives none of the weight that it bears in motion: a brake seems to "
        "hold it, and the torque of these rests is not used."
    ),
    Code.SEARCH_WITHOUT_END: _search_without_end,
    Code.OPEN_ARRIVAL: _open_arrival,
    Code.DRIVE_DROPS: _drive_drops,
    Code.DRIVE_PROTECTED: _drive_protected,
    Code.RECORDINGS_UNLIKE: _recordings_unlike,
    Code.OTHER_BAND: _other_band,
    Code.RECORDED_PAST_LIMITS: _recorded_past_limits,
    Code.RUNS_PAST_LIMIT: _runs_past_limit,
    Code.RUNS_PAST_LIMITS: _runs_past_limits,
    Code.SHORTER_HORIZON: _shorter_horizon,
    Code.CLOSED_LOOP: _closed_loop,
    Code.RUNS_AWAY: _runs_away,
    Code.NOT_SIMULATED: _not_simulated,
}


def simulated_motion_words(simulated: SimulatedPositions, *, on_base: bool = False) -> str:
    """Caption of the figure of simulated motion.

    Args:
        simulated: The simulated motion.
        on_base: True for a robot with a floating base.
    """
    by = "the recorded references through the stated controllers" if simulated.controlled else "the recorded torque"
    base = "The base moves as its sensors read, and a leg is simulated while it swings. " if on_base else ""
    return (
        "Position over time: measured, and simulated by both models. They start from the recorded state, follow "
        f"{by} for {simulated.seconds:.2g}{NO_BREAK}s, and start again; the corrected one by fits that have not seen "
        f"the window. {base}Where there is no line, nothing was simulated."
    )
