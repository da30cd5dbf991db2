# pyright: reportAttributeAccessIssue=false
"""Ranges for training in simulation. Oracles: closed forms, and the fields of MuJoCo's model of the drawn robots."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import yaml

from identification.diagnosis.result import Bound, Value
from identification.export.corrected.corrected_mjcf import corrected_mjcf
from identification.export.corrected.corrected_model import corrected_model
from identification.export.uses.randomisation import draws, randomisation_of, unseen_effect
from identification.export.uses.randomisation_file import mjcf_ranges, randomisation_text
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.loading import load_robot
from places import ROBOTS

UNSEEN = (
    Bound("viscous_friction", "elbow", "coefficient", 0.02, "N m s/rad"),
    Bound("torque_offset", "elbow", "torque", 0.05, "N m"),
    Bound("input_delay", None, "delay", 0.004, "s"),
    Bound("transmission_compliance", "elbow", "compliance", 0.001, "rad/(N m)"),
)


@pytest.fixture
def friction(made):
    """Coulomb and viscous friction of the elbow, anticorrelated."""
    shared = ((0.03, 0.0),), ((-0.008, 0.006),)
    return (
        made("coulomb_friction", "elbow", shared[0], torque=Value(0.5, 0.03, "N m")),
        made("viscous_friction", "elbow", shared[1], coefficient=Value(0.1, 0.01, "N m s/rad")),
    )


def test_draws_have_the_deviations_and_correlations_of_the_fit(planar, diagnosed, friction, rng):
    made = randomisation_of(diagnosed(*friction), planar)
    values = np.array([[effect.theta[0] for effect in robot] for robot in draws(made, 4000, rng, unseen=0)])
    np.testing.assert_allclose(values.mean(axis=0), [0.5, 0.1], atol=0.003)
    np.testing.assert_allclose(values.std(axis=0), [0.03, 0.01], rtol=0.05)
    assert np.corrcoef(values.T)[0, 1] == pytest.approx(-0.8, abs=0.03)


def test_findings_that_do_not_say_what_they_share_are_drawn_apart(planar, diagnosed, friction):
    made = randomisation_of(diagnosed(*(replace(f, loadings=()) for f in friction)), planar)
    np.testing.assert_allclose(made.correlation, np.eye(2))
    np.testing.assert_allclose(made.std, [0.03, 0.01])


def test_draws_stay_within_the_bounds_of_a_parameter(planar, diagnosed, made, rng):
    delay = made("input_delay", None, delay=Value(0.001, 0.01, "s"))
    found = draws(randomisation_of(diagnosed(delay), planar), 200, rng)
    assert min(effect.theta[0] for robot in found for effect in robot) == 0.0


def test_an_unseen_effect_is_no_larger_than_what_would_have_been_seen(planar, diagnosed, friction, rng):
    made = randomisation_of(diagnosed(*friction, bounds=UNSEEN), planar)
    extra = [robot[2:] for robot in draws(made, 300, rng)]
    assert {len(effects) for effects in extra} == {1}
    offsets = [effect.theta[0] for (effect,) in extra if effect.effect == "torque_offset"]
    assert -0.05 < min(offsets) < 0 < max(offsets) < 0.05
    stiffness = [effect.theta[0] for (effect,) in extra if effect.effect == "transmission_compliance"]
    assert min(stiffness) > 1000.0


def test_a_bound_that_says_too_little_makes_no_effect(planar, diagnosed):
    bound = Bound("stribeck_friction", "elbow", "static_torque", 0.1, "N m")
    assert unseen_effect(randomisation_of(diagnosed(), planar), bound, 1.0) is None


def test_fields_have_the_ranges_of_drawn_robots(planar, diagnosed, made, friction, rng):
    payload = made(
        "payload", None, mass=Value(0.5, 0.02, "kg"), center_x=Value(0.02, 0.001, "m"),
        center_y=Value(0.0, 0.001, "m"), center_z=Value(-0.4, 0.005, "m"),
    )  # fmt: skip
    found = randomisation_of(diagnosed(*friction, payload), planar)
    models = [
        mujoco.MjModel.from_xml_string(corrected_mjcf(corrected_model(planar, robot)))
        for robot in draws(found, 300, rng, unseen=0)
    ]
    ranges = {(f.name, f.attribute): f for f in mjcf_ranges(found)[0]}
    for field, values in (
        (("elbow", "frictionloss"), [model.dof_frictionloss[1] for model in models]),
        (("elbow", "damping"), [model.dof_damping[1] for model in models]),
        (("lower", "mass"), [model.body_mass[2] for model in models]),
    ):
        half = 0.5 * (ranges[field].found[1] - ranges[field].found[0])
        assert half == pytest.approx(2 * np.std(values), rel=0.15)
        assert ranges[field].value == pytest.approx(np.mean(values), rel=0.02)


def test_what_was_not_seen_widens_its_field(planar, diagnosed, friction):
    ranges = mjcf_ranges(randomisation_of(diagnosed(*friction, bounds=UNSEEN), planar))[0]
    damping = next(f for f in ranges if (f.name, f.attribute) == ("elbow", "damping"))
    assert damping.unseen == (pytest.approx(0.2), pytest.approx(0.22))
    delay = next(f for f in ranges if (f.name, f.attribute) == ("elbow_motor", "delay"))
    assert delay.unseen == (0.0, pytest.approx(0.004))


def test_the_file_says_delays_in_control_steps(planar, diagnosed, made):
    delay = made("input_delay", None, delay=Value(0.01, 0.001, "s"))
    content = yaml.safe_load(randomisation_text(randomisation_of(diagnosed(delay, bounds=UNSEEN[:2]), planar)))
    assert content["schema"] == "phantom-dyn-randomisation/2"
    assert content["control_step"] == 0.005
    (entry,) = content["found"]
    assert entry["range"] == [pytest.approx(0.008), pytest.approx(0.012)]
    assert entry["control_steps"] == [pytest.approx(1.6), pytest.approx(2.4)]
    assert [e["range"] for e in content["unseen"]] == [[0.0, 0.02], [-0.05, 0.05]]


def test_without_findings_and_bounds_the_file_is_empty_but_valid(planar, diagnosed):
    content = yaml.safe_load(randomisation_text(randomisation_of(diagnosed(), planar)))
    assert (content["found"], content["unseen"], content["mjcf"]) == ([], [], [])


def test_a_finding_of_one_recording_only_is_no_part_of_the_robot(planar, diagnosed, friction):
    own = replace(friction[0], recording="second.csv")
    assert randomisation_of(diagnosed(own, friction[1]), planar).findings == (friction[1],)


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), float("inf")])
def test_a_control_step_that_is_none_is_refused(planar, diagnosed, step):
    with pytest.raises(ParameterError, match=r"The control step is .* s, wanted a time above zero"):
        randomisation_of(diagnosed(), planar, control_step=step)


def test_fewer_than_no_draws_are_refused(planar, diagnosed, rng):
    with pytest.raises(ParameterError, match="-1 draws with 1 unseen effects were asked for: give numbers from 0 on"):
        draws(randomisation_of(diagnosed(), planar), -1, rng)


def test_an_unseen_payload_sits_where_its_bound_was_asked_for(planar, diagnosed):
    # At the joint's origin it would not swing at all, and would have been seen only where it is much heavier.
    bound = Bound("payload", None, "mass", 0.2, "kg")
    effect = unseen_effect(randomisation_of(diagnosed(bounds=(bound,)), planar), bound, 0.5)
    assert effect is not None
    np.testing.assert_allclose(effect.theta, [0.1, *planar.model.inertias[2].lever])


def test_an_unseen_spring_rests_at_the_mean_recorded_position(planar, diagnosed):
    bound, made = Bound("parasitic_spring", "elbow", "stiffness", 2.0, "N m/rad"), diagnosed()
    effect = unseen_effect(randomisation_of(made, planar), bound, 1.0)
    assert effect is not None
    assert effect.theta == (2.0, pytest.approx(np.mean(made.evidence.q[:, 1])))


def test_every_field_is_a_number_of_an_element_of_the_corrected_file(planar, diagnosed, friction):
    found = randomisation_of(diagnosed(*friction, bounds=UNSEEN), planar)
    root = ElementTree.fromstring(corrected_mjcf(corrected_model(planar, found.found)))
    names = {e.get("name") for e in root.iter()}
    assert {f.name for f in mjcf_ranges(found)[0]} <= names


@pytest.mark.parametrize("name", ["1e400", "nan"])
def test_the_name_of_a_robot_is_no_number_to_draw(tmp_path, diagnosed, friction, name):
    path = tmp_path / "robot.urdf"
    path.write_text((ROBOTS / "planar2.urdf").read_text().replace('<robot name="planar2">', f'<robot name="{name}">'))
    ranges = mjcf_ranges(randomisation_of(diagnosed(*friction), load_robot(path)))[0]
    assert {field.element for field in ranges} == {"joint"}


def test_a_spring_without_an_element_is_told_instead_of_a_range_that_ends_at_no_stiffness(planar, diagnosed):
    content = yaml.safe_load(randomisation_text(randomisation_of(diagnosed(bounds=UNSEEN), planar)))
    assert content["mjcf_note"].endswith("see unseen: transmission_compliance on elbow.")


def test_a_field_says_what_mujoco_needs_beside_it(planar, diagnosed):
    found = randomisation_of(diagnosed(bounds=UNSEEN), planar)
    root = ElementTree.fromstring(corrected_mjcf(corrected_model(planar, ())))
    motor = next(e for e in root.iter("motor") if e.get("name") == "elbow_motor")
    bias = next(f for f in mjcf_ranges(found)[0] if f.attribute == "biasprm")
    motor.tag = bias.needs["element"]
    for key, text in bias.needs.items():
        if key != "element":
            motor.set(key, text)
    motor.set("biasprm", repr(bias.unseen[1]))
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator, [0.0, 0.05])
