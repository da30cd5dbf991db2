"""Near twins in the search. Oracle: the table of relations, and the laws of friction that hold more than one number."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.search.claims import _made_beside_twins
from identification.diagnosis.search.containment import are_near_twins
from identification.diagnosis.search.swaps import alternatives
from identification.scenarios.motion_only import motion_robot, with_commanded_torque
from phantom_dyn import load_robot
from phantom_dyn.model.robot import Actuator, Controller
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import simulate
from places import ROBOTS


@pytest.fixture(scope="module")
def servo(lab):
    """A rod that a position servo swings, known by its references alone."""
    robot = replace(load_robot(ROBOTS / "pendulum.urdf"), actuators=(Actuator(controller=Controller(kp=60.0, kd=6.0)),))
    t = np.arange(2400) / 200.0
    q_ref = (0.4 * np.sin(1.7 * t) + 0.2 * np.sin(4.3 * t))[:, None]
    law = position_control(t, q_ref, np.zeros_like(q_ref), kp=np.array([60.0]), kd=np.array([6.0]))
    q = simulate(robot, (), law, t, np.zeros(1)).q + 1e-5 * np.random.default_rng(1).standard_normal(q_ref.shape)
    recording = with_commanded_torque(Recording("s.csv", robot.joint_names, t, q, None, q_ref=q_ref), robot)
    return lab.prepared(motion_robot(robot), (recording,))


def test_a_late_reference_and_viscous_friction_are_near_twins(servo):
    late, viscous, dry = (servo.term(n, "pin") for n in ("reference_delay", "viscous_friction", "coulomb_friction"))
    assert are_near_twins(late, viscous)
    assert are_near_twins(viscous, late)
    assert not are_near_twins(late, dry)


@pytest.mark.parametrize(("effect", "twin"), [("reference_delay", "viscous_friction"),
                                              ("viscous_friction", "reference_delay")])  # fmt: skip
def test_a_near_twin_may_stand_beside_what_a_richer_law_has(servo, effect, twin):
    # Direction-dependent friction holds Coulomb and viscous friction: a twin alone would be compared with both.
    groups = {
        frozenset(one.effect.name for one in group) for group in alternatives(servo.search, servo.term(effect, "pin"))
    }
    assert {twin} in groups
    assert {twin, "coulomb_friction"} in groups
    assert {effect, twin} in groups


def test_other_effects_have_no_near_twin_beside_them(servo):
    groups = alternatives(servo.search, servo.term("torque_offset", "pin"))
    assert not any({"reference_delay", "coulomb_friction"} <= {one.effect.name for one in group} for group in groups)


def test_beside_its_twin_an_effect_is_measured_by_the_torque_that_it_makes(servo):
    # Closed form: the squares of a column times its coefficient.
    late, viscous, dry = (servo.term(n, "pin") for n in ("reference_delay", "viscous_friction", "coulomb_friction"))
    rich = servo.search.evaluate(frozenset([late, viscous]))
    (column,) = viscous.columns
    made = rich.theta[column] ** 2 * rich.problem.total_a[column, column]
    assert _made_beside_twins(frozenset([viscous]), frozenset([late]), rich) == pytest.approx(made)
    assert _made_beside_twins(frozenset([viscous]), frozenset([dry]), rich) == 0.0
