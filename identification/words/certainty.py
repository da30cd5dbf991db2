"""How sure a finding is beside what is left without a name on its joint."""

from __future__ import annotations

from dataclasses import replace
from math import fsum

from identification.diagnosis.result import Diagnosis, Finding, JointGap
from identification.engine import contract_levels
from phantom_dyn.effects.catalogue import known_effect


def as_told(diagnosis: Diagnosis) -> Diagnosis:
    """A diagnosis with the probabilities that its words state, see `beside_what_is_left`.

    Its file keeps the comparison among the effects of the catalogue, whose probabilities sum to one.
    """
    findings, minor = (
        tuple(beside_what_is_left(finding, diagnosis.joints) for finding in some)
        for some in (diagnosis.findings, diagnosis.minor)
    )
    return replace(diagnosis, findings=findings, minor=minor)


def beside_what_is_left(finding: Finding, joints: tuple[JointGap, ...]) -> Finding:
    """The same finding with lower probabilities where its joint is left with more than noise.

    A comparison among the effects of the catalogue says which of them is best, and not that one of them is right. Where
    the best ones leave a share of the joint's gap, whatever makes that share may have made what they explain. So what
    is missing to one is the probability of a cause outside the catalogue.

    Args:
        finding: With rivals of the catalogue; their probabilities and its own sum to one.
        joints: Gaps of all joints, before and after all findings.
    """
    own = [joint for joint in joints if joint.joint in (finding.joint or "").split("+")]
    named = min(map(_named, own)) if own else fsum(map(_named, joints)) / len(joints)
    known = known_effect(finding.effect)
    # What is noise alone is read off the readings, and compared with nothing.
    if (known is not None and known.only_noise) or 1.0 - named < contract_levels.LISTED:
        return finding
    rivals = tuple(replace(rival, probability=named * rival.probability) for rival in finding.rivals)
    return replace(finding, probability=named * finding.probability, rivals=rivals)


def _named(joint: JointGap) -> float:
    """Share of a joint's gap that findings close; one where no more than noise is left."""
    quiet = joint.rms_after <= contract_levels.FLOORS_LEFT * joint.noise_floor
    return 1.0 if quiet or joint.closed is None else min(max(joint.closed, 0.0), 1.0)
