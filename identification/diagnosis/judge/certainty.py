"""How sure a finding is beside what is left without a name on its joint."""

from __future__ import annotations

from dataclasses import replace
from statistics import fmean

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.result import EffectAt, Finding, JointGap, Rival

# Stands for any cause that the catalogue does not have.
UNKNOWN = "unknown"


def beside_what_is_left(finding: Finding, joints: tuple[JointGap, ...]) -> Finding:
    """The same finding, with a cause outside the catalogue as rival where its joint is left with more than noise.

    A comparison among the effects of the catalogue says which of them is best, and not that one of them is right. Where
    the best ones leave a share of the joint's gap, whatever makes that share may have made what they explain.

    Args:
        finding: With rivals of the catalogue; their probabilities and its own sum to one.
        joints: Gaps of all joints, before and after all findings.
    """
    own = [joint for joint in joints if joint.joint in (finding.joint or "").split("+")]
    named = min(map(_named, own)) if own else fmean(map(_named, joints))
    if 1.0 - named < rules.LISTED:
        return finding
    rivals = (*(replace(rival, probability=named * rival.probability) for rival in finding.rivals),)
    rest = Rival((EffectAt(UNKNOWN, finding.joint, finding.recording),), 1.0 - named)
    ranked = tuple(sorted((*rivals, rest), key=lambda rival: -rival.probability))
    return replace(finding, probability=named * finding.probability, rivals=ranked, verdict="one_of")


def _named(joint: JointGap) -> float:
    """Share of a joint's gap that findings close; one where no more than noise is left."""
    quiet = joint.rms_after <= rules.FLOORS_LEFT * joint.noise_floor
    return 1.0 if quiet or joint.closed is None else min(max(joint.closed, 0.0), 1.0)
