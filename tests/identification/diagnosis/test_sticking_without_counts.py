# pyright: reportAttributeAccessIssue=false
"""Recordings of a simulator hold floats: no encoder count says where a joint sticks. Oracle: MuJoCo, a known truth."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from identification.data.reading import read_recording
from identification.pipeline import diagnose
from phantom_dyn.model.loading import load_robot

pytestmark = pytest.mark.whole

ARM = """<mujoco model="arm">
  <option timestep="0.0002" integrator="implicitfast"><flag contact="disable"/></option>
  <default>
    <joint type="hinge" axis="0 1 0" damping="0.5" frictionloss="0.2" armature="0.05"/>
    <geom type="capsule" size="0.04" density="1500"/>
  </default>
  <worldbody>
    <body name="base" pos="0 0 0.2"><joint name="pan" axis="0 0 1"/><geom fromto="0 0 0 0 0 0.2"/>
      <body name="upper" pos="0 0 0.2"><joint name="lift"/><geom fromto="0 0 0 0.3 0 0"/>
        <body name="lower" pos="0.3 0 0"><joint name="elbow"/><geom fromto="0 0 0 0.25 0 0" size="0.03"/></body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="pan"/><motor joint="lift"/><motor joint="elbow"/></actuator>
</mujoco>"""
JOINTS = ("pan", "lift", "elbow")


def test_a_model_that_sticks_at_reversals_fits_itself(tmp_path):
    # Known truth: nothing is wrong. At every reversal a joint sticks for some 30 ms and friction holds anything.
    (tmp_path / "arm.xml").write_text(ARM)
    model = mujoco.MjModel.from_xml_string(ARM)
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    t = np.arange(0.0, 20.0, 1e-3)
    waves = [(k, phase) for k in range(1, 6) for phase in rng.uniform(0.0, 2 * np.pi, (1, 3))]
    ref = sum(np.sin(0.2 * np.pi * k * t[:, None] + phase) / np.sqrt(k) for k, phase in waves)
    ref *= np.array([0.55, 0.32, 0.45]) * np.minimum(1.0, t / 2.0)[:, None]
    speed = np.gradient(ref, 1e-3, axis=0)
    q, tau = np.zeros_like(ref), np.zeros_like(ref)
    for k in range(len(t)):
        q[k] = data.qpos
        tau[k] = [400, 400, 200] * (ref[k] - data.qpos) + [20, 20, 8] * (speed[k] - data.qvel)
        data.ctrl[:] = tau[k]
        mujoco.mj_step(model, data, nstep=5)
    q, tau = q + 1e-5 * rng.normal(size=q.shape), tau + 0.01 * rng.normal(size=q.shape)
    columns = {f"{name}.{j}": x[:, k] for name, x in (("q", q), ("tau", tau)) for k, j in enumerate(JOINTS)}
    np.savez(tmp_path / "log.npz", allow_pickle=False, t=t, **columns)
    robot = load_robot(tmp_path / "arm.xml")
    found = diagnose(robot, (read_recording(tmp_path / "log.npz", robot),))
    assert (found.verdict, found.findings) == ("no_gap", ())
