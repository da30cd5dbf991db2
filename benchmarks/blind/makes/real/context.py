"""What was said of a part while nothing had been added: kept apart from what an effect changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from benchmarks.gapbench.scoring.submission import in_true_floors

Place = tuple[str, str]  # family of effects, joint or ``robot``
FAMILIES: Mapping[str, Sequence[str]] = {
    "friction": (
        "viscous_friction",
        "coulomb_friction",
        "direction_dependent_friction",
        "stribeck_friction",
        "presliding_friction",
        "load_dependent_friction",
        "joint_coupling",
    ),
    "load": ("torque_constant", "rotor_inertia", "payload", "inertial_parameters", "base_tilt"),
    "place": ("cogging", "torque_offset", "parasitic_spring", "encoder_offset", "encoder_eccentricity"),
    "timing": (
        "input_delay",
        "actuator_lag",
        "torque_saturation",
        "backlash",
        "transmission_compliance",
        "encoder_quantization",
    ),
}


def places(effect: str, joint: str | None) -> frozenset[Place]:
    """Family of an effect at each of its joints."""
    family = next((name for name, members in FAMILIES.items() if effect in members), effect)
    return frozenset((family, at) for at in (joint.split("+") if joint else ["robot"]))


def named(findings: Iterable[Mapping]) -> frozenset[Place]:
    """Families at joints that findings or their rivals name."""
    out: set[Place] = set()
    for finding in findings:
        out |= places(finding["effect"], finding["joint"])
        for rival in finding["rivals"]:
            for one in rival["effects"]:
                out |= places(one["effect"], one["joint"])
    return frozenset(out)


def context_of(null: Mapping, part_one: Mapping) -> dict:
    """What an answer says of the part as it was recorded.

    Args:
        null: Diagnosis of part two with nothing added.
        part_one: Diagnosis of part one, with which the model was corrected.
    """
    return {
        "verdict": null["verdict"],
        "findings": [{"effect": f["effect"], "joint": f["joint"]} for f in null["findings"]],
        "places": sorted(map(list, named(null["findings"]))),
        "rms_within_tolerance": [j["rms_within_tolerance"] for j in null["joints"]],
        "estimated_floor": [j["noise_floor"] for j in null["joints"]],
        "part_one": {
            "verdict": part_one["verdict"],
            "findings": [{"effect": f["effect"], "joint": f["joint"]} for f in part_one["findings"]],
            "unexplained": part_one["unexplained"],
        },
    }


def without_context(answer: Mapping, diagnosis: dict) -> dict:
    """A diagnosis with what it says of the effect alone: as it is for a null, and for answers without a context.

    Findings of a family at a joint that was named before are taken out. A verdict `unknown` that was there before is
    none of the effect's where something new is found. What is left is measured in the floors of the answer.
    """
    context = answer.get("context")
    if context is None or answer["kind"] == "null":
        return diagnosis
    before = {(family, at) for family, at in context["places"]}
    new = [f for f in diagnosis["findings"] if not places(f["effect"], f["joint"]) & before]
    same = new and diagnosis["verdict"] == context["verdict"] == "unknown"
    return {
        **diagnosis,
        "findings": new,
        "verdict": "partly_explained" if same else diagnosis["verdict"],
        "joints": in_true_floors(answer, diagnosis["joints"]),
    }


def entry_without_context(answer: Mapping, entry: dict) -> dict:
    """What the runner kept of a diagnosis, with what that says of the effect alone."""
    return {**entry, "diagnosis": without_context(answer, entry["diagnosis"]) if entry["diagnosis"] else None}
