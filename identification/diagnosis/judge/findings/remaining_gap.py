"""Lowers the probability of a finding if the findings leave a part of its joint's gap."""

from __future__ import annotations

from dataclasses import replace
from math import fsum

from identification.diagnosis.result import Finding, JointGap
from identification.engine import contract_levels
from phantom_dyn.effects.catalogue import known_effect


def lowered_by_remaining_gap(finding: Finding, joints: tuple[JointGap, ...]) -> Finding:
    """The finding with lower probabilities if the residual of its joint is larger than noise after all findings.

    A comparison among the effects of the catalogue shows which of them fits best, but not that one of them is right. If
    a share of the joint's gap remains, its unknown cause may also cause the part that the finding explains. Therefore
    all probabilities are multiplied by the share of the gap that is closed. Their sum is then less than one, and the
    difference is the probability of a cause outside the catalogue.

    Args:
        finding: Finding with rivals of the catalogue; their probabilities and its own sum to at most one.
        joints: Gaps of all joints, before and after all findings.
    """
    own = [joint for joint in joints if joint.joint in (finding.joint or "").split("+")]
    closed = min(map(_closed_share, own)) if own else fsum(map(_closed_share, joints)) / len(joints)
    known = known_effect(finding.effect)
    # An effect that only adds noise, such as encoder resolution, is measured from the readings and has no rivals.
    if (known is not None and known.only_noise) or 1.0 - closed < contract_levels.LISTED:
        return finding
    rivals = tuple(replace(rival, probability=closed * rival.probability) for rival in finding.rivals)
    return replace(finding, probability=closed * finding.probability, rivals=rivals)


def _closed_share(joint: JointGap) -> float:
    """Share of a joint's gap that findings close; one if the residual is only noise."""
    is_noise = joint.rms_after <= contract_levels.FLOORS_LEFT * joint.noise_floor
    return 1.0 if is_noise or joint.closed is None else min(max(joint.closed, 0.0), 1.0)
