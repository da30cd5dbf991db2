"""Tests that step MuJoCo leave no log of its warnings in the working folder."""

from pathlib import Path

import mujoco
import numpy as np

SLIDER = """<mujoco><worldbody><body><joint type="slide"/><geom size="0.1"/></body></worldbody></mujoco>"""


def test_a_simulation_that_runs_away_writes_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_string(SLIDER)
    data = mujoco.MjData(model)
    data.qpos[:] = np.nan
    mujoco.mj_step(model, data)
    # MuJoCo has warned.
    assert data.warning[mujoco.mjtWarning.mjWARN_BADQPOS].number > 0
    assert not Path("MUJOCO_LOG.TXT").exists()
