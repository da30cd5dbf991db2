"""One diagnosis against its answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isfinite, nan

from .magnitudes import magnitudes
from .twins import Claim, Explanation, explanations

FITS = 0.8  # share of the gap closed from which a model "fits"


@dataclass(frozen=True)
class Judged:
    """What the scorer keeps of one case.

    Attributes:
        id: Of the case.
        kind: ``null``, ``single``, ``pair`` or ``outside``.
        robot: Of the generator.
        effect: True effects, joined by a plus sign; ``none`` for a null; the name of a cause outside the catalogue.
        gap: Paired gap [noise floors], of a pair that of the smaller effect.
        beyond: What is left of the whole gap beyond the tolerance [noise floors].
        verdict: Of the diagnosis; ``failed`` where there is none.
        leading: Effect of the leading finding, or the verdict where there is none.
        claims: Every finding.
        false_claim: A finding, or any verdict other than ``no_gap``; what counts on nulls.
        top1_strict: The leading finding is the truth (of a pair: one of its effects), name and joint.
        top1: The same with what this robot or this recording cannot part as one class.
        all_named: Every true effect, or a twin of it, is a finding.
        exact: And nothing else is claimed.
        in_set: The truth, or a twin of it, is reached by findings and their listed rivals.
        set_size: Findings and rivals listed, over all findings; 0 without a finding.
        joint: Every true joint is named: by the leading finding of a single, by the findings of a pair.
        extra: The findings are more than a right explanation has a place for, whichever listed rivals are taken.
        wrong_but_fits: Findings close more than `FITS` of the gap and the truth is not in the set; of a case from
            outside the catalogue also if the verdict is ``explained``, and never if it is ``unknown``.
        gap_closed: Share of the gap closed; NaN where there is hardly any.
        of_oracle: Share of what a fit closes that knows the cause, at most one; NaN where there is no such fit.
        stated: Stated probability of each listed answer, and whether it is right; twins of the truth are one answer.
        errors: Relative error of each parameter of a strictly right finding.
        covered: Whether each one's 95 % interval holds the truth.
        seconds: Wall time of the whole process.
    """

    id: str
    kind: str
    robot: str
    effect: str
    gap: float
    beyond: float
    verdict: str
    leading: str
    claims: tuple[Claim, ...]
    false_claim: bool
    top1_strict: bool
    top1: bool
    all_named: bool
    exact: bool
    in_set: bool
    set_size: int
    joint: bool
    extra: bool
    wrong_but_fits: bool
    gap_closed: float
    of_oracle: float
    stated: tuple[tuple[float, bool], ...]
    errors: tuple[float, ...]
    covered: tuple[bool, ...]
    seconds: float

    @property
    def outside_right(self) -> bool:
        """Of a cause outside the catalogue: it is called unknown, or named as what it is by a tool that knows it."""
        return self.verdict == "unknown" or self.top1

    def as_json(self) -> dict:
        """For programs: what is not finite becomes null."""
        return {k: None if isinstance(v, float) and not isfinite(v) else v for k, v in asdict(self).items()}


def loss(joints: Sequence[dict], which: str, floors: Sequence[float]) -> float:
    """Mean over joints of the squared residual ``rms_before`` or ``rms_after`` over the squared noise floor."""
    return sum((j[which] / floor) ** 2 for j, floor in zip(joints, floors, strict=True)) / len(joints)


def _closed(joints: list[dict]) -> float:
    """Share of the mean squared gap that the corrected model closes."""
    floors = [j["noise_floor"] for j in joints]
    if not joints or min(floors) <= 0.0:
        return nan
    before, after = loss(joints, "rms_before", floors), loss(joints, "rms_after", floors)
    return (before - after) / (before - 1.0) if before > 1.05 else nan


def _of_oracle(joints: list[dict], oracle: list[dict] | None) -> float:
    """What was closed over what a fit closes that knows the cause, both in the oracle's noise floors."""
    if not oracle or [j["joint"] for j in joints] != [j["joint"] for j in oracle]:
        return nan
    floors = [j["noise_floor"] for j in oracle]
    if min(floors) <= 0.0:
        return nan
    before = loss(oracle, "rms_before", floors)
    most = before - loss(oracle, "rms_after", floors)
    if most < 0.05 * before:
        return nan
    return max(0.0, min(1.0, (before - loss(joints, "rms_after", floors)) / most))


def candidates(finding: dict) -> list[tuple[frozenset[Claim], float]]:
    """The finding and its rivals, each as a set of claims with its stated probability."""
    own = (frozenset({(finding["effect"], finding["joint"])}), finding.get("probability", nan))
    rivals = [
        (frozenset((e["effect"], e["joint"]) for e in rival["effects"]), rival["probability"])
        for rival in finding["rivals"]
    ]
    return [own, *rivals]


def _in_set(right: list[Explanation], findings: list[dict]) -> bool:
    """Some right explanation is reached by taking, for each finding, itself or one of its rivals."""
    reached: set[frozenset[Claim]] = {frozenset()}
    for finding in findings:
        reached = {done | more for done in reached for more in [frozenset(), *(c for c, _ in candidates(finding))]}
    return any(one.needed <= have and have <= one.needed | one.allowed for one in right for have in reached if have)


def _places_for_all(right: list[Explanation], findings: list[dict]) -> bool:
    """Every finding, or one of its rivals, has a place of its own in one right explanation."""

    def placed(left: list[dict], free: frozenset[Claim]) -> bool:
        if not left:
            return True
        return any(placed(left[1:], free - claims) for claims, _ in candidates(left[0]) if claims <= free)

    return any(placed(findings, one.needed | one.allowed) for one in right)


def _stated(right: list[Explanation], findings: list[dict]) -> tuple[tuple[float, bool], ...]:
    """Probabilities as stated: one entry for all right candidates of a finding together, one for each wrong one."""
    out = []
    for finding in findings:
        hit = 0.0
        for claims, probability in candidates(finding):
            if not isfinite(probability):
                continue
            if any(claims & one.needed and claims <= one.needed | one.allowed for one in right):
                hit += probability
            else:
                out.append((probability, False))
        if hit:
            out.append((min(hit, 1.0), True))
    return tuple(out)


def _with_outside_as_effect(answer: dict) -> dict:
    """The answer of a case from outside the catalogue with its cause among the effects."""
    cause = answer["outside"]
    return {**answer, "effects": [{"effect": cause["name"], "joint": cause.get("joint"), "parameters": {}}]}


def judged(answer: dict, entry: dict, oracle: dict | None = None) -> Judged:
    """Scores the result file of a case; a diagnosis that failed is wrong in everything but a null's claim.

    Args:
        answer: Of the generator.
        entry: What the runner kept of the diagnosis.
        oracle: Of the fit that knows the cause, in the same form; None where there is none.
    """
    diagnosis = entry["diagnosis"] or None
    findings = sorted(diagnosis["findings"], key=lambda f: -f["gap_closed"]) if diagnosis else []
    joints = diagnosis["joints"] if diagnosis else []
    verdict = diagnosis["verdict"] if diagnosis else "failed"
    claims = tuple((f["effect"], f["joint"]) for f in findings)
    truth, outside = answer.get("truth", answer["effects"]), answer["kind"] == "outside"
    right, found = explanations(_with_outside_as_effect(answer) if outside else answer), frozenset(claims)
    pair = len(truth) > 1
    named = next((one for one in right if one.needed <= found), None)
    leads = [one for one in right if claims and claims[0] in one.needed and (pair or one.needed <= found)]
    closed, in_set = _closed(joints), _in_set(right, findings)
    fits = bool(claims) and isfinite(closed) and closed > FITS
    true_joints, said_joints = {e["joint"] for e in truth}, {joint for _, joint in (claims if pair else claims[:1])}
    errors, covered = magnitudes(truth, findings)
    known = oracle["diagnosis"]["joints"] if oracle and oracle["diagnosis"] else None
    return Judged(
        id=answer["id"],
        kind=answer["kind"],
        robot=answer["robot"],
        effect=answer["outside"]["name"] if outside else "+".join(e["effect"] for e in truth) or "none",
        gap=min(answer.get("gap_in_floors") or [answer["paired_gap"]]),
        beyond=answer.get("beyond_tolerance") or 0.0,
        verdict=verdict,
        leading=claims[0][0] if claims else verdict,
        claims=claims,
        false_claim=bool(claims) or verdict not in ("no_gap", "failed"),
        top1_strict=bool(right) and any(one is right[0] for one in leads),
        top1=bool(leads),
        all_named=named is not None,
        exact=named is not None and found <= named.needed | named.allowed,
        in_set=in_set,
        set_size=sum(1 + len(f["rivals"]) for f in findings),
        joint=named is not None or (bool(true_joints) and true_joints <= said_joints),
        extra=bool(findings) and not _places_for_all(right, findings),
        wrong_but_fits=(fits or (outside and verdict == "explained"))
        and not in_set
        and not (outside and verdict == "unknown"),
        gap_closed=closed,
        of_oracle=_of_oracle(joints, known),
        stated=_stated(right, findings),
        errors=errors,
        covered=covered,
        seconds=entry["seconds"],
    )
