"""Made-up diagnoses for everything that writes one down."""

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import (
    Adjusted,
    Bound,
    Diagnosis,
    EffectAt,
    Finding,
    JointGap,
    NotTestable,
    Rival,
    Unexplained,
    Value,
)
from identification.engine.claims import Claim, GateResult


def _evidence(nv: int, samples: int, prismatic: bool) -> Evidence:
    rng = np.random.default_rng(5)
    t = np.arange(samples) / 200.0
    t[samples // 2 :] += 5.0  # the second recording
    w = 0.6 + 0.25 * np.arange(nv)
    swing = np.sin(np.outer(t, w) + np.arange(nv)) * (0.3 if prismatic else 1.2)
    v = np.cos(np.outer(t, w) + np.arange(nv)) * w * (0.3 if prismatic else 1.2)
    a = -swing * w**2
    tau_after = 0.4 * a + 2.0 * swing
    measured = tau_after + 0.25 * np.tanh(v / 0.01) + 0.03 * rng.standard_normal((samples, nv))
    shares = {"velocity_reversal": 0.44, "low_speed": 0.21, "high_load": 0.05, "everywhere": 0.3}
    return Evidence(t, swing, v, a, measured, tau_after, tau_after + 0.25 * np.sign(v), (shares,) * nv)


def _finding(k: int, joint: str) -> Finding:
    effects = (
        ("coulomb_friction", "velocity_reversal", {"torque": Value(0.251, 0.0006, "N m")}),
        ("viscous_friction", "high_speed", {"coefficient": Value(0.13, 0.021, "N m s/rad")}),
        (
            "cogging",
            "periodic_in_angle",
            {"order": Value([6.0, 12.0], [0.0, 0.0], "1"), "amplitude": Value([0.02, 0.004], [1e-3, 4e-4], "N m")},
        ),
    )
    effect, regime, parameters = effects[k % 3]
    rivals = (Rival((EffectAt("presliding_friction", joint), EffectAt("torque_offset", joint)), 0.07),)
    return Finding(
        effect, joint, regime, parameters, 0.83, (0.80, 0.86), 0.93, rivals[: k % 2], ("supported", "one_of")[k % 2]
    )


def _ledger(joints: tuple[str, ...], findings: int) -> tuple[Claim[EffectAt], ...]:
    """The findings, and seven claims that are none, the first of which a finding explains as well."""
    passed = GateResult("more than chance", 521.0, 20.0, "gain", True)
    few = GateResult("more than chance", 3.5, 20.0, "gain", False)
    named = [_finding(k, joints[k % len(joints)]) for k in range(findings)]
    claimed = [
        Claim((EffectAt(one.effect, one.joint),), (passed,), "claimed", figures={"closes": one.gap_closed})
        for one in named
    ]
    instead = tuple(EffectAt(one.effect, one.joint) for one in named[:1])
    outcome = "displaced" if instead else "not_claimed"
    load = Claim((EffectAt("payload", None),), (few,), outcome, instead, {"closes": 0.61, "floors_more": 0.42})
    others = ("torque_offset", "cogging", "parasitic_spring", "actuator_lag", "input_delay", "rotor_inertia")
    rest = [
        Claim((EffectAt(effect, joints[-1]),), (few,), "not_claimed", figures={"closes": 0.1 / (k + 1)})
        for k, effect in enumerate(others)
    ]
    return (*claimed, load, *rest)


def _joint(joint: str, unit: str, k: int, samples: int) -> JointGap:
    return JointGap(
        joint, unit, 0.25 / k, 0.031 / k, 0.03 / k, samples, 1.2, 0.24 / k, (0.028 / k, 0.032 / k), "sensors", 0.99
    )


def made_up_diagnosis(
    joints: tuple[str, ...] = ("j1", "j2"), findings: int = 1, samples: int = 6000, unit: str = "N m"
) -> Diagnosis:
    """A diagnosis of a robot that lacks Coulomb friction of 0.25 on every joint."""
    nv = len(joints)
    return Diagnosis(
        verdict="explained" if findings else "no_gap",
        robot="arm.urdf",
        recordings=("first.csv", "second.csv"),
        joints=tuple(_joint(joint, unit, k + 1, samples // 2) for k, joint in enumerate(joints)),
        band_hz=(0.0, 25.0),
        findings=tuple(_finding(k, joints[k % nv]) for k in range(findings)),
        adjusted=(Adjusted("link2 mass", 0.02, 0.05),),
        unexplained=Unexplained(0.04, False, None, None),
        bounds=(Bound("backlash", joints[0], "gap", 0.002, "rad"), Bound("payload", None, "mass", 0.03, "kg")),
        not_testable=(NotTestable("backlash", joints[-1], "the transmitted torque never changes sign"),),
        data_warnings=("first.csv: 12 repeated rows were dropped",),
        next_experiment=None,
        rollout=None,
        seconds=4.2,
        version="0.1.0",
        evidence=_evidence(nv, samples, unit == "N"),
        notes=("The band was chosen from the data.",),
        ledger=_ledger(joints, findings),
    )  # fmt: skip
