"""Answers and diagnoses written by hand, for the tests of what the scorer counts."""

from benchmarks.gapbench.scoring.judged import judged

PARAMETERS = {
    "viscous_friction": {"coefficient": 0.5},
    "coulomb_friction": {"torque": 0.2},
    "payload": {"mass": 0.5, "center_x": 0.0, "center_y": 0.0, "center_z": -0.2},
    "inertial_parameters": {"mass_factor": 1.5, "center_factor": 1.1, "inertia_factor": 1.2},
    "rotor_inertia": {"inertia": 0.02},
    "torque_constant": {"ratio": 0.8},
    "direction_dependent_friction": {
        "torque_positive": 0.3,
        "torque_negative": 0.1,
        "coefficient_positive": 0.0,
        "coefficient_negative": 0.0,
    },
}


JOINTS = {"pendulum": ["j1"], "planar2": ["j1", "j2"], "spatial3": ["j1", "j2", "j3"]}


def answer(effect=None, joint: str | None = "j1", *, robot="planar2", gap=6.0, parameters=None):
    effects = [{"effect": effect, "joint": joint, "parameters": parameters or PARAMETERS[effect]}] if effect else []
    kind = "single" if effect else "null"
    return {
        "id": "c1",
        "kind": kind,
        "robot": robot,
        "joints": JOINTS[robot],
        "effects": effects,
        "paired_gap": gap if effect else 0.0,
    }


def finding(effect, joint: str | None = "j1", *, closed=0.9, rivals=(), value=None, std=0.0):
    names = PARAMETERS.get(effect, {})
    parameters = {k: {"value": v if value is None else value, "std": std, "unit": ""} for k, v in names.items()}
    listed = [{"effects": [{"effect": e, "joint": j} for e, j in rival], "probability": 0.1} for rival in rivals]
    return {"effect": effect, "joint": joint, "gap_closed": closed, "parameters": parameters, "rivals": listed}


def entry(*findings, verdict=None, before=5.0, after=1.0):
    joint = {"joint": "j1", "rms_before": before, "rms_after": after, "noise_floor": 1.0}
    verdict = verdict or ("explained" if findings else "no_gap")
    return {"diagnosis": {"verdict": verdict, "findings": list(findings), "joints": [joint]}, "seconds": 2.0}


FAILED = {"diagnosis": None, "seconds": 1.0}


def claims_of(texts):
    pairs = [text.split(":") for text in texts]
    return [finding(e, j or None, closed=0.9 - 0.1 * i) for i, (e, j) in enumerate(pairs)]


def some_cases():
    right = judged(answer("viscous_friction", gap=6.0), entry(finding("viscous_friction")))
    missed = judged(answer("coulomb_friction", gap=1.0), entry())
    return [right, missed, judged(answer(), entry()), judged(answer(), entry(finding("payload", None)))]
