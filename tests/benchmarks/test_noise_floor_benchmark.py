"""Oracle: by hand."""

import json

from benchmarks.noise_floor import repeated


def test_noise_over_torque_is_printed_of_joints_whose_motions_are_repeated(tmp_path):
    joint = {"noise_floor": 0.03, "rms_torque": 2.0, "noise_floor_source": "repetitions"}
    joints = [{"joint": "hip", **joint}, {"joint": "knee", **joint, "noise_floor_source": "sensors"}]
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps({"joints": joints}))
    assert repeated(file) == [f"{file} hip 1.5 %"]
