"""Laws that are not linear, or made of a torque that other findings change: taken again about what was found."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.columns.terms import FoundEffect
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.search.refinement import (
    found_effects,
    matching_terms,
    needs_refinement,
    runners_up,
    same_points,
)
from identification.pipeline import diagnose
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import Cause, simulate


@pytest.fixture(scope="module")
def late(lab, planar2):
    """Recordings at 500 Hz of the planar arm whose drives are late, with Coulomb friction on the elbow."""

    def record(delay: float, friction: float = 0.0):
        now, then = (lab.motion(2, 3, rate=500.0, swing=1.5, ahead=lead) for lead in (0.0, delay))
        # Closed form of the motion: the command of now is the torque that is needed a delay later.
        tau = lab.recording(planar2, then, -friction * np.sign(then.v) * [0.0, 1.0]).tau
        return replace(lab.recording(planar2, now), tau=tau)

    return record


@pytest.mark.whole
def test_a_late_drive_is_found_with_its_delay(late, planar2):
    # Known truth: 4 ms. At 1.5 Hz a lag of the same time differs from it by a part in two thousand of the torque, so
    # that either may be named, but not without the other.
    (finding,) = diagnose(planar2, (late(0.004),)).findings
    named = {finding.effect, *(rival.effects[0].effect for rival in finding.rivals)}
    assert finding.joint is None
    assert {"input_delay", "actuator_lag"} <= named
    (time,) = finding.parameters.values()
    # The alignment of torque and motion is known to a quarter of a sample of 2 ms.
    assert abs(time.value - 0.004) < 3 * time.std
    assert time.std < 0.001


@pytest.mark.whole
def test_a_late_drive_and_friction_are_found_beside_each_other(late, planar2):
    # Known truth: 4 ms on all joints, 0.3 N m on the elbow.
    found = diagnose(planar2, (late(0.004, 0.3),)).findings
    friction, drive = sorted(found, key=lambda finding: finding.joint is None)
    assert (friction.effect, friction.joint) == ("coulomb_friction", "elbow")
    assert drive.effect in {"input_delay", "actuator_lag"}
    assert drive.joint is None
    (time,) = drive.parameters.values()
    assert time.value == pytest.approx(0.004, abs=0.001)
    assert friction.parameters["torque"].value == pytest.approx(0.3, rel=0.1)


def test_taking_a_delay_again_about_its_last_estimate_converges(late, lab, planar2):
    # Known truth; the fixed point of the secant is where coefficient and shape agree.
    recording, effect = late(0.004), effect_named("input_delay")
    last, estimate = 0.0, 0.012
    for _ in range(3):
        about = (FoundEffect(effect, None, (estimate,), np.array([estimate])),)
        prepared = lab.prepared(planar2, (recording,), found=about)
        term = prepared.term("input_delay", None)
        (point,) = found_effects(fit(prepared.problem, (term,)), frozenset([term]))
        last, estimate = estimate, float(point.coefficients[0])
    assert estimate == pytest.approx(last, rel=0.01)
    assert estimate == pytest.approx(0.004, abs=0.001)


def test_laws_that_are_linear_need_no_second_look():
    linear = FoundEffect(effect_named("viscous_friction"), "elbow", (), np.array([0.3]))
    assert not needs_refinement((linear,))


@pytest.mark.parametrize(("effect", "shape"), [("stribeck_friction", (0.2,)), ("actuator_lag", ())])
def test_laws_that_are_not_linear_or_follow_the_torque_are_looked_at_again(effect, shape):
    assert needs_refinement((FoundEffect(effect_named(effect), "elbow", shape, np.array([0.3, 0.2])),))


def test_friction_under_load_is_fitted_again_where_a_payload_changes_the_load():
    rubs = FoundEffect(effect_named("load_dependent_friction"), "elbow", (), np.array([0.1]))
    load = FoundEffect(effect_named("payload"), None, (), np.array([0.5, 0.0, 0.0, 0.1]))
    assert not needs_refinement((rubs,))
    assert needs_refinement((rubs, load))


def test_a_new_search_starts_from_the_shape_nearest_to_what_was_found(quiet):
    shapes = [term.shape[0] for term in quiet.search.terms if term.effect_joint == ("stribeck_friction", "elbow")]
    point = FoundEffect(effect_named("stribeck_friction"), "elbow", (1.05 * shapes[2],), np.array([0.3, 0.2]))
    (start,) = matching_terms(quiet.search, (point,))
    assert start.shape == (shapes[2],)


def test_what_a_new_search_does_not_have_is_not_started_from(quiet):
    gone = FoundEffect(effect_named("viscous_friction"), "wrist", (), np.array([0.3]))
    assert matching_terms(quiet.search, (gone,)) == frozenset()


@pytest.fixture(scope="module")
def turned(lab, planar2):
    """A recording of the planar arm whose elbow stands 0.3 rad further than its encoder says."""
    recording = lab.recording(planar2, lab.motion(2, 3, swing=1.5), noise=0.02)
    return replace(recording, q=recording.q - [0.0, 0.3])


def test_an_offset_too_large_for_its_tangent_is_a_runner_up_of_the_inertias_that_outdo_it(lab, planar2, turned):
    # Known truth: 0.3 rad; a tangent there is off by a twentieth.
    prepared = lab.prepared(planar2, (turned,))
    (point,) = [
        point
        for point in runners_up(prepared.search, frozenset([prepared.term("inertial_parameters", "elbow")]))
        if (point.effect.name, point.joint) == ("encoder_offset", "elbow")
    ]
    assert abs(point.coefficients[0]) == pytest.approx(0.3, rel=0.1)


@pytest.mark.whole
def test_a_large_offset_is_named_and_not_the_inertias_that_nearly_do_the_same(planar2, turned):
    (finding,) = diagnose(planar2, (turned,)).findings
    assert (finding.effect, finding.joint) == ("encoder_offset", "elbow")
    assert abs(finding.parameters["offset"].value) == pytest.approx(0.3, abs=0.02)


def test_without_a_gap_nothing_is_nearly_good_enough(quiet):
    assert runners_up(quiet.search, frozenset()) == ()


@pytest.mark.parametrize(
    ("effect", "joint", "shape", "same"),
    [
        ("stribeck_friction", "elbow", (0.202,), True),
        ("stribeck_friction", "elbow", (0.25,), False),
        ("stribeck_friction", "shoulder", (0.2,), False),
        ("backlash", "elbow", (0.2,), False),
    ],
)
def test_points_are_the_same_if_effect_and_joint_are_and_the_shape_has_hardly_moved(effect, joint, shape, same):
    before = FoundEffect(effect_named("stribeck_friction"), "elbow", (0.2,), np.array([0.3, 0.2]))
    now = FoundEffect(effect_named(effect), joint, shape, np.array([0.4, 0.1]))
    assert same_points((now,), (before,)) is same


def test_a_drive_that_is_asked_for_several_times_its_limit_is_still_found_once_its_limit_is_known(pendulum):
    # Known truth: a stiff controller asks for up to three times the 7 N m that the drive gives.
    t = np.arange(6000) / 500.0
    wanted = 0.8 * np.sin(2 * np.pi * 0.35 * t) + 0.4 * np.sin(2 * np.pi * 0.9 * t)
    none = np.zeros((len(t), 1))
    law = position_control(t, wanted[:, None], none, kp=np.array([60.0]), kd=np.array([6.0]))
    run = simulate(pendulum, (Cause(effect_named("torque_saturation"), "pin", np.array([7.0])),), law, t, np.zeros(1))
    noise = np.random.default_rng(0).standard_normal((2, len(t), 1))
    log = Recording("clipped.csv", pendulum.joint_names, t, run.q + 1e-5 * noise[0], run.tau + 0.01 * noise[1])
    assert np.abs(run.tau).max() > 21.0
    (finding,) = diagnose(pendulum, (log,)).findings
    assert finding.effect == "torque_saturation"
    assert finding.parameters["limit"].value == pytest.approx(7.0, rel=0.01)
