"""A low gain or a heavy robot. Oracles: known truth of simulated rods, ratios by hand, made-up diagnoses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.motion_only import SAME, case, in_set
from identification.data.recording import Recording
from identification.diagnosis.result import Bound, Diagnosis, Finding, Judgement, Value
from identification.notes import Code, Note
from identification.pipeline import diagnose
from identification.rollout.compare import Rollout
from identification.scenarios.gain_or_load import either, scales_by_friction, with_scaled_gains
from identification.scenarios.motion_limits import limited_to_motion
from identification.scenarios.motion_only import commanded_torque
from identification.words.note_words import sentence
from phantom_dyn.model.robot import Actuator, Controller, Robot

KP = 40.0


@pytest.fixture
def driven(pendulum) -> Robot:
    """A pendulum with 0.3 N m s/rad and 0.7 N m of modelled friction, and a gain that was estimated."""
    return replace(pendulum, actuators=(Actuator(controller=Controller(kp=KP, kd=0.1)),))


@pytest.fixture
def estimated(driven) -> Recording:
    t = np.arange(200) / 100.0
    q = 0.5 * np.sin(t)[:, None]
    log = Recording("log.csv", ("pin",), t, q, None, q_ref=q + 0.01, gains_estimated=("pin",), controlled=True)
    return replace(log, warnings=("other",), notes=(Note(Code.GAINS_ESTIMATED, "pin"),))


def friction(made_up, effect: str, parameter: str, value: float) -> Finding:
    finding = made_up(joints=("pin",)).findings[0]
    return replace(finding, effect=effect, joint="pin", parameters={parameter: Value(value, 0.01, "1")}, rivals=())


def less(made_up, value: float = -0.2) -> Finding:
    return friction(made_up, "viscous_friction", "coefficient", value)


def test_the_scale_is_the_modelled_friction_over_what_is_left_of_it(made_up, driven, estimated):
    # By hand: of 0.3 N m s/rad 0.2 are missing beyond what a gain of 0.1 gave back: 0.3 / 0.2.
    assert scales_by_friction(driven, (estimated,), (less(made_up),)) == pytest.approx({"pin": 1.5})
    dry = friction(made_up, "coulomb_friction", "torque", -0.35)
    assert scales_by_friction(driven, (estimated,), (dry,)) == pytest.approx({"pin": 2.0})


@pytest.mark.parametrize("value", [0.2, -0.39])
def test_more_friction_than_modelled_or_next_to_none_says_nothing_of_the_scale(made_up, driven, estimated, value):
    assert scales_by_friction(driven, (estimated,), (less(made_up, value),)) == {}


def test_a_gain_that_was_stated_is_not_scaled(made_up, driven, estimated):
    stated = replace(estimated, gains_estimated=())
    assert scales_by_friction(driven, (stated,), (less(made_up),)) == {}


def test_the_torque_of_a_higher_gain_is_as_many_times_larger(driven, estimated):
    robot, (recording,) = with_scaled_gains(driven, (estimated,), {"pin": 1.5})
    plain = replace(driven, actuators=(Actuator(controller=Controller(kp=KP, kd=0.0)),))
    np.testing.assert_allclose(recording.tau, 1.5 * commanded_torque(estimated, plain))
    controller = robot.actuators[0].controller
    assert controller is not None
    assert (controller.kp, controller.kd) == (60.0, 0.0)


def test_the_warning_names_both_gains_in_place_of_the_old_one(driven, estimated):
    _, (recording,) = with_scaled_gains(driven, (estimated,), {"pin": 1.5})
    other, note = recording.said
    assert (other, note.code) == ("other", Code.GAIN_BY_FRICTION)
    words = sentence(note)
    assert "kp is 40 N m/rad, and the joint would rub less than the model states. With kp = 60 N m/rad" in words


def readings(made_up, left: tuple[float, float]) -> tuple[Diagnosis, Diagnosis]:
    """A diagnosis with less friction and one with a payload, which leave so many floors each."""
    made = made_up(joints=("pin",))
    gap = made.joints[0]
    load = replace(less(made_up), effect="payload", joint=None, parameters={"mass": Value(1.0, 0.1, "kg")})
    return tuple(
        replace(
            made,
            findings=(finding,),
            joints=(replace(gap, rms_after=floors * gap.noise_floor),),
            evidence=replace(
                made.evidence,
                tau_after=made.evidence.tau_measured
                + floors * gap.noise_floor * np.ones_like(made.evidence.tau_measured),
            ),
        )
        for finding, floors in zip((less(made_up), load), left, strict=True)
    )  # pyright: ignore[reportReturnType]


@pytest.mark.parametrize(("left", "leads"), [((1.2, 1.1), True), ((1.1, 1.2), False)])
def test_what_noise_alone_separates_stays_in_the_set(made_up, left, leads):
    second_leads, found = either(*readings(made_up, left), {})
    (finding,) = found.findings
    (rival,) = finding.rivals
    assert second_leads is leads
    assert {finding.effect, rival.effects[0].effect} == {"payload", "viscous_friction"}
    assert (finding.probability, rival.probability, finding.verdict) == (0.5, 0.5, "one_of")


@pytest.mark.parametrize(("left", "effect"), [((5.0, 1.1), "payload"), ((1.1, 5.0), "viscous_friction")])
def test_a_reading_that_leaves_a_gap_is_ruled_out(made_up, left, effect):
    _, found = either(*readings(made_up, left), {})
    (finding,) = found.findings
    assert (finding.effect, finding.rivals) == (effect, ())


def test_torques_of_the_second_are_compared_at_the_scale_of_the_first(made_up):
    # By hand: twice as large torques that leave four times as much leave twice as much.
    first, second = readings(made_up, (3.0, 4.0))
    assert [either(first, second, {"pin": scale})[0] for scale in (1.0, 2.0)] == [False, True]


@pytest.mark.whole
@pytest.mark.parametrize(("truth", "seed"), [("payload", 0), ("payload", 3), ("less_friction", 0), ("nothing", 0)])
def test_the_truth_is_in_the_set_without_a_gain(truth, seed):
    one = case(truth, np.random.default_rng([seed, list(SAME).index(truth)]))
    silent = replace(one.robot, actuators=(Actuator(),))
    found = diagnose(silent, (one.recording,), motion_only=True)
    assert in_set(found, truth)
    if (truth, seed) == ("payload", 0):
        assert found.driven is not None
        controller = found.driven.actuators[0].controller
        assert controller is not None
        assert controller.kp == pytest.approx(60.0, rel=0.08)


def test_a_load_is_not_ruled_out_where_the_gain_was_estimated(made_up, driven, estimated):
    made = made_up(joints=("pin",), findings=0)
    bounds = tuple(
        Bound(effect, joint, "x", 0.1, "kg", 0.1) for effect, joint in (("payload", None), ("cogging", "pin"))
    )
    shared = {name: getattr(made, name) for name in ("joints", "adjusted", "unexplained", "evidence")}
    judgement = Judgement("no_gap", findings=(), bounds=bounds, not_testable=(), **shared)
    found = limited_to_motion(judgement, (estimated,), Rollout(None, {}, {}), driven)
    assert [bound.effect for bound in found.bounds] == ["cogging"]
    (why,) = (entry.why for entry in found.not_testable if entry.effect == "payload")
    assert "a load that changes weight and inertia of a joint alike makes it higher" in why
    stated = limited_to_motion(judgement, (replace(estimated, gains_estimated=()),), Rollout(None, {}, {}), driven)
    assert [bound.effect for bound in stated.bounds] == ["payload", "cogging"]
