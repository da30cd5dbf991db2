"""Check whether the numbers in a ``diagnosis.json`` support its verdict, as the file format's contract requires."""

from __future__ import annotations

import math

FLOORS = 1.5  # a gap is closed if the residual is at most this many noise floors,
SHARE = 0.1  # or at most this share of the gap remains
LITTLE = 0.1  # a structured residual below this share of the explainable gap does not contradict
FAR = 2.0  # a joint strays in simulation if its error is at least this many times that by noise


def contradiction(diagnosis: dict) -> str | None:
    """Description of what contradicts the verdict ``no_gap`` or ``explained`` of a diagnosis, or None."""
    verdict, left = diagnosis["verdict"], diagnosis["unexplained"]
    if verdict not in ("no_gap", "explained"):
        return None
    if left["where"]["times"]:
        return f"{verdict}, and something acts at {len(left['where']['times'])} times"
    if verdict == "no_gap":
        if diagnosis["findings"] or left["structured"]:
            return "no_gap, with findings or structure"
        strays = (diagnosis.get("rollout") or {}).get("strays", {})
        far = [joint for joint, times in strays.items() if times >= FAR]
        if far:
            return f"no_gap, and {far[0]} strays further than noise makes it in simulation"
        above = [joint["joint"] for joint in diagnosis["joints"] if joint["rms_after"] > _highest(joint)]
        return f"no_gap, and {above[0]} is above its noise floor" if above else None
    if left["structured"] and left["fraction_of_explainable"] >= LITTLE:
        return "explained, with structure of weight left"
    much = [joint["joint"] for joint in diagnosis["joints"] if not _nearly_closed(joint)]
    return f"explained, and {much[0]} has much left" if much else None


def _highest(joint: dict) -> float:
    """Largest residual of a joint that may be noise."""
    interval = joint["noise_floor_interval"]
    highest = joint["noise_floor"] if interval is None else interval[1]
    return math.hypot(highest, joint.get("discrepancy") or 0.0)


def _nearly_closed(joint: dict) -> bool:
    """True if the residual of a joint may be noise, or if little of its gap remains."""
    floor = joint["noise_floor"]
    within = joint["rms_before"] if joint["rms_within_tolerance"] is None else joint["rms_within_tolerance"]
    after, gap = (joint["rms_after"] / floor) ** 2, (within / floor) ** 2 - 1.0
    return joint["rms_after"] <= _highest(joint) or after <= FLOORS**2 or after - 1.0 <= SHARE * gap
