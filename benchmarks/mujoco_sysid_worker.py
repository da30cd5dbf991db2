# pyright: reportAttributeAccessIssue=false
"""Run MuJoCo's toolbox for system identification on its own arm of five joints, in the toolbox's environment.

Called by `compare_mujoco_sysid.py`: ``mujoco_sysid_worker.py FOLDER FIELD...`` writes ``arm.xml`` (the model to start
from), ``fit.npz`` and ``held_out.npz`` there, identifies armature, or armature and damping, of every joint, and prints
values, truth and seconds as JSON. Torques, length and optimiser are those of the toolbox's own test. So is the start of
the armatures if only these are identified.
"""

from __future__ import annotations

import ast
import functools
import json
import sys
import time
from pathlib import Path

import mujoco
import mujoco.sysid as sysid
import numpy as np
from mujoco import rollout

BOUNDS = {"armature": (0.001, 1.0), "damping": (0.0, 2.0)}
ARMATURE = 0.01
"""Start of the armatures, as in the toolbox's test."""

SHARE = 0.5
"""Share of the true values at which the identification of both starts."""

SECONDS = 2.0
NOISE = {"q": 2e-5, "v": 1e-3}  # noise of positions and velocities [rad, rad/s]
AMPLITUDES, HERTZ = (5.0, 4.0, 3.0, 2.0, 1.0), (0.5, 0.7, 0.4, 0.9, 0.6)


def own_arm() -> str:
    """The arm of the toolbox's test if the package has its tests, else an equal arm."""
    source = Path(sysid.__file__).parent / "tests" / "test_integration.py"
    if source.is_file():
        for node in ast.parse(source.read_text()).body:
            if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "ARM_XML":
                return ast.literal_eval(node.value)
    return equal_arm()


def equal_arm() -> str:
    """Five links with decreasing mass and armature, and axes z y y z y."""
    joints = zip(
        "zyyzy", (1.0, 0.8, 0.6, 0.4, 0.2), (0.1, 0.1, 0.1, 0.1, 0.08), (0.05, 0.05, 0.05, 0.04, 0.03), strict=True
    )
    axes = {"y": "0 1 0", "z": "0 0 1"}
    bodies = ends = motors = sensors = ""
    for k, (axis, mass, height, center) in enumerate(joints, start=1):
        bodies += (
            f'<body name="link{k}" pos="0 0 {height}"><inertial pos="0 0 {center}" mass="{mass}" '
            f'diaginertia="{0.01 * mass} {0.01 * mass} {0.005 * mass}"/><joint name="joint{k}" type="hinge" '
            f'axis="{axes[axis]}" armature="{0.6 - 0.1 * k}" damping="{mass}"/>'
        )
        ends += "</body>"
        motors += f'<motor name="act{k}" joint="joint{k}"/>'
        for kind in ("pos", "vel"):
            sensors += f'<joint{kind} name="joint{k}_{kind}" joint="joint{k}"/>'
    return (
        '<mujoco model="arm"><compiler angle="radian"/><option integrator="implicitfast" timestep="0.002">'
        f'<flag contact="disable"/></option><worldbody>{bodies}{ends}</worldbody><actuator>{motors}</actuator>'
        f"<sensor>{sensors}</sensor></mujoco>"
    )


def set_field(spec: mujoco.MjSpec, parameter: sysid.Parameter, joint: str, field: str) -> None:
    """In some versions damping is a polynomial in speed, whose first number is the coefficient."""
    value, old = float(parameter.value[0]), getattr(spec.joint(joint), field)
    setattr(spec.joint(joint), field, value if np.ndim(old) == 0 else [value, *old[1:]])


def parameters_of(truth: dict[str, float]) -> sysid.ParameterDict:
    """Armature and damping of every joint, with their start."""
    out = sysid.ParameterDict()
    for name, value in truth.items():
        field, joint = name.split(".")
        modifier = functools.partial(set_field, joint=joint, field=field)
        start = SHARE * value if any(name.startswith("damping") for name in truth) else ARMATURE
        out.add(sysid.Parameter(name, start, *BOUNDS[field], modifier=modifier))
    return out


def recorded(model: mujoco.MjModel, phase: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Torques of the toolbox's test with another phase, and the arm's exact and measured motion."""
    t = np.arange(int(SECONDS / model.opt.timestep)) * model.opt.timestep
    waves = zip(AMPLITUDES, HERTZ, 0.5 * np.arange(5) + phase, strict=True)
    tau = np.column_stack([size * np.sin(2 * np.pi * hz * t + at) for size, hz, at in waves])
    data = mujoco.MjData(model)
    start = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)
    states = np.asarray(rollout.rollout(model, data, start, tau)[0])[0]
    # The state after the step from t[k] is that at t[k + 1].
    whole = np.vstack([start.reshape(-1), states[:-1]])
    q, v = whole[:, 1 : 1 + model.nq], whole[:, 1 + model.nq :]
    noisy = {name: x + NOISE[name] * rng.standard_normal(x.shape) for name, x in (("q", q), ("v", v))}
    return {"t": t, "tau": tau, "exact_q": q, "exact_v": v, **noisy}


def identified(spec: mujoco.MjSpec, log: dict[str, np.ndarray], truth: dict[str, float]) -> dict[str, float]:
    """Values that the toolbox identifies, by parameter."""
    joints = [joint.name for joint in spec.joints]
    model = spec.compile()
    both = np.hstack([log["q"], log["v"]])
    names = [model.sensor(k).name for k in range(model.nsensor)]
    order = [joints.index(name[:-4]) + (5 if name.endswith("vel") else 0) for name in names]
    # The toolbox's rollout gives each step the sensors of the state before it and the time after it.
    measured = sysid.TimeSeries.from_names(log["t"][1:], both[:-1, order], model)
    control = sysid.TimeSeries(log["t"], log["tau"])
    start = sysid.create_initial_state(model, log["exact_q"][0], log["exact_v"][0], np.zeros(0))
    sequence = sysid.ModelSequences("arm", spec, "fit", start, control, measured)
    residual = sysid.build_residual_fn(models_sequences=[sequence], n_threads=1)
    found, _ = sysid.optimize(
        initial_params=parameters_of(truth), residual_fn=residual, optimizer="mujoco", verbose=False
    )
    return dict(zip(found.keys(), found.as_vector().tolist(), strict=True))


def main(name: str, *fields: str) -> None:
    folder, rng = Path(name), np.random.default_rng(7)
    spec = mujoco.MjSpec.from_string(own_arm())
    model = spec.compile()
    joints = [model.joint(k).name for k in range(model.njnt)]
    truth = {f"{f}.{j}": float(np.ravel(getattr(model.joint(j), f))[0]) for f in fields for j in joints}
    logs = [recorded(model, phase, rng) for phase in (0.0, 1.0)]
    for parameter in parameters_of(truth).values():
        set_field(spec, parameter, *reversed(parameter.name.split(".")))
    spec.compile()
    (folder / "arm.xml").write_text(spec.to_xml())
    for stem, log in zip(("fit", "held_out"), logs, strict=True):
        columns = {f"{kind}.{j}": log[kind][:, k] for kind in ("q", "v", "tau") for k, j in enumerate(joints)}
        np.savez(folder / f"{stem}.npz", allow_pickle=False, t=log["t"], **columns)
        np.savez(folder / f"{stem}_exact.npz", t=log["t"], q=log["exact_q"], v=log["exact_v"], tau=log["tau"])
    start = time.process_time()
    values = identified(spec, logs[0], truth)
    seconds = time.process_time() - start
    print(json.dumps({"values": values, "truth": truth, "seconds": seconds}))


if __name__ == "__main__":
    main(*sys.argv[1:])
