"""What a controller had taken out of the torques is put back. Oracle: known truth, and the closed form of friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.drives.compensation import before_low_pass, put_back_sentences
from identification.data.reading import recording
from identification.data.recording import Recording, Table
from identification.data.signals import process
from phantom_dyn.errors import LogError
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


@pytest.mark.parametrize(("low_pass", "taken"), [({"": 5.0}, (5.0, 5.0)), ({"": 5.0, "elbow": 20.0}, (5.0, 20.0))])
def test_a_low_pass_is_taken_back(planar, low_pass, taken):
    # Closed form: of a sine a low pass of first order leaves 1 / sqrt(1 + (w T)^2), late by atan(w T).
    t, w = np.arange(5000) / 500.0, 7.0
    turns = w / (2 * np.pi * np.array(taken))
    behind = np.sin(w * t[:, None] - np.arctan(turns)) / np.sqrt(1 + turns**2)
    found, said = before_low_pass(replace(table(planar, {}), columns={"t": t}, low_pass=low_pass), planar, behind)
    np.testing.assert_allclose(found, np.sin(w * t)[:, None] * np.ones(2), atol=1e-4)
    assert f"the low pass at {taken[0]:g} Hz of shoulder, {taken[1]:g} Hz of elbow was taken back" in said[0]


def test_a_low_pass_of_a_joint_that_the_robot_lacks_is_refused(planar):
    with pytest.raises(LogError, match=r"tau\.wrist went through a low pass, a joint that .* does not have"):
        recording(replace(table(planar, {}), low_pass={"wrist": 20.0}), planar)


def test_a_recording_has_its_torque_as_it_was_before_the_low_pass(planar):
    # Closed form: a ramp comes out of a low pass late by its time constant.
    found = recording(replace(table(planar, {}), low_pass={"elbow": 1 / (2 * np.pi * 0.03)}), planar)
    np.testing.assert_allclose(found.tau - 0.1 - found.t[:, None], [[0.0, 0.03]] * 60, atol=1e-9)
