"""The table of relations between effects: which columns make those of which other effect."""

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.relations import RELATIONS, related
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS
from sines import sines

JOINT = "tilt"


# Largest part of a column that may be left where another effect makes it.
LEFT = 0.01


# Shapes at which an effect comes to a simpler one: no displacement of a bristle; five places over the travel.
AT = {"presliding_friction": (1e-9,), "position_dependent_friction": (-0.7, 0.7, 5.0)}


ON_ONE_JOINT = [effect for effect in EFFECTS if effect.scope == "joint" and effect.inertial is None]


def columns(effect: Effect, arm: Robot, motion: Operation, at: dict[str, tuple[float, ...]]) -> np.ndarray:
    """Columns on the joint itself while it moves; where nothing asks for an effect of lists, none."""
    shapes = (at[effect.name],) if effect.name in at else effect.shapes(arm, motion, JOINT)
    if not shapes:
        return np.zeros((len(motion.t), 0))
    signature = effect.signature(arm, motion, JOINT, shapes[0])
    # At the first sample and where it turns about, a bristle of no displacement is late by a sample.
    moving = np.abs(motion.v[:, 1]) > 0.05
    moving[0] = False
    return signature.columns[moving, signature.rows.index(1)]


def left_of(column: np.ndarray, by: np.ndarray) -> float:
    """Share of a column's length that is outside the span of others."""
    inside = by @ np.linalg.lstsq(by, column, rcond=None)[0]
    return float(np.linalg.norm(column - inside) / np.linalg.norm(column))


def made_by(rich: Effect, simple: Effect, arm: Robot, motion: Operation) -> bool:
    """True if the columns of one effect make all those of another."""
    own, other = columns(rich, arm, motion, AT), columns(simple, arm, motion, {})
    other = other[:, np.abs(other).max(axis=0) > 0]
    if not own.size or not other.size:
        return False
    return all(left_of(column, own) < LEFT for column in other.T)


def test_rows_are_of_two_effects_of_the_catalogue_each_once():
    known = {effect.name for effect in EFFECTS}
    assert all(row.effect != row.other for row in RELATIONS)
    assert {name for row in RELATIONS for name in (row.effect, row.other)} <= known
    assert len(set(RELATIONS)) == len(RELATIONS)


@pytest.mark.parametrize("rich", ON_ONE_JOINT, ids=lambda effect: effect.name)
def test_what_the_columns_of_an_effect_make_is_in_the_table(arm, wide, rich):
    warm = replace(wide, temperature=30.0 + np.outer(wide.t**1.5, np.ones(3)) / 9.0)
    made = {one.name for one in ON_ONE_JOINT if one is not rich and made_by(rich, one, arm, warm)}
    assert made == {*related(rich.name, "contains"), *related(rich.name, "tends to")}


@pytest.mark.parametrize(
    "row", [row for row in RELATIONS if row.kind == "contains" and row.other == "payload"], ids=lambda row: row.effect
)
def test_a_load_is_a_change_of_the_link_that_carries_it(arm, row):
    rich, load = effect_named(row.effect), effect_named(row.other)
    last = arm.joint_names[-1]
    assert set(load.regressor_columns(arm, None)) <= set(rich.regressor_columns(arm, last))


def test_a_coupling_resembles_what_its_columns_are_where_the_second_joint_is_still(arm, smooth):
    # Closed form: with v_j = 0 the coupled speed is that of the first joint.
    still = np.array([1.0, 0.0, 1.0])
    held = Operation.of(arm, Motion(smooth.t, smooth.q, smooth.v * still, smooth.a * still))
    coupling = effect_named("joint_coupling")
    own = coupling.signature(arm, held, "turn+tilt", (1.0,)).columns[:, 0]
    for name in coupling.on_each_joint:
        (column,) = effect_named(name).signature(arm, held, "turn", ()).columns[:, 0].T
        assert left_of(column, own) < LEFT


def test_an_effect_that_may_be_a_sum_makes_the_columns_of_all_its_parts(arm, smooth):
    for rich in {row.effect for row in RELATIONS if row.kind == "may be a sum with"}:
        parts = [effect_named(name) for name in effect_named(rich).same_as_sum]
        assert len(parts) > 1
        assert all(made_by(effect_named(rich), part, arm, smooth) for part in parts)


def test_a_torque_constant_resembles_the_sum_of_its_parts_on_a_pendulum():
    # Closed form: a load changes weight and inertia, friction the rest of what the drive works against.
    pendulum = load_robot(ROBOTS / "pendulum.urdf")
    motion = sines(np.arange(1000) / 100, 1, np.random.default_rng(1))
    operation = Operation.of(pendulum, motion)
    parts = effect_named("torque_constant").sum_parts
    own = rigid_body_regressor(pendulum, motion)[:, 0, effect_named("payload").regressor_columns(pendulum, None)]
    friction = [effect_named(name).signature(pendulum, operation, "pin", ()) for name in parts if name != "payload"]
    made = np.column_stack([own, *(signature.columns[:, 0] for signature in friction)])
    assert {"payload", "coulomb_friction", "viscous_friction"} == set(parts)
    assert left_of(operation.expected[:, 0], made) < LEFT


@pytest.mark.parametrize("row", [row for row in RELATIONS if row.kind == "same shapes as"], ids=lambda row: row.effect)
def test_laws_of_the_same_shapes_are_one_under_a_constant_load(row, arm):
    # Oracle: the columns. A mass that slides slowly in a fixed direction is a constant load.
    q = np.zeros((200, 3))
    q[:, 1], q[:, 2] = 0.6, np.linspace(0.0, 0.3, 200)
    slow = Operation.of(arm, Motion(np.arange(200) / 100.0, q, 0 * q, 0 * q))
    assert np.ptp(slow.transmitted[:, 2]) < 1e-9 < np.abs(slow.transmitted[0, 2])
    own, other = (effect_named(name).signature(arm, slow, "slide", (40.0,)) for name in (row.effect, row.other))
    assert all(left_of(column, own.columns[:, 0]) < LEFT for column in other.columns[:, 0].T)
