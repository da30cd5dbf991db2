"""Whatever a ``corrected.yaml`` holds is read back. Oracle: the parameters that were put into it."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml

from identification.data.log import Log
from identification.data.signals import process_all
from identification.diagnosis.columns.operations import operation_of
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Finding, Value
from identification.export.corrected.corrected_yaml import known_effects, write_corrected
from identification.geometry.result import GeometryResult, Number, PoseFinding
from made_up_diagnosis import made_up_diagnosis
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS


def drawn(effect: Effect, robot: Robot, joint: str | None, waves: int, rng) -> KnownEffect:
    """An effect of that name with possible parameters, so many of each where it takes lists."""
    theta: list[float] = []
    for parameter in effect.parameters(robot, joint):
        low = max(parameter.lower, -0.2)
        theta += rng.uniform(low, min(parameter.upper, low + 0.3), waves).tolist()
    return KnownEffect(effect.name, joint, tuple(theta))


def said(robot: Robot, one: KnownEffect) -> Finding:
    """The same as a finding states it."""
    effect = effect_named(one.effect, robot)
    parameters = effect.parameters(robot, one.joint)
    each = np.reshape(one.theta, (len(parameters), -1)).tolist()
    values = {
        parameter.name: Value(numbers, [0.01] * len(numbers), parameter.unit)
        if effect.takes_lists(robot, one.joint)
        else Value(numbers[0], 0.01, parameter.unit)
        for parameter, numbers in zip(parameters, each, strict=True)
    }
    return Finding(one.effect, one.joint, effect.regime, values, 0.5, (0.4, 0.6), 0.9, (), "supported")


def read_back(robot: Robot, findings: tuple[Finding, ...], folder) -> tuple[KnownEffect, ...]:
    """What is known after the findings were written to a file."""
    file = folder / "corrected.yaml"
    file.write_text(write_corrected(replace(made_up_diagnosis(findings=0), findings=findings), "arm", "0"))
    return known_effects((file,), robot)


@pytest.fixture(scope="module")
def log(lab, planar2) -> Log:
    """A recording of the arm, with temperatures of its drives."""
    made = lab.recording(planar2, lab.motion(2, 4, seconds=6.0))
    return process_all((replace(made, temperature=np.full(made.q.shape, 30.0)),), planar2)[0][0]


ARM = load_robot(ROBOTS / "planar2.urdf")
OF_WAVES = [effect for effect in EFFECTS if effect.takes_lists(ARM, effect.places(ARM)[-1])]
COUNTS = [(effect, waves) for effect in EFFECTS for waves in ((1, 3) if effect in OF_WAVES else (1,))]


@pytest.mark.parametrize(("effect", "waves"), COUNTS, ids=[f"{e.name}-{n}" for e, n in COUNTS])
def test_an_effect_in_every_place_is_read_back_and_used(effect, waves, planar2, log, tmp_path, rng):
    put = tuple(drawn(effect, planar2, joint, waves, rng) for joint in effect.places(planar2))
    known = read_back(planar2, tuple(said(planar2, one) for one in put), tmp_path)
    assert known == put
    assert np.isfinite(operation_of(planar2, log, known).tau).all()


def test_all_effects_at_once_are_read_back_and_used(planar2, log, tmp_path, rng):
    put = tuple(drawn(e, planar2, joint, n, rng) for e, n in COUNTS for joint in e.places(planar2)[-1:])
    known = read_back(planar2, tuple(said(planar2, one) for one in put), tmp_path)
    assert known == put
    assert np.isfinite(operation_of(planar2, log, known).tau).all()


@pytest.mark.parametrize("effect", OF_WAVES, ids=lambda e: e.name)
def test_one_wave_that_was_written_as_numbers_is_read_as_a_list_of_one(effect, planar2, log, tmp_path, rng):
    # Files of earlier versions have it so, and so does one that is written by hand.
    one = drawn(effect, planar2, "elbow", 1, rng)
    read_back(planar2, (said(planar2, one),), tmp_path)
    file = tmp_path / "corrected.yaml"
    content = yaml.safe_load(file.read_text())
    for number in content["effects"][0]["parameters"].values():
        assert len(number["value"]) == 1
        number["value"], number["std"] = number["value"][0], number["std"][0]
    file.write_text(yaml.safe_dump(content))
    assert known_effects((file,), planar2) == (one,)
    assert np.isfinite(operation_of(planar2, log, (one,)).tau).all()


@pytest.mark.parametrize(("name", "joint"), [("coulomb_friction", "shoulder+elbow"), ("joint_coupling", "elbow+elbow")])
def test_an_effect_where_none_can_sit_is_refused(name, joint, planar2, tmp_path, rng):
    effect = effect_named(name)
    one = said(planar2, drawn(effect, planar2, effect.places(planar2)[0], 1, rng))
    with pytest.raises(ParameterError, match=re.escape(f"effect {name} is on joint '{joint}', which this robot does")):
        read_back(planar2, (replace(one, joint=joint),), tmp_path)


def test_first_moments_of_a_load_that_may_weigh_nothing_are_read_back_as_its_place(planar2, log, tmp_path):
    # By hand: 0.06 kg m at 0.2 kg are 0.3 m.
    moments = {f"moment_{axis}": Value(0.06 * (axis == "x"), 0.01, "kg m") for axis in "xyz"}
    mass = {"mass": Value(0.2, 0.15, "kg")}
    load = Finding("payload", None, "posture", mass | moments, 0.5, (0.4, 0.6), 0.9, (), "supported")
    (known,) = read_back(planar2, (load,), tmp_path)
    assert known.theta == pytest.approx((0.2, 0.3, 0.0, 0.0))
    assert np.isfinite(operation_of(planar2, log, (known,)).tau).all()


def test_base_parameters_of_a_link_are_read_back_beside_zeros(planar2, log, tmp_path):
    names = [p.name for p in effect_named("inertial_parameters").parameters(planar2, "elbow")]
    some = {names[3]: Value(0.1, 0.01, "kg m"), names[9]: Value(0.02, 0.01, "kg m^2")}
    found = Finding("inertial_parameters", "elbow", "posture", some, 0.5, (0.4, 0.6), 0.9, (), "supported")
    (known,) = read_back(planar2, (found,), tmp_path)
    assert known.theta == (0.0, 0.0, 0.0, 0.1, *[0.0] * 5, 0.02)
    assert np.isfinite(operation_of(planar2, log, (known,)).tau).all()


def test_friction_of_passive_joints_is_read_back(tmp_path, rng):
    robot = load_robot(ROBOTS / "fourbar.urdf", config=ROBOTS / "fourbar.yaml")
    assert robot.passive_names
    places = (*robot.joint_names, *robot.passive_names)
    names = ("viscous_friction", "coulomb_friction")
    put = tuple(drawn(effect_named(name), robot, joint, 1, rng) for name in names for joint in places)
    assert read_back(robot, tuple(said(robot, one) for one in put), tmp_path) == put


SIX = ("x", "y", "z", "rx", "ry", "rz")


@pytest.mark.parametrize("given", [SIX, ("z",), ("x", "ry")], ids=["all", "one", "two"])
def test_what_poses_show_is_read_back_beside_torques(given, planar2, tmp_path):
    # What is not named of a pose is as the model has it.
    places = [("link_geometry", "shoulder"), ("link_geometry", "elbow"), ("base_pose", None), ("tool_pose", "lower")]
    poses = [(effect, joint, {name: 1e-3 * (1 + SIX.index(name)) for name in given}) for effect, joint in places]
    soft = [("joint_elasticity", joint, {"compliance": 2e-4}) for joint in planar2.joint_names]
    zeros = [("encoder_offset", joint, {"offset": 0.01}) for joint in planar2.joint_names]
    findings = tuple(
        PoseFinding(effect, joint, {n: Number(x, 1e-5, "1") for n, x in numbers.items()}, 0.1, 0.1, (0.0, 0.2), 0.9, ())
        for effect, joint, numbers in (*poses, *soft, *zeros)
    )
    none: tuple = ()
    seen = GeometryResult("explained", 0.9, (0.8, 1.0), none, findings, none, none, none, none, none, 6, False, none)
    friction = said(planar2, KnownEffect("coulomb_friction", "elbow", (0.3,)))
    file = tmp_path / "corrected.yaml"
    file.write_text(
        write_corrected(replace(made_up_diagnosis(findings=0), findings=(friction,), geometry=seen), "", "")
    )
    whole = tuple(1e-3 * (1 + k) if name in given else 0.0 for k, name in enumerate(SIX))
    assert known_effects((file,), planar2) == (
        KnownEffect("coulomb_friction", "elbow", (0.3,)),
        *(KnownEffect(effect, joint, whole) for effect, joint in places),
        *(KnownEffect("joint_elasticity", joint, (2e-4,)) for joint in planar2.joint_names),
        *(KnownEffect("encoder_offset", joint, (0.01,)) for joint in planar2.joint_names),
    )
