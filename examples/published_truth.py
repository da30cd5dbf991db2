"""What is published of a real recording, and a rule that says whether a diagnosis agrees with it.

A published cause is *named* if it is a finding at its joint or belongs to one of that finding's rivals. It is *sized*
if the finding itself states the published size to a quarter. It is *hidden* if it is not named, and the diagnosis says
of such an effect at that joint that this recording cannot show it, or shows it only above a bound that the published
size does not reach. The diagnosis is

- right if every cause that is not hidden is named, and every one of these with a published size is sized;
- wrong if fewer than half of those are named, or if a cause that cannot be is stated with a probability above 0.9;
- partly right else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

# Which parameters state the same size: of the Coulomb friction, of the viscous friction, and so on.
SAME = {
    "coulomb": ("torque", "coulomb_torque", "torque_positive", "torque_negative"),
    "viscous": ("coefficient", "coefficient_positive", "coefficient_negative"),
    "mass": ("mass",),
    "gap": ("gap",),
    "inertia": ("inertia",),
}
COULOMB = ("coulomb_friction", "stribeck_friction", "presliding_friction", "direction_dependent_friction")
VISCOUS = ("viscous_friction", "direction_dependent_friction")
LOAD = ("payload", "inertial_parameters")
NEAR = 0.25  # of a published size
CERTAIN = 0.9


@dataclass(frozen=True)
class Cause:
    """One published cause.

    Attributes:
        effects: Names of the catalogue that mean it.
        joint: Where; None: the whole robot, or wherever such an effect is stated.
        size: Published, where it is.
        kind: Which of ``SAME`` the size is.
    """

    effects: tuple[str, ...]
    joint: str | None = None
    size: float | None = None
    kind: str = ""


@dataclass(frozen=True)
class Truth:
    """What is published of a recording.

    Attributes:
        causes: All of them have to be found.
        impossible: Effects that the robot certainly does not have.
    """

    causes: tuple[Cause, ...]
    impossible: tuple[str, ...] = ()


def frictions(joints: Sequence[str], torques: Sequence[float], effects: tuple[str, ...], kind: str) -> list[Cause]:
    """A friction on every joint."""
    return [Cause(effects, joint, size, kind) for joint, size in zip(joints, torques, strict=True)]


def judged(truth: Truth, diagnosis: dict) -> str:
    """``right``, ``partly`` or ``wrong``, with the number of causes that are named, sized and hidden."""
    findings = diagnosis["findings"]
    named = [cause for cause in truth.causes if any(_names(finding, cause) for finding in findings)]
    hidden = [cause for cause in truth.causes if cause not in named and _hidden(diagnosis, cause)]
    seen = [cause for cause in truth.causes if cause not in hidden]
    stated = [cause for cause in seen if cause.size is not None]
    sized = [cause for cause in stated if any(_sizes(finding, cause) for finding in findings)]
    impossible = [
        finding for finding in findings if finding["effect"] in truth.impossible and finding["probability"] > CERTAIN
    ]
    if impossible or 2 * len(named) < len(seen):
        word = "wrong"
    elif len(named) == len(seen) and len(sized) == len(stated):
        word = "right"
    else:
        word = "partly"
    counts = f"{len(named)} of {len(truth.causes)} causes" if truth.causes else "nothing to find"
    sizes = f", {len(sized)} of {len(stated)} sizes" if stated else ""
    return f"{word}: {counts}{sizes}" + (f", {len(hidden)} below what can be seen" if hidden else "")


def _names(finding: dict, cause: Cause) -> bool:
    """True if a finding or one of its rivals is the cause."""
    sets = [finding, *(effect for rival in finding["rivals"] for effect in rival["effects"])]
    return any(one["effect"] in cause.effects and cause.joint in (None, one["joint"]) for one in sets)


def _hidden(diagnosis: dict, cause: Cause) -> bool:
    """True if the diagnosis says that this recording cannot show the cause in its published size."""
    below = [bound for bound in diagnosis.get("bounds", []) if _of(bound, cause) and cause.size is not None]
    untested = any(_of(place, cause) for place in diagnosis.get("not_testable", []))
    return untested or any(b["parameter"] in SAME[cause.kind] and abs(cause.size or 0.0) <= b["below"] for b in below)


def _of(place: dict, cause: Cause) -> bool:
    return place["effect"] in cause.effects and cause.joint in (None, place["joint"])


def _sizes(finding: dict, cause: Cause) -> bool:
    """True if a finding states the published size of a cause, in the mean over what it states of that kind."""
    if finding["effect"] not in cause.effects or cause.joint not in (None, finding["joint"]) or cause.size is None:
        return False
    values = [value["value"] for name, value in finding["parameters"].items() if name in SAME[cause.kind]]
    return bool(values) and abs(sum(values) / len(values) - cause.size) <= NEAR * abs(cause.size)
