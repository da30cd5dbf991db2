"""What counts as one answer because no data, or not this recording, can part it."""

from __future__ import annotations

import pytest
from scored_by_hand import PARAMETERS, answer, claims_of, entry, finding

from benchmarks.gapbench.scoring.judged import judged

TWINS = [
    ("payload", None, "pendulum", ["inertial_parameters:j1"]),
    ("inertial_parameters", "j1", "pendulum", ["payload:", "rotor_inertia:j1"]),
    ("rotor_inertia", "j1", "pendulum", ["inertial_parameters:j1"]),
    ("rotor_inertia", "j1", "planar2", ["inertial_parameters:j1"]),
    ("rotor_inertia", "j2", "spatial3", ["inertial_parameters:j2"]),
    ("torque_constant", "j1", "pendulum", ["inertial_parameters:j1", "viscous_friction:j1"]),
    ("direction_dependent_friction", "j2", "planar2", ["coulomb_friction:j2", "torque_offset:j2"]),
]


@pytest.mark.parametrize(("effect", "joint", "robot", "said"), TWINS)
def test_a_twin_is_right_as_a_class_and_not_strictly(effect, joint, robot, said):
    x = judged(answer(effect, joint, robot=robot), entry(*claims_of(said)))
    assert (x.top1_strict, x.top1, x.exact, x.in_set) == (False, True, True, True)


NO_TWINS = [
    ("payload", None, "planar2", ["inertial_parameters:j2"]),
    ("rotor_inertia", "j2", "planar2", ["inertial_parameters:j2"]),
    ("rotor_inertia", "j3", "spatial3", ["inertial_parameters:j3"]),
    ("torque_constant", "j2", "planar2", ["inertial_parameters:j2"]),
    ("direction_dependent_friction", "j1", "planar2", ["coulomb_friction:j1"]),
    ("coulomb_friction", "j1", "pendulum", ["viscous_friction:j1"]),
]


@pytest.mark.parametrize(("effect", "joint", "robot", "said"), NO_TWINS)
def test_what_the_data_can_part_is_no_twin(effect, joint, robot, said):
    assert not judged(answer(effect, joint, robot=robot), entry(*claims_of(said))).top1


def test_direction_dependent_viscous_parts_have_no_twin():
    parameters = PARAMETERS["direction_dependent_friction"] | {"coefficient_positive": 0.3}
    truth = answer("direction_dependent_friction", parameters=parameters)
    assert not judged(truth, entry(*claims_of(["coulomb_friction:j1", "torque_offset:j1"]))).top1


def test_what_the_recording_cannot_part_is_right_and_no_twin_of_the_robot():
    truth = answer("inertial_parameters", "j2") | {"alike": [{"effect": "payload", "joint": None, "leaves": 0.02}]}
    x = judged(truth, entry(finding("payload", None)))
    assert (x.top1_strict, x.top1, x.in_set) == (False, True, True)
