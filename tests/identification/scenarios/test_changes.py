"""Changes between recordings: known, one difference, own effects."""

# pyright: reportAttributeAccessIssue=false
import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.data.changes import Change, KnownPayload, robot_in, with_payload
from identification.diagnosis.columns.one_recording_effects import (
    NO_DIFFERENCES,
    OneRecordingEffect,
    changed_effects,
    differences_of,
)
from identification.diagnosis.result import Value
from identification.export.corrected.corrected_yaml import write_corrected
from identification.notes import Code, Note
from identification.pipeline import diagnose
from identification.reporting.stored.diagnosis_files import json_text
from identification.scenarios.common_model import common_model, has_unknown_load
from identification.scenarios.known_changes import growth
from identification.words.diagnosis_words import finding_words
from identification.words.ledger_words import why
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_friction, with_parameters
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Controller
from phantom_dyn.motion import Motion


def test_a_known_mass_adds_its_torque(pendulum, swing):
    # Closed form: m l^2 a + m g l sin q of a point mass at l below the pin.
    motion = swing(3)
    loaded = robot_in(pendulum, Change("a.csv", KnownPayload(1.5, (0.0, 0.0, -0.9))))
    more = inverse_dynamics(loaded, motion) - inverse_dynamics(pendulum, motion)
    wanted = 1.5 * 0.9**2 * motion.a + 1.5 * 9.81 * 0.9 * np.sin(motion.q)
    np.testing.assert_allclose(more, wanted, atol=1e-9)


def test_the_centre_is_seen_from_the_payload_frame(pendulum):
    model = pendulum.model.copy()
    turned = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.pi / 2, 0.0), np.array([0.0, 0.0, -1.0]))
    model.addFrame(pin.Frame("tool", 1, 0, turned, pin.FrameType.OP_FRAME))
    robot = replace(pendulum, model=model, payload_frame="tool")
    still = Motion(np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)))
    # 0.2 m along z of the tool is 0.2 m along x of the rod: at rest it pulls by its weight times 0.2 m.
    loaded = robot_in(robot, Change("a.csv", KnownPayload(1.0, (0.0, 0.0, 0.2))))
    torque = inverse_dynamics(loaded, still) - inverse_dynamics(robot, still)
    np.testing.assert_allclose(torque, -9.81 * 0.2)


def test_known_gains_replace_those_of_the_robot(pendulum):
    gains = Controller("pd", 40.0, 1.0)
    assert robot_in(pendulum, Change("a.csv", controllers={"pin": gains})).actuators[0].controller == gains


def test_nothing_known_is_the_given_robot_itself(pendulum):
    assert robot_in(pendulum, Change("a.csv", KnownPayload(0.0, (0.0, 0.0, 1.0)))) is pendulum


def test_without_changes_recordings_are_alike(pendulum):
    assert differences_of((), pendulum, 2) is NO_DIFFERENCES


def test_where_all_recordings_changed_the_first_is_what_the_others_are_compared_with(pendulum):
    changes = tuple(Change(f"{k}.csv", changed=("controller",)) for k in range(3))
    assert {effect.recording for effect in differences_of(changes, pendulum, 3).effects} == {1, 2}


def test_what_changed_in_a_recording_that_is_held_out_is_refused(pendulum):
    changes = (Change("a.csv"), Change("b.csv"), Change("c.csv", changed=("friction",)))
    with pytest.raises(LogError, match=r"c\.csv is held out, so no fit sees what changed in it"):
        differences_of(changes, pendulum, 2)


def test_a_change_in_the_only_recording_is_refused(pendulum):
    with pytest.raises(LogError, match=r"a\.csv is the only recording that fits see, so friction cannot have changed"):
        differences_of((Change("a.csv", changed=("friction",)),), pendulum, 1)


LOADED = Change("b.csv", KnownPayload(1.5, (0.0, 0.0, -0.9)))


@pytest.fixture(scope="module")
def grown(pendulum, swing, recorded):
    """The pin has 0.3 N m more friction than modelled, in b 1.2 N m more, and nobody knows how much."""
    extra = ((1, 0.3, "a.csv"), (2, 1.2, "b.csv"))
    recordings = tuple(recorded(pendulum, swing(k), size * np.sign(swing(k).v), file, k) for k, size, file in extra)
    return diagnose(pendulum, recordings, changes=(Change("a.csv"), Change("b.csv", changed=("friction",))))


def in_b(diagnosis):
    return next(finding for finding in diagnosis.findings if finding.recording == "b.csv")


@pytest.mark.whole
def test_friction_that_grew_is_named_with_its_ratio(grown):
    # Known truth: 0.7 modelled and 0.3 more in a, 1.2 more in b.
    ratio = in_b(grown).parameters["ratio"]
    assert [(f.effect, f.recording) for f in grown.findings] == [
        ("coulomb_friction", "b.csv"),
        ("coulomb_friction", None),
    ]
    assert abs(ratio.value - 1.9 / 1.0) < 3 * ratio.std < 0.4
    assert grown.verdict == "explained"


@pytest.mark.whole
def test_friction_that_grew_is_said_with_its_recording(grown):
    said = finding_words(in_b(grown))
    assert "times what it is in the other recordings: friction torque" in said.what
    assert " on joint pin in b.csv, where it is" in said.what


@pytest.mark.whole
def test_only_what_one_recording_has_names_it_in_the_json(grown):
    found = json.loads(json_text(grown))["findings"]
    assert [finding.get("recording") for finding in found] == ["b.csv", None]


@pytest.mark.whole
def test_the_ledger_names_the_recording_of_a_claim(grown):
    claimed = {claim.effects for claim in grown.ledger if claim.outcome == "claimed"}
    assert claimed == {(one.effect_at,) for one in grown.findings}
    names = [answer.name for answer in why(grown, "coulomb_friction")]
    assert sorted(names) == ["Coulomb friction on joint pin", "Coulomb friction on joint pin in b.csv"]


@pytest.mark.whole
def test_what_one_recording_has_is_not_part_of_the_corrected_model(grown):
    assert write_corrected(grown, "pendulum", "0").count("coulomb_friction") == 1


@pytest.mark.whole
def test_no_effect_of_one_recording_is_left_in_bounds(grown):
    entries = (*grown.bounds, *grown.not_testable)
    assert not [entry for entry in entries if "@" in entry.effect]


@pytest.mark.whole
def test_friction_that_stayed_is_not_said_to_have_changed(pendulum, swing, recorded):
    recordings = tuple(recorded(pendulum, swing(k), 0.4 * np.sign(swing(k).v), f"{k}.csv", k) for k in (1, 2))
    found = diagnose(pendulum, recordings, changes=(Change("1.csv"), Change("2.csv", changed=("friction",))))
    assert [(finding.effect, finding.recording) for finding in found.findings] == [("coulomb_friction", None)]


@pytest.mark.whole
def test_payloads_without_a_value_in_two_recordings_are_refused(pendulum):
    changes = (Change("a.csv"), Change("b.csv", changed=("payload",)), Change("c.csv", changed=("payload",)))
    with pytest.raises(LogError, match=r"b\.csv and c\.csv each have a payload without a value"):
        differences_of(changes, pendulum, 3)


@pytest.mark.whole
@pytest.mark.parametrize("truth", ["payload", "torque_constant"])
def test_a_known_mass_parts_a_payload_and_a_torque_constant(frictionless, swing, recorded, truth):
    # Known truth. Without the mass both say the same torque: the effects are exact twins on a pendulum.
    def extra(robot, motion):
        if truth == "torque_constant":
            return inverse_dynamics(robot, motion) * (1 / 0.8 - 1)
        theta = np.array([0.6, 0.0, 0.0, -0.6])
        return -effect_named("payload").torque(robot, Operation.of(robot, motion), None, theta)

    loaded = robot_in(frictionless, LOADED)
    recordings = (
        recorded(frictionless, swing(1), extra(frictionless, swing(1)), "a.csv"),
        recorded(loaded, swing(2), extra(loaded, swing(2)), "b.csv", 2),
    )
    found = diagnose(frictionless, recordings, changes=(Change("a.csv"), LOADED))
    rivals = {at.effect for finding in found.findings for rival in finding.rivals for at in rival.effects}
    assert [finding.effect for finding in found.findings] == [truth]
    assert not rivals & {"payload", "torque_constant"}


LOAD = KnownPayload(0.8, (0.05, 0.0, -0.3))

CHANGES = (Change("bare.csv"), Change("loaded.csv", changed=("payload",)))


@pytest.fixture(scope="module")
def truly(planar2):
    """The arm with links 30 % heavier than modelled, and three times the friction."""
    heavier = with_parameters(planar2, 0.3 * standard_parameters(planar2))
    for row, joint in enumerate(planar2.joint_names):
        more = {"viscous": 2.0 * planar2.viscous_friction[row], "coulomb": 2.0 * planar2.coulomb_friction[row]}
        heavier = with_friction(heavier, joint, **more)
    return heavier


@pytest.fixture(scope="module")
def recordings(lab, truly, recorded):
    def both(load):
        robots = truly, truly if load is None else with_payload(truly, load)
        motions = (lab.motion(2, seed, seconds=20.0, swing=1.5) for seed in (3, 4))
        pairs = zip(robots, motions, CHANGES, strict=True)
        return tuple(recorded(robot, motion, 0.0, change.file, k) for k, (robot, motion, change) in enumerate(pairs))

    return both


@pytest.mark.whole
def test_the_model_in_common_needs_the_torques_of_the_true_arm(planar2, truly, recordings, lab):
    found, offsets, note = common_model(planar2, recordings(LOAD), CHANGES)
    motion = lab.motion(2, 9, seconds=5.0, swing=1.2)
    wanted = inverse_dynamics(truly, motion)
    off = np.sqrt(np.mean((inverse_dynamics(found, motion) - wanted) ** 2, axis=0))
    assert np.all(off < 0.02 * np.sqrt(np.mean(wanted**2, axis=0)))
    assert all(abs(one.theta[0]) < 0.05 for one in offsets)
    assert note == Note(Code.MODEL_IN_COMMON, None, {"files": ["bare.csv"]})


@pytest.mark.whole
def test_a_load_is_found_beside_a_weak_model(planar2, recordings):
    found = diagnose(planar2, recordings(LOAD), changes=CHANGES)
    (payload,) = (one for one in found.findings if one.effect == "payload")
    assert payload.recording == "loaded.csv"
    mass = payload.parameters["mass"]
    assert isinstance(mass.value, float)
    assert isinstance(mass.std, float)
    assert abs(mass.value - LOAD.mass) < 3 * mass.std < 0.3 * LOAD.mass
    assert found.verdict == "explained"


@pytest.mark.whole
def test_no_load_is_found_where_none_was_added(planar2, recordings):
    found = diagnose(planar2, recordings(None), changes=CHANGES)
    assert [one.effect for one in found.findings if one.recording is not None] == []


@pytest.mark.whole
def test_only_a_load_without_a_value_is_judged_by_its_difference():
    assert has_unknown_load(CHANGES)
    assert not has_unknown_load((CHANGES[0], replace(CHANGES[1], payload=LOAD)))
    assert not has_unknown_load((CHANGES[0], replace(CHANGES[1], changed=("friction",))))


@pytest.mark.whole
def test_a_load_in_every_recording_leaves_nothing_to_compare_with(planar2, recordings):
    both = tuple(replace(one, changed=("payload",)) for one in CHANGES)
    with pytest.raises(LogError, match="every recording carries a load without a value"):
        common_model(planar2, recordings(LOAD), both)


CHANGING = sorted(effect.name for effect in EFFECTS if effect.changes_with is not None)


@pytest.mark.parametrize("name", CHANGING)
def test_an_effect_of_one_recording_leaves_nothing_in_the_others(pendulum, swing, name):
    # Known truth: the effect itself in its recording, zero elsewhere.
    inner = effect_named(name)
    effect = OneRecordingEffect(inner, 1, "b.csv")
    here = replace(Operation.of(pendulum, swing(1)), recording=1)
    # Friction over position is tried where a residual asks for it: a place from end to end then.
    shape = next(iter(inner.shapes(pendulum, here, "pin")), (-0.5, 0.5, 5.0))
    wanted = inner.signature(pendulum, here, "pin", shape)
    np.testing.assert_array_equal(effect.signature(pendulum, here, "pin", shape).columns, wanted.columns)
    assert not effect.signature(pendulum, replace(here, recording=0), "pin", shape).columns.any()


def test_names_of_effects_are_those_of_their_recordings():
    names = {
        OneRecordingEffect(effect_named(name), k, "x.csv").name
        for name in ("viscous_friction", "coulomb_friction")
        for k in (0, 1)
    }
    assert len(names | {"viscous_friction", "coulomb_friction"}) == 6


def test_a_ratio_is_the_level_here_over_that_elsewhere():
    # Closed form: independent levels 1.0 +- 0.1 and 1.9 +- 0.1, whose difference is 0.9 +- sqrt(2) 0.1.
    ratio = growth(Value(0.9, 0.1 * np.sqrt(2), "N m"), Value(1.0, 0.1, "N m"))
    assert ratio is not None
    assert ratio.value == pytest.approx(1.9)
    assert ratio.std == pytest.approx(0.1 * np.hypot(1.0, 1.9))


def test_nothing_elsewhere_gives_no_ratio():
    assert growth(Value(0.9, 0.1, "N m"), Value(0.0, 0.0, "N m")) is None


def test_temperature_changes_friction_too(pendulum):
    # Oracle: what each effect of the catalogue says of itself.
    changed = {kind: {one.name for one in changed_effects(kind, pendulum)} for kind in ("friction", "temperature")}
    said = {effect.name: effect.changes_with for effect in EFFECTS}
    assert changed["friction"] == {name for name, kind in said.items() if kind == "friction"}
    assert changed["temperature"] == {name for name, kind in said.items() if kind in ("friction", "temperature")}
