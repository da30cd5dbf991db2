"""Diagnosis of positions at rest: for recordings too slow for torques, or controllers without a stated gain.

It finds backlash and compliance. Its ledger lists the gates that each of them has passed.
"""

from __future__ import annotations

import time
from uuid import uuid4

import numpy as np

from identification.data.recording import Recording
from identification.data.refusal import fault_warnings, require_right, wrong_with
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import (
    Bound,
    Diagnosis,
    EffectAt,
    Finding,
    JointGap,
    NotTestable,
    Rival,
    Unexplained,
    Value,
)
from identification.engine import contract_levels
from identification.engine.claims import Claim, GateResult, until_failed
from identification.gates.rivalry import likelier_than_rivals
from identification.notes import Code, Note
from identification.scenarios.at_rest.giving_way import WAYS, GivingWay, Way, giving_way, testable
from identification.scenarios.at_rest.rests import LOADED, StandstillSamples, stills_under_load
from identification.scenarios.measured_poses import with_poses
from identification.words.user_words import user_words
from phantom_dyn import __version__
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.effects import catalogue
from phantom_dyn.model.robot import Robot

_GIVES = ("backlash", "transmission_compliance")
_ON_MOTOR = (
    "the encoder sits before the transmission, whose give it does not see: state encoder_side: link if it does not"
)
_ONE_SIGN = "it does not rest often enough under loads of either sign"
_AT_REST = (
    "positions at rest show only how a joint gives way under load: for all else record the torque, or state the gain "
    "kp of its controller in robot.yaml"
)


def judged_at_rest(robot: Robot, recordings: tuple[Recording, ...]) -> bool:
    """True if only rests can be used: there are references, but neither torque nor gains of controllers.

    A joint whose encoder is on its link has to rest under loads of either sign.
    """
    gains = all(a.controller is not None and a.controller.kp > 0 for a in robot.actuators if a.actuated)
    if gains or any(recording.q_ref is None or recording.tau is not None for recording in recordings):
        return False
    return any(_why_not(robot, stills_under_load(robot, recordings, row), row) is None for row in range(robot.nv))


def diagnose_at_rest(robot: Robot, recordings: tuple[Recording, ...]) -> Diagnosis:
    """Diagnosis of backlash and compliance from positions at rest; each rest is predicted by fits without it.

    The load is that of the model: weight and measured external forces. No torque is used: that of a position
    controller is a function of the position error, and says nothing about the transmission.

    Args:
        robot: The robot, with its masses and encoders.
        recordings: Recordings with references.

    Raises:
        LogError: If a recording has no references, or one that is not finite, or is certainly wrong.
    """
    started = time.perf_counter()
    require_right(recordings)
    every = [stills_under_load(robot, recordings, row) for row in range(robot.nv)]
    why = [_why_not(robot, stills, row) for row, stills in enumerate(every)]
    ways = {row: giving_way(stills) for row, stills in enumerate(every) if why[row] is None}
    rows = sorted(ways, key=lambda row: -abs(ways[row].shift))
    findings = tuple(finding for row in rows for finding in _findings(robot, row, every[row], ways[row]))
    gaps = tuple(_gap(robot, row, every[row], ways.get(row)) for row in range(robot.nv))
    rest = _unexplained(robot, every, ways)
    warnings = [note for row in rows for note in _rest_notes(robot, row, every[row], ways[row])]
    found = Diagnosis(
        verdict=_verdict(ways, findings, rest),
        robot=robot.name,
        recordings=tuple(recording.file for recording in recordings),
        joints=gaps,
        band_hz=(0.0, 0.0),
        findings=findings,
        adjusted=(),
        unexplained=rest,
        bounds=tuple(_bound(robot, row, way) for row, way in ways.items() if not way.ways),
        not_testable=_untestable(robot, why),
        data_warnings=(
            *fault_warnings(recordings),
            *robot.warnings,
            *(said for recording in recordings for said in recording.said),
            *warnings,
        ),
        next_experiment=None,
        rollout=None,
        seconds=time.perf_counter() - started,
        version=__version__,
        evidence=_evidence(robot, every, ways, rows),
        wrong=wrong_with(recordings),
        run=uuid4().hex,
        ledger=tuple(
            claim
            for row in rows
            for claim in claims_at_rest(robot.joint_names[row], ways[row], every[row].repeatability)
        ),
    )
    return with_poses(found, robot, recordings)


def _why_not(robot: Robot, stills: StandstillSamples, row: int) -> str | None:
    if robot.actuators[row].encoder_side == "motor":
        return _ON_MOTOR
    return None if testable(stills) else _ONE_SIGN


def _untestable(robot: Robot, why: list[str | None]) -> tuple[NotTestable, ...]:
    out = []
    for effect in catalogue.effects_of(robot):
        words = user_words(effect.name, robot)
        for joint in effect.places(robot):
            reason = why[robot.joint_names.index(joint)] if effect.name in _GIVES and joint is not None else _AT_REST
            out += [NotTestable(effect.name, joint, reason, words)] if reason is not None else []
    return tuple(out)


def _findings(robot: Robot, row: int, stills: StandstillSamples, found: GivingWay) -> list[Finding]:
    """Findings on one joint: one for each effect of the most probable model of its rests."""
    if not found.ways:
        return []
    joint, best = robot.joint_names[row], found.ways[0]
    rivals = tuple(
        Rival(tuple(EffectAt(effect, joint) for effect in way.effects), probability)
        for way, probability in zip(found.ways[1:], found.probabilities[1:], strict=True)
        if probability >= contract_levels.LISTED
    )
    # Probabilities of models that are not listed are distributed over the listed ones.
    listed = found.probabilities[0] + sum(rival.probability for rival in rivals)
    rivals = tuple(Rival(rival.effects, rival.probability / listed) for rival in rivals)
    gap = max(_square(found.before) - stills.repeatability**2, 1e-300)
    low, high = (float(x) for x in np.percentile(found.replicates, [2.5, 97.5]))
    return [
        Finding(
            effect=effect,
            joint=joint,
            regime="high_load",
            parameters=_parameters(robot, row, best, k),
            gap_closed=(_square(found.before) - _square(best.left)) / gap,
            gap_closed_interval=(low, high),
            probability=found.probabilities[0] / listed,
            rivals=rivals,
            verdict="one_of" if rivals else "supported",
        )
        for k, effect in enumerate(best.effects)
    ]


def _parameters(robot: Robot, row: int, way: Way, k: int) -> dict[str, Value]:
    value, std = float(way.values[k]), float(way.std[k])
    if way.effects[k] == "backlash":
        return {"gap": Value(value, std, robot.position_units[row])}
    unit = f"{robot.torque_units[row]}/{robot.position_units[row]}"
    return {"stiffness": Value(1.0 / value, std / value**2, unit)}


def _rest_notes(robot: Robot, row: int, stills: StandstillSamples, found: GivingWay) -> list[Note]:
    """Distance of the positions at rest, in the joint's unit and in steps of its reading, and their load."""
    joint, unit = robot.joint_names[row], robot.position_units[row]
    load = np.abs(stills.rest_medians(stills.load))
    numbers = {
        "shift": found.shift,
        "unit": unit,
        "steps": found.shift / stills.quantum if stills.quantum > 0 else None,
        "least": float(load.min()),
        "most": float(load.max()),
        "load_unit": robot.torque_units[row],
        "rests": len(load),
        "counted": LOADED,
    }
    apart = Note(Code.RESTS_APART, joint, numbers)
    return [apart, Note(Code.CONTROLLER_GIVES_WAY, joint)] if found.ways else [apart]


def _bound(robot: Robot, row: int, found: GivingWay) -> Bound:
    return Bound("backlash", robot.joint_names[row], "gap", found.detectable_sizes, robot.position_units[row])


def _gap(robot: Robot, row: int, stills: StandstillSamples, found: GivingWay | None) -> JointGap:
    joint, unit = robot.joint_names[row], robot.position_units[row]
    if found is None:
        return JointGap(joint, unit, 0.0, 0.0, max(stills.repeatability, 1e-12), 0)
    left = found.ways[0].left if found.ways else found.before
    before, after = np.sqrt(_square(found.before)), np.sqrt(_square(left))
    return JointGap(joint, unit, before, after, max(min(stills.repeatability, after), 1e-12), len(stills.t))


def _unexplained(robot: Robot, every: list[StandstillSamples], ways: dict[int, GivingWay]) -> Unexplained:
    """Share of the residual at rest beyond repeatability, and the joint with the largest residual."""
    found = {row: way for row, way in ways.items() if way.ways}
    if not found:
        return Unexplained(0.0, False, None, None)
    left = {row: max(_square(way.ways[0].left) - every[row].repeatability ** 2, 0.0) for row, way in found.items()}
    gap = {row: max(_square(way.before) - every[row].repeatability ** 2, 1e-300) for row, way in found.items()}
    share = {row: left[row] / gap[row] for row in found}
    worst = max(share, key=lambda row: share[row])
    mean = float(np.mean(list(share.values())))
    structured = mean > rules.LITTLE_STRUCTURE
    return Unexplained(mean, structured, robot.joint_names[worst] if structured else None, None)


def _verdict(ways: dict[int, GivingWay], findings: tuple[Finding, ...], rest: Unexplained) -> str:
    if not ways:
        return "not_testable"
    if not findings:
        return "no_gap"
    return "partly_explained" if rest.structured else "explained"


def _evidence(robot: Robot, every: list[StandstillSamples], ways: dict[int, GivingWay], rows: list[int]) -> Evidence:
    """Samples at rest of the joint that gives way most, with its position error instead of a torque."""
    row = rows[0] if rows else 0
    stills, found = every[row], ways.get(row)
    count = (len(stills.t), robot.nv)
    error, after, load = np.zeros(count), np.zeros(count), np.zeros(count)
    error[:, row], load[:, row] = stills.error, stills.load
    if found is not None:
        rest_error = stills.rest_medians(stills.error)
        held_out = found.ways[0].left if found.ways else found.before
        after[:, row] = (rest_error - held_out)[stills.rest]
    still = read_only(np.zeros(count))
    arrays = (read_only(x) for x in (error, np.zeros(count), after))
    measured, before, corrected = arrays
    return Evidence(
        t=read_only(stills.t),
        q=read_only(stills.q),
        v=still,
        a=still,
        tau_measured=measured,
        tau_before=before,
        tau_after=corrected,
        regime_shares=tuple({"high_load": 1.0} if k == row else {} for k in range(robot.nv)),
        tau_transmitted=read_only(load),
    )


def _square(values: Array) -> float:
    return float(np.mean(values**2))


def claims_at_rest(joint: str, found: GivingWay, repeat: float) -> tuple[Claim[EffectAt], ...]:
    """Entries of the ledger: one for each model of the rests, or for each effect of the named model.

    Args:
        joint: Name of the joint.
        found: Fits to its rests.
        repeat: Deviation of the samples within a rest.
    """
    named = found.ways[0].effects if found.ways else ()
    # With loads of one size, or few rests, both effects together cannot be tested, and have no entry.
    asked = WAYS if found.both is not None or not found.ways else WAYS[:2]
    names = [(effect,) for effect in named] + [way for way in asked if not set(way) <= set(named)]
    return tuple(_claim(joint, found, way, repeat) for way in names)


def _claim(joint: str, found: GivingWay, effects: tuple[str, ...], repeat: float) -> Claim[EffectAt]:
    at = tuple(EffectAt(effect, joint) for effect in effects)
    if not found.ways:
        return Claim(at, (found.shown,), "not_claimed", judged_by="rests")
    first = found.ways[0]
    claimed = set(effects) <= set(first.effects)
    gates = until_failed((found.shown, *_against_rivals(found, first.effects if claimed else effects)))
    own = next((way for way in found.ways if way.effects == effects), None)
    if own is None:  # both together, of which one does not differ from zero
        return Claim(at, gates, "not_claimed", judged_by="rests")
    figures = {"closes": _closes(found, own, repeat)}
    if claimed:
        return Claim(at, gates, "claimed", figures=figures, judged_by="rests")
    figures["floors_more"] = (_rms(own.left) - _rms(first.left)) / repeat
    instead = tuple(EffectAt(effect, joint) for effect in first.effects)
    return Claim(at, gates, "displaced", instead, figures, "rests")


def _against_rivals(found: GivingWay, way: tuple[str, ...]) -> tuple[GateResult, ...]:
    """Gates between the models: whether both effects together are needed, and then which model is most probable."""
    odds = {one.effects: share for one, share in zip(found.ways, found.probabilities, strict=True)}
    asked = (found.both,) if len(way) > 1 and found.both is not None else ()
    if way not in odds:
        return asked
    rival = max((share for other, share in odds.items() if other != way), default=0.0)
    return (*asked, likelier_than_rivals(odds[way], rival, leads=way == found.ways[0].effects))


def _closes(found: GivingWay, way: Way, repeat: float) -> float:
    """Share of the joint's gap that a model of the rests explains."""
    before = _rms(found.before) ** 2
    return (before - _rms(way.left) ** 2) / max(before - repeat**2, 1e-300)


def _rms(left: Float[Array, " R"]) -> float:
    return float(np.sqrt(np.mean(left**2)))
