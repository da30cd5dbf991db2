"""What a controller had taken out of the torques is put back. Oracle: known truth, and the closed form of friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.compensation import put_back_sentences
from identification.data.reading import recording
from identification.data.recording import Recording, Table
from identification.data.signals import process
from phantom_dyn.model.robot import Robot


@pytest.fixture
def swung(planar: Robot) -> Recording:
    """Ten seconds of two sines, with a torque that is a sine too."""
    t = np.arange(5000) / 500.0
    q = np.column_stack([0.6 * np.sin(2 * t), 0.4 * np.cos(3 * t)])
    return Recording("a.csv", planar.joint_names, t, q, np.column_stack([np.cos(t), np.sin(t)]))


@pytest.mark.parametrize("joints", [("shoulder", "elbow"), ("elbow",)])
def test_friction_is_put_back_with_the_velocities_of_the_log(planar, swung, joints):
    # Closed form: c v + T sign(v), with the log's own velocities.
    rubbing = replace(planar, viscous_friction=np.array([0.2, 0.1]), coulomb_friction=np.array([0.5, 0.3]))
    plain, put_back = (process(replace(swung, friction_taken=names), rubbing) for names in ((), joints))
    v = plain.motion.v
    wanted = (v * [0.2, 0.1] + np.sign(v) * [0.5, 0.3]) * np.isin(planar.joint_names, joints)
    np.testing.assert_allclose(put_back.tau - plain.tau, wanted, atol=1e-12)


def table(planar: Robot, compensated: dict[str, tuple[str, ...]]) -> Table:
    t = np.arange(60) / 100.0
    columns = {f"{x}.{joint}": 0.1 + t for x in ("q", "tau") for joint in planar.joint_names}
    return Table("a.csv", {"t": t, **columns}, (), compensated)


@pytest.mark.parametrize(
    ("compensated", "joints"),
    [
        ({"": ("friction",)}, ("shoulder", "elbow")),
        ({"elbow": ("gravity", "friction")}, ("elbow",)),
        ({"": ("gravity",), "shoulder": ("friction",)}, ("shoulder",)),
        ({"": ("gravity",)}, ()),
    ],
)
def test_a_recording_knows_from_which_torques_friction_was_taken(planar, compensated, joints):
    assert recording(table(planar, compensated), planar).friction_taken == joints


def test_what_is_put_back_is_said(planar):
    rubbing = replace(planar, viscous_friction=np.zeros(2), coulomb_friction=np.array([0.5, 0.0]))
    (sentence,) = put_back_sentences(table(planar, {"": ("friction",)}), rubbing)
    assert "the model's friction was put back into the torque of shoulder, from which a controller" in sentence


def test_a_model_without_friction_has_nothing_to_put_back(planar):
    bare = replace(planar, viscous_friction=np.zeros(2), coulomb_friction=np.zeros(2))
    (sentence,) = put_back_sentences(table(planar, {"": ("friction",)}), bare)
    assert "states none of shoulder, elbow: nothing was put back" in sentence
