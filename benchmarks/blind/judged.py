"""One diagnosis against its answer."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

from benchmarks.blind.twins import Claim, Explanation, explanations

FITS = 0.8  # share of the gap closed from which a model "fits"


@dataclass(frozen=True)
class Judged:
    """What the scorer keeps of one case.

    Attributes:
        id: Of the case.
        kind: ``null``, ``single``, ``pair`` or ``outside``.
        robot: Of the generator.
        effect: True effects, joined by a plus sign; ``none`` for a null.
        gap: Paired gap [noise floors].
        beyond: What is left of it beyond the tolerance [noise floors].
        verdict: Of the diagnosis; ``failed`` where there is none.
        leading: Effect of the leading finding, or the verdict where there is none.
        claims: Every finding.
        false_claim: A finding, or any verdict other than ``no_gap``; what counts on nulls.
        top1_strict: The leading finding is the truth, name and joint.
        top1_table: The same with the twins of the robot as one class.
        top1: The same with what this recording cannot part as one class.
        exact: And nothing else is claimed.
        in_set: The truth, or a twin of it, is a finding or one of the listed rivals.
        set_size: Explanations listed for the leading finding, itself included; 0 without a finding.
        joint: The leading finding names the right joint, or is right.
        extra: A finding that belongs to no right explanation.
        wrong_but_fits: Findings close more than `FITS` of the gap and the truth is not in the set.
        gap_closed: Share of the gap closed; NaN where there is hardly any.
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
    top1_table: bool
    top1: bool
    exact: bool
    in_set: bool
    set_size: int
    joint: bool
    extra: bool
    wrong_but_fits: bool
    gap_closed: float
    errors: tuple[float, ...]
    covered: tuple[bool, ...]
    seconds: float


def _closed(joints: list[dict]) -> float:
    """Share of the mean squared gap that the corrected model closes."""
    if not joints or any(j["noise_floor"] <= 0.0 for j in joints):
        return nan
    before, after = (
        sum((j[name] / j["noise_floor"]) ** 2 for j in joints) / len(joints) for name in ("rms_before", "rms_after")
    )
    return (before - after) / (before - 1.0) if before > 1.05 else nan


def _magnitudes(answer: dict, findings: list[dict]) -> tuple[tuple[float, ...], tuple[bool, ...]]:
    """Relative errors and coverage of the parameters whose finding names effect and joint as the truth does."""
    errors, covered = [], []
    for effect in answer["effects"]:
        for finding in findings:
            if (finding["effect"], finding["joint"]) != (effect["effect"], effect["joint"]):
                continue
            for name, truth in effect["parameters"].items():
                value = finding["parameters"].get(name)
                if value is None or not isinstance(value["value"], int | float):
                    continue
                miss = abs(value["value"] - truth)
                covered.append(miss <= 1.96 * value["std"])
                if truth:
                    errors.append(miss / abs(truth))
    return tuple(errors), tuple(covered)


def _candidates(finding: dict) -> list[frozenset[Claim]]:
    """The finding and its rivals, each as a set of claims."""
    rivals = [frozenset((e["effect"], e["joint"]) for e in rival["effects"]) for rival in finding["rivals"]]
    return [frozenset({(finding["effect"], finding["joint"])}), *rivals]


def _in_set(right: list[Explanation], findings: list[dict]) -> bool:
    """Some right explanation is reached by taking, for each finding, itself or one of its rivals."""
    reached: set[frozenset[Claim]] = {frozenset()}
    for finding in findings:
        reached = {done | more for done in reached for more in [frozenset(), *_candidates(finding)]}
    return any(one.needed <= have and have <= one.needed | one.allowed for one in right for have in reached if have)


def judged(answer: dict, entry: dict) -> Judged:
    """Scores the result file of a case; a diagnosis that failed is wrong in everything but a null's claim."""
    diagnosis = entry["diagnosis"]
    findings = sorted(diagnosis["findings"], key=lambda f: -f["gap_closed"]) if diagnosis else []
    verdict = diagnosis["verdict"] if diagnosis else "failed"
    claims = tuple((f["effect"], f["joint"]) for f in findings)
    right, found = explanations(answer), frozenset(claims)
    hit = next((one for one in right if claims and claims[0] in one.needed and one.needed <= found), None)
    belongs = (hit.needed | hit.allowed) if hit else frozenset().union(*(one.needed | one.allowed for one in right))
    closed, in_set = _closed(diagnosis["joints"]) if diagnosis else nan, _in_set(right, findings)
    errors, covered = _magnitudes(answer, findings)
    return Judged(
        id=answer["id"],
        kind=answer["kind"],
        robot=answer["robot"],
        effect="+".join(e["effect"] for e in answer["effects"]) or "none",
        gap=answer["paired_gap"],
        beyond=answer.get("beyond_tolerance", 0.0),
        verdict=verdict,
        leading=claims[0][0] if claims else verdict,
        claims=claims,
        false_claim=bool(claims) or verdict not in ("no_gap", "failed"),
        top1_strict=bool(right) and hit is right[0],
        top1_table=any(hit is one for one in right[: len(right) - len(answer.get("alike", []))]),
        top1=hit is not None,
        exact=hit is not None and found <= belongs,
        in_set=in_set,
        set_size=1 + len(findings[0]["rivals"]) if findings else 0,
        joint=hit is not None or (bool(claims) and claims[0][1] in {e["joint"] for e in answer["effects"]}),
        extra=bool(found - belongs),
        wrong_but_fits=bool(claims) and isfinite(closed) and closed > FITS and not in_set,
        gap_closed=closed,
        errors=errors,
        covered=covered,
        seconds=entry["seconds"],
    )
