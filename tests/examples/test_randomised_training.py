# pyright: reportAttributeAccessIssue=false
"""Randomised models. Oracles: the ranges themselves, MuJoCo's arrays, and the inertia of a body by hand."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import mujoco
import numpy as np
import pytest

from examples.randomised_training import batch, randomise, wrapped

MODEL = """<mujoco><compiler angle="radian"/><worldbody><body name="a"><joint name="j" axis="0 1 0" damping="0.4"/>
<inertial pos="0 0 -0.1" mass="1" fullinertia="0.02 0.03 0.02 0.001 0 0"/></body></worldbody>
<actuator><motor name="mine" joint="j" gear="2"/></actuator></mujoco>"""


def entry(element: str, name: str, attribute: str, found, unseen=None, index: int = 0) -> dict:
    whole = {"element": element, "name": name, "attribute": attribute, "index": index, "range": list(found)}
    return whole | {"unseen_range": list(unseen or found)}


RANGES = [
    entry("inertial", "a", "mass", (1.5, 1.6)),
    entry("joint", "j", "damping", (0.5, 0.6), (0.5, 3.0)),
    entry("motor", "j_motor", "gear", (1.8, 1.9)),
    entry("motor", "j_motor", "delay", (0.01, 0.02)),
]


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_string(MODEL)


def test_numbers_lie_in_their_ranges_and_the_actuator_is_that_of_the_joint(model, rng):
    skipped = randomise(model, RANGES, rng)
    assert 1.5 <= model.body("a").mass[0] <= 1.6
    assert 0.5 <= model.dof_damping[0] <= 0.6
    assert 1.8 <= model.actuator_gear[0, 0] <= 1.9
    assert skipped == ("j_motor delay",)


def test_only_a_widened_draw_leaves_what_was_found(model, rng):
    found, wide = [], []
    for _ in range(100):
        randomise(model, RANGES, rng)
        found.append(model.dof_damping[0])
        randomise(model, RANGES, rng, width="widened")
        wide.append(model.dof_damping[0])
    assert max(found) <= 0.6
    assert 10 < np.sum(np.array(wide) > 0.6) < 60


def test_an_entry_of_the_inertia_is_set_in_the_axes_of_the_body(model, rng):
    randomise(model, [entry("inertial", "a", "fullinertia", (0.05, 0.05), index=1)], rng)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body("a").iquat)
    turn = turn.reshape(3, 3)
    found = turn @ np.diag(model.body("a").inertia) @ turn.T
    np.testing.assert_allclose(found, [[0.02, 0.001, 0], [0.001, 0.05, 0], [0, 0, 0.02]], atol=1e-12)


def test_a_tendon_of_the_number_of_the_joint_keeps_its_actuator(rng):
    tendon = """<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>
    <actuator><motor name="other" tendon="t" gear="7"/></actuator><actuator>"""
    model = mujoco.MjModel.from_xml_string(MODEL.replace("<actuator>", tendon))
    randomise(model, RANGES, rng)
    assert model.actuator("other").gear[0] == 7
    assert 1.8 <= model.actuator("mine").gear[0] <= 1.9


def test_a_batch_holds_what_follows_from_a_mass(model):
    # By hand: the tree weighs what its only body weighs, and of a mass that only itself moves the inverse is less.
    fields = batch(model, RANGES[:1], 4, seed=1)
    np.testing.assert_allclose(fields["body_subtreemass"][:, 1], fields["body_mass"][:, 1])
    order = np.argsort(fields["body_mass"][:, 1])
    assert (np.diff(fields["dof_invweight0"][order, 0]) < 0).all()


def test_a_batch_holds_what_moves_and_leaves_the_model_as_it_was(model):
    found = batch(model, RANGES, 8, 0)
    of_mass = {"body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0"}
    assert set(found) == {"body_mass", "dof_damping", "actuator_gear", *of_mass}
    assert found["dof_damping"].shape == (8, 1)
    assert np.ptp(found["dof_damping"]) > 0
    assert model.dof_damping[0] == 0.4


class _Wrapper:
    def __init__(self, env):
        self.env = env


class _Env:
    def __init__(self, model):
        self.model, self.unwrapped, self.seen = model, SimpleNamespace(model=model), []

    def reset(self, **options):
        self.seen.append(float(self.model.dof_damping[0]))
        return options


def test_an_environment_is_drawn_anew_at_every_reset(model, monkeypatch):
    gymnasium = ModuleType("gymnasium")
    gymnasium.Wrapper = _Wrapper
    monkeypatch.setitem(sys.modules, "gymnasium", gymnasium)
    env = _Env(model)
    own = wrapped(env, RANGES)
    assert own.reset(seed=3) == {"seed": 3}
    own.reset()
    assert all(0.5 <= value <= 0.6 for value in env.seen)
    assert env.seen[0] != env.seen[1]
