"""What a claim has to gain on held-out data: more than chance gives, over the whole catalogue or on one joint."""

from __future__ import annotations

from dataclasses import dataclass

from identification.diagnosis.terms import Term


@dataclass(frozen=True)
class Threshold:
    """Held-out gain below which no effect is claimed: what chance gives over the whole catalogue, or on one joint.

    Attributes:
        overall: What no effect reaches by chance.
        joints: The same for the effects of one joint, None for those of no single joint. Noise of a joint that nothing
            explains raises what chance seems to give there, which is no reason to doubt effects on others.
    """

    overall: float
    joints: dict[str | None, float]

    def of(self, *terms: Term) -> float:
        """For these effects together."""
        return max((min(self.joints.get(joint_of(term), self.overall), self.overall) for term in terms), default=0.0)

    def lowered(self, other: Threshold) -> Threshold:
        """The lower one of two, everywhere."""
        joints = {
            joint: min(both.joints.get(joint, both.overall) for both in (self, other))
            for joint in {*self.joints, *other.joints}
        }
        return Threshold(min(self.overall, other.overall), joints)


def joint_of(term: Term) -> str | None:
    """The single joint that a term sits on, None if there is none (a coupling sits on two, joined by ``+``)."""
    return None if term.joint is None or "+" in term.joint else term.joint
