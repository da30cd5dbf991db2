"""A name in ``randomisation.yaml`` has one meaning. Oracles: closed forms, and the robots that are drawn."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from identification.diagnosis.result import Bound, Value
from identification.export.uses.randomisation import draws, randomisation_of, unseen_effect
from identification.export.uses.randomisation_file import randomisation_text
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


@pytest.fixture
def content(planar, diagnosed):
    """What the file says of some findings and bounds."""

    def read(*findings, bounds: tuple[Bound, ...] = ()) -> dict:
        return yaml.safe_load(randomisation_text(randomisation_of(diagnosed(*findings, bounds=bounds), planar)))

    return read


@pytest.fixture
def motion(planar, some) -> Motion:
    return some(planar)


def bound_of(effect: Effect, robot: Robot, motion: Motion, size: float) -> Bound:
    """What a diagnosis says of an effect that it has not seen."""
    joint = effect.places(robot)[-1]
    operation = Operation.of(robot, motion, temperature=np.full(motion.q.shape, 30.0))
    name, _ = effect.probe(robot, operation, joint)
    return Bound(effect.name, joint, name, size, effect.probe_unit(robot, joint, name))


# A limit of torque that was not seen has no size.
SIZED = [effect for effect in EFFECTS if effect.seen_by != "neither"]


@pytest.mark.parametrize("effect", SIZED, ids=lambda effect: effect.name)
def test_an_unseen_parameter_is_one_that_a_finding_has(effect, planar, content, motion):
    bound = bound_of(effect, planar, motion, 0.04)
    (entry,) = content(bounds=(bound,))["unseen"]
    units = {one.name: one.unit for one in effect.parameters(planar, bound.joint)}
    assert units[entry["parameter"]] == entry["unit"]
    low, high = entry["range"]
    assert low <= entry["nothing"] <= high
    assert low < high


@pytest.mark.parametrize("effect", SIZED, ids=lambda effect: effect.name)
def test_robots_are_drawn_from_the_range_that_is_stated(effect, planar, diagnosed, content, motion, rng):
    bound = bound_of(effect, planar, motion, 0.04)
    (entry,) = content(bounds=(bound,))["unseen"]
    drawn = randomisation_of(diagnosed(bounds=(bound,)), planar)
    names = [one.name for one in effect.parameters(planar, bound.joint)]
    place = names.index(entry["parameter"])
    values = np.array([one.theta[place] for robot in draws(drawn, 200, rng) for one in robot])
    if unseen_effect(drawn, bound, 1.0) is None:
        assert not len(values)
        return
    low, high = entry["range"]
    assert ((low <= values) & (values <= high)).all()
    # They reach both ends, but for one that is infinite.
    near = 0.1 * (high - low if np.isfinite(high) else low)
    assert values.min() < low + near
    assert values.max() > (high - near if np.isfinite(high) else 10.0 * low)


def test_a_ratio_of_torque_is_about_one_whether_it_was_found_or_not(made, content):
    # Closed form: one over one more or less the size.
    found = made("torque_constant", "shoulder", ratio=Value(1.10, 0.01, "1"))
    said = content(found, bounds=(Bound("torque_constant", "elbow", "ratio", 0.04, "1"),))
    assert said["found"][0]["range"] == pytest.approx([1.08, 1.12])
    assert said["unseen"][0]["range"] == pytest.approx([1 / 1.04, 1 / 0.96])
    assert said["unseen"][0]["nothing"] == 1.0


def test_a_ratio_that_may_be_off_by_more_than_itself_stays_within_what_can_be(content, planar):
    # Closed form: a torque that is 2.5 times as large at one end; at the other no ratio is large enough.
    (entry,) = content(bounds=(Bound("torque_constant", "elbow", "ratio", 1.5, "1"),))["unseen"]
    (ratio,) = effect_named("torque_constant").parameters(planar, "elbow")
    assert entry["range"] == pytest.approx([0.4, ratio.upper])


def test_a_compliance_that_was_not_seen_is_a_stiffness_as_a_finding_states_it(made, content):
    # Closed form: 0.001 rad/(N m) at most are 1000 N m/rad and more, and a rigid one is infinitely stiff.
    found = made("transmission_compliance", "shoulder", stiffness=Value(3000.0, 10.0, "N m/rad"))
    bound = Bound("transmission_compliance", "elbow", "compliance", 0.001, "rad/(N m)")
    said = content(found, bounds=(bound,))
    assert {(e["parameter"], e["unit"]) for e in (*said["found"], *said["unseen"])} == {("stiffness", "N m/rad")}
    assert said["unseen"][0]["range"] == [1000.0, np.inf]
    assert said["unseen"][0]["drawn_as"] == {"quantity": "1/stiffness", "unit": "rad/(N m)", "range": [0.0, 0.001]}


def test_the_file_says_what_its_numbers_count_from(planar, made, content):
    # By hand: what was found comes on top of what the model states, and the field of the file is both together.
    found = made("viscous_friction", "elbow", coefficient=Value(0.84, 0.01, "N m s/rad"))
    bound = Bound("viscous_friction", "shoulder", "coefficient", 0.02, "N m s/rad")
    said = content(found, bounds=(bound,))
    assert said["counts"] == {
        "adjusted": "on top of the given model",
        "found": "on top of the given model",
        "unseen": "on top of the given model",
        "mjcf": "absolute",
    }
    given = dict(zip(planar.joint_names, planar.viscous_friction.tolist(), strict=True))
    fields = {one["name"]: one for one in said["mjcf"] if one["attribute"] == "damping"}
    assert said["found"][0]["value"] == 0.84
    assert fields["elbow"]["value"] == pytest.approx(given["elbow"] + 0.84)
    assert said["unseen"][0]["range"] == [0.0, 0.02]
    assert fields["shoulder"]["unseen_range"] == pytest.approx([given["shoulder"], given["shoulder"] + 0.02])


def test_its_first_lines_say_so_in_words(planar, diagnosed):
    text = randomisation_text(randomisation_of(diagnosed(), planar))
    head = " ".join(word for line in text.splitlines() if line.startswith("#") for word in line[1:].split())
    assert "found: effects that the diagnosis found, counted on top of the given model" in head
    assert "unseen: effects that were not seen, also counted on top of the given model" in head
    assert "mjcf: the same as numbers of corrected.xml, absolute" in head
