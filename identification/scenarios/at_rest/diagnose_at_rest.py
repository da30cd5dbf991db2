"""Diagnosis of backlash and compliance from positions at rest.

It is used for recordings with references but without torque, if the gains of the controllers are not stated.
"""

from __future__ import annotations

import time
from uuid import uuid4

import numpy as np

from identification.data.recording import Recording
from identification.data.refusal import fault_warnings, require_right, wrong_with
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.evidence import Evidence
from identification.diagnosis.judge.findings.remaining_gap import lowered_by_remaining_gap
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
from identification.scenarios.at_rest.rest_models import REST_MODELS, RestFits, RestModel, fitted_rests, testable
from identification.scenarios.at_rest.rests import LOADED, StandstillSamples, standstill_samples
from identification.scenarios.measured_poses import with_poses
from identification.words.user_words import user_words
from phantom_dyn import __version__
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.effects import catalogue
from phantom_dyn.model.robot import Robot

_SHOWN_AT_REST = ("backlash", "transmission_compliance")
_ON_MOTOR = (
    "the encoder is before the transmission, where backlash and compliance do not show: state encoder_side: link if it "
    "is on the link's side"
)
_ONE_SIGN = "it does not rest often enough under loads of either sign"
_AT_REST = (
    "positions at rest show only how a joint gives way under load: for all else record the torque, or state the gain "
    "kp of its controller in robot.yaml"
)


def judged_at_rest(robot: Robot, recordings: tuple[Recording, ...]) -> bool:
    """True if only rests can be used: there are references, but neither torque nor gains of controllers.

    At least one joint with its encoder on the link's side has to rest under loads of either sign.
    """
    gains_stated = all(a.controller is not None and a.controller.kp > 0 for a in robot.actuators if a.actuated)
    if gains_stated or any(recording.q_ref is None or recording.tau is not None for recording in recordings):
        return False
    standstill = (standstill_samples(robot, recordings, row) for row in range(robot.nv))
    return any(_untestable_reason(robot, one, row) is None for row, one in enumerate(standstill))


def diagnose_at_rest(robot: Robot, recordings: tuple[Recording, ...]) -> Diagnosis:
    """Diagnosis of backlash and compliance from positions at rest; each rest is predicted by fits without it.

    The load is the modelled weight and the measured external forces. No torque of a drive is used: that of a position
    controller depends only on the position error, and has no information on the transmission.

    Args:
        robot: The robot, with its masses and encoders.
        recordings: Recordings with references.

    Raises:
        LogError: If a recording has no references, has a reference that is not finite, or is certainly wrong.
    """
    started = time.perf_counter()
    require_right(recordings)
    every = [standstill_samples(robot, recordings, row) for row in range(robot.nv)]
    why = [_untestable_reason(robot, standstill, row) for row, standstill in enumerate(every)]
    fits = {row: fitted_rests(standstill) for row, standstill in enumerate(every) if why[row] is None}
    rows = sorted(fits, key=lambda row: -abs(fits[row].shift))
    gaps = tuple(_gap(robot, row, every[row], fits.get(row)) for row in range(robot.nv))
    findings = tuple(
        lowered_by_remaining_gap(finding, gaps)
        for row in rows
        for finding in _findings(robot, row, every[row], fits[row])
    )
    unexplained = _unexplained(robot, every, fits)
    warnings = [note for row in rows for note in _rest_notes(robot, row, every[row], fits[row])]
    found = Diagnosis(
        verdict=_verdict(fits, findings, unexplained),
        robot=robot.name,
        recordings=tuple(recording.file for recording in recordings),
        joints=gaps,
        band_hz=(0.0, 0.0),
        findings=findings,
        adjusted=(),
        unexplained=unexplained,
        bounds=tuple(
            Bound("backlash", robot.joint_names[row], "gap", fit.detectable_size, robot.position_units[row])
            for row, fit in fits.items()
            if not fit.models
        ),
        not_testable=_untestable(robot, why),
        data_warnings=(
            *fault_warnings(recordings),
            *robot.warnings,
            *(remark for recording in recordings for remark in recording.remarks),
            *warnings,
        ),
        next_experiment=None,
        rollout=None,
        seconds=time.perf_counter() - started,
        version=__version__,
        evidence=_evidence(robot, every, fits, rows),
        wrong=wrong_with(recordings),
        run=uuid4().hex,
        ledger=tuple(
            claim
            for row in rows
            for claim in claims_at_rest(robot.joint_names[row], fits[row], every[row].repeatability)
        ),
    )
    return with_poses(found, robot, recordings)


def _untestable_reason(robot: Robot, standstill: StandstillSamples, row: int) -> str | None:
    """Why the rests of a joint cannot show backlash or compliance; None if they can."""
    if robot.actuators[row].encoder_side == "motor":
        return _ON_MOTOR
    return None if testable(standstill) else _ONE_SIGN


def _untestable(robot: Robot, why: list[str | None]) -> tuple[NotTestable, ...]:
    """Effects that rests cannot show; ``why`` has the reason for each joint, None for a joint whose rests show both."""
    out = []
    for effect in catalogue.effects_of(robot):
        words = user_words(effect.name, robot)
        for joint in effect.places(robot):
            can_show = effect.name in _SHOWN_AT_REST and joint is not None
            reason = why[robot.joint_names.index(joint)] if can_show else _AT_REST
            out += [NotTestable(effect.name, joint, reason, words)] if reason is not None else []
    return tuple(out)


def _findings(robot: Robot, row: int, standstill: StandstillSamples, found: RestFits) -> list[Finding]:
    """Findings on one joint: one for each effect of the most probable model of its rests."""
    if not found.models:
        return []
    joint, best = robot.joint_names[row], found.models[0]
    rivals = tuple(
        Rival(tuple(EffectAt(effect, joint) for effect in model.effects), probability)
        for model, probability in zip(found.models[1:], found.probabilities[1:], strict=True)
        if probability >= contract_levels.LISTED
    )
    # Probabilities of models that are not listed are distributed over the listed ones.
    listed = found.probabilities[0] + sum(rival.probability for rival in rivals)
    rivals = tuple(Rival(rival.effects, rival.probability / listed) for rival in rivals)
    low, high = (float(x) for x in np.percentile(found.replicates, [2.5, 97.5]))
    return [
        Finding(
            effect=effect,
            joint=joint,
            regime="high_load",
            parameters=_parameters(robot, row, best, k),
            gap_closed=_gap_closed(found, best, standstill.repeatability),
            gap_closed_interval=(low, high),
            probability=found.probabilities[0] / listed,
            rivals=rivals,
            verdict="one_of" if rivals else "supported",
        )
        for k, effect in enumerate(best.effects)
    ]


def _parameters(robot: Robot, row: int, model: RestModel, k: int) -> dict[str, Value]:
    value, std = float(model.values[k]), float(model.std[k])
    if model.effects[k] == "backlash":
        return {"gap": Value(value, std, robot.position_units[row])}
    unit = f"{robot.torque_units[row]}/{robot.position_units[row]}"
    return {"stiffness": Value(1.0 / value, std / value**2, unit)}


def _rest_notes(robot: Robot, row: int, standstill: StandstillSamples, found: RestFits) -> list[Note]:
    """Notes on how far apart a joint rests under loads of opposite sign, and on the loads."""
    joint, unit = robot.joint_names[row], robot.position_units[row]
    load = np.abs(standstill.rest_medians(standstill.load))
    numbers = {
        "shift": found.shift,
        "unit": unit,
        "steps": found.shift / standstill.quantum if standstill.quantum > 0 else None,
        "least": float(load.min()),
        "most": float(load.max()),
        "load_unit": robot.torque_units[row],
        "rests": len(load),
        "counted": LOADED,
    }
    distance = Note(Code.RESTS_APART, joint, numbers)
    return [distance, Note(Code.CONTROLLER_GIVES_WAY, joint)] if found.models else [distance]


def _gap(robot: Robot, row: int, standstill: StandstillSamples, found: RestFits | None) -> JointGap:
    joint, unit = robot.joint_names[row], robot.position_units[row]
    if found is None:
        return JointGap(joint, unit, 0.0, 0.0, max(standstill.repeatability, 1e-12), 0)
    residual = found.models[0].residual if found.models else found.before
    before, after = _rms(found.before), _rms(residual)
    return JointGap(joint, unit, before, after, max(min(standstill.repeatability, after), 1e-12), len(standstill.t))


def _unexplained(robot: Robot, every: list[StandstillSamples], fits: dict[int, RestFits]) -> Unexplained:
    """Share of the residual at rest beyond repeatability, and the joint with the largest residual."""
    found = {row: fit for row, fit in fits.items() if fit.models}
    if not found:
        return Unexplained(0.0, False, None, None)
    residual = {
        row: max(_mean_square(fit.models[0].residual) - every[row].repeatability ** 2, 0.0)
        for row, fit in found.items()
    }
    gap = {row: max(_mean_square(fit.before) - every[row].repeatability ** 2, 1e-300) for row, fit in found.items()}
    share = {row: residual[row] / gap[row] for row in found}
    worst = max(share, key=lambda row: share[row])
    mean = float(np.mean(list(share.values())))
    structured = mean > rules.LITTLE_STRUCTURE
    return Unexplained(mean, structured, robot.joint_names[worst] if structured else None, None)


def _verdict(fits: dict[int, RestFits], findings: tuple[Finding, ...], unexplained: Unexplained) -> str:
    if not fits:
        return "not_testable"
    if not findings:
        return "no_gap"
    return "partly_explained" if unexplained.structured else "explained"


def _evidence(robot: Robot, every: list[StandstillSamples], fits: dict[int, RestFits], rows: list[int]) -> Evidence:
    """Samples at rest of the joint that moves most under load, with its position error in place of a torque."""
    row = rows[0] if rows else 0
    standstill, found = every[row], fits.get(row)
    count = (len(standstill.t), robot.nv)
    error, after, load = np.zeros(count), np.zeros(count), np.zeros(count)
    error[:, row], load[:, row] = standstill.error, standstill.load
    if found is not None:
        rest_error = standstill.rest_medians(standstill.error)
        held_out = found.models[0].residual if found.models else found.before
        after[:, row] = (rest_error - held_out)[standstill.rest]
    zero = read_only(np.zeros(count))
    return Evidence(
        t=read_only(standstill.t),
        q=read_only(standstill.q),
        v=zero,
        a=zero,
        tau_measured=read_only(error),
        tau_before=zero,
        tau_after=read_only(after),
        regime_shares=tuple({"high_load": 1.0} if k == row else {} for k in range(robot.nv)),
        tau_transmitted=read_only(load),
    )


def claims_at_rest(joint: str, found: RestFits, repeatability: float) -> tuple[Claim[EffectAt], ...]:
    """Entries of the ledger: one for each effect of the claimed model, and one for each other model.

    Args:
        joint: Name of the joint.
        found: Fits to its rests.
        repeatability: Standard deviation of the samples within a rest [rad or m].
    """
    named = found.models[0].effects if found.models else ()
    # The third model, both effects together, has no entry if it could not be tested.
    tested = REST_MODELS if found.both_needed is not None or not found.models else REST_MODELS[:2]
    names = [(effect,) for effect in named] + [model for model in tested if not set(model) <= set(named)]
    return tuple(_claim(joint, found, model, repeatability) for model in names)


def _claim(joint: str, found: RestFits, effects: tuple[str, ...], repeatability: float) -> Claim[EffectAt]:
    at = tuple(EffectAt(effect, joint) for effect in effects)
    if not found.models:
        return Claim(at, (found.above_chance,), "not_claimed", judged_by="rests")
    first = found.models[0]
    claimed = set(effects) <= set(first.effects)
    gates = until_failed((found.above_chance, *_against_rivals(found, first.effects if claimed else effects)))
    own = next((model for model in found.models if model.effects == effects), None)
    if own is None:  # the model of both effects was rejected, because one of them does not differ from zero
        return Claim(at, gates, "not_claimed", judged_by="rests")
    figures = {"closes": _gap_closed(found, own, repeatability)}
    if claimed:
        return Claim(at, gates, "claimed", figures=figures, judged_by="rests")
    figures["floors_more"] = (_rms(own.residual) - _rms(first.residual)) / repeatability
    instead = tuple(EffectAt(effect, joint) for effect in first.effects)
    return Claim(at, gates, "displaced", instead, figures, "rests")


def _against_rivals(found: RestFits, model: tuple[str, ...]) -> tuple[GateResult, ...]:
    """Gates between the models: whether a model of two effects needs both, and whether the model is most probable."""
    odds = {one.effects: share for one, share in zip(found.models, found.probabilities, strict=True)}
    both = (found.both_needed,) if len(model) > 1 and found.both_needed is not None else ()
    if model not in odds:
        return both
    rival = max((share for other, share in odds.items() if other != model), default=0.0)
    return (*both, likelier_than_rivals(odds[model], rival, leads=model == found.models[0].effects))


def _gap_closed(found: RestFits, model: RestModel, repeatability: float) -> float:
    """Share of the joint's gap that a model of the rests explains."""
    before = _mean_square(found.before)
    return (before - _mean_square(model.residual)) / max(before - repeatability**2, 1e-300)


def _mean_square(values: Float[Array, " R"]) -> float:
    return float(np.mean(values**2))


def _rms(values: Float[Array, " R"]) -> float:
    return float(np.sqrt(_mean_square(values)))
