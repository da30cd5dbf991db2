"""The figure of each effect. Oracle: the law by hand."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from places import CHECKOUT


@pytest.fixture(scope="module")
def figures():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(CHECKOUT / "docs")
        yield importlib.import_module("effect_figures")


@pytest.fixture(scope="module")
def operation(figures):
    return figures.swung(figures.smooth_arm())


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_every_effect_leaves_something_in_its_figure(figures, operation, effect):
    left, _ = figures.left_by(effect, operation)
    assert np.isfinite(left).all()
    assert np.ptp(left) > 1e-4 or np.abs(left).min() > 1e-4


def test_viscous_friction_is_a_line_over_velocity(figures, operation):
    panel = figures.effect_figure(effect_named("viscous_friction"), operation).axes[0]
    v, torque = panel.lines[0].get_data()
    np.testing.assert_allclose(torque, 0.2 * v, atol=1e-12)


def test_a_payload_needs_the_torque_of_its_weight_and_inertia(figures, operation):
    # By hand, m = 0.4 kg at l = 0.2 m from the level axis of the elbow: m l (l a - g cos q), down is positive.
    left, _ = figures.left_by(effect_named("payload"), operation)
    row = operation.robot.joint_names.index("elbow")
    wanted = 0.4 * 0.2 * (0.2 * operation.a[:, row] - 9.81 * np.cos(operation.q[:, row]))
    np.testing.assert_allclose(left, wanted, rtol=1e-9, atol=1e-9)


def test_the_time_in_which_springs_settle_is_not_drawn(figures, operation):
    t = figures.effect_figure(effect_named("cogging"), operation).axes[2].lines[0].get_xdata()
    assert t[0] >= 0 > operation.t[0]


def test_sizes_are_named_with_their_units(figures):
    assert figures.shown_sizes(effect_named("presliding_friction")) == "torque 0.5 N m; displacement 0.05 rad"
