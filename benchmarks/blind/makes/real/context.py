"""Removes from a diagnosis the findings that it also has without an added effect: the context of a case."""

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
    """The context that an answer lists: the diagnoses of both parts without an added effect.

    Args:
        null: Diagnosis of part two without an added effect.
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
    """A diagnosis without its context; unchanged for a null, and for answers without a context.

    Findings are removed if the context names their family at their joint. If the context already has the verdict
    `unknown` and there is a new finding, the verdict becomes `partly_explained`. Residuals are stated in the noise
    floors of the answer.
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
    """A result of the runner whose diagnosis has no context, see `without_context`."""
    return {**entry, "diagnosis": without_context(answer, entry["diagnosis"]) if entry["diagnosis"] else None}
