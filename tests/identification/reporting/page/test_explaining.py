from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from identification.diagnosis.result import Diagnosis, Finding, Value
from identification.reporting.page.explaining import (
    Variable,
    displacement_by_recording,
    explained_share,
    explaining_variable,
    joint_motions,
    joint_of,
    strongest_variable,
)
from phantom_dyn.effects.catalogue import EFFECTS


def variable_of(diagnosis: Diagnosis, effect: str, joint: str | None = "j1", **parameters: Value) -> Variable:
    finding = Finding(effect, joint, "everywhere", parameters, 0.8, (0.7, 0.9), 0.9, (), "supported")
    motions = joint_motions(None, diagnosis)
    evidence = diagnosis.evidence
    return explaining_variable(diagnosis, motions, finding, (evidence.tau_measured - evidence.tau_before)[:, 0])


@pytest.fixture(scope="module")
def shown(made_up) -> Diagnosis:
    return made_up(samples=4000)


def test_every_effect_has_variables():
    assert all(effect.words.shown_over for effect in EFFECTS)


@pytest.mark.parametrize("effect", [effect.name for effect in EFFECTS])
def test_every_effect_has_a_variable_of_as_many_samples_as_there_are(shown, effect):
    assert variable_of(shown, effect).x.shape == (4000,)


@pytest.mark.parametrize(
    ("effect", "name"),
    [
        ("stribeck_friction", "velocity"),
        ("temperature_dependent_friction", "velocity"),
        ("presliding_friction", "displacement since reversal"),
        ("load_dependent_friction", "torque that the transmission passes on"),
        ("input_delay", "rate of change of the torque"),
        ("rotor_inertia", "acceleration"),
        ("torque_saturation", "commanded torque"),
        ("torque_constant", "modelled torque"),
        ("parasitic_spring", "position"),
        ("torque_offset", "time"),
    ],
)
def test_an_effect_is_shown_over_what_its_law_depends_on(shown, effect, name):
    assert variable_of(shown, effect).name == name


def test_displacement_counts_from_the_last_reversal():
    # Closed form: a triangle of slope one that turns at 1, 3 and 5 s.
    t = np.arange(0, 6, 0.01)
    q = np.abs((t + 1) % 4 - 2)
    v = np.gradient(q, t)
    x = displacement_by_recording(t, q, v)
    assert np.isnan(x[t < 0.98]).all()
    assert x[np.searchsorted(t, 2.0)] == pytest.approx(q[200] - q[100], abs=0.03)
    assert np.nanmax(np.abs(x)) == pytest.approx(2.0, abs=0.05)


def test_standing_still_is_no_reversal():
    v = np.array([1.0, 1, 0, 0, 1, 1, -1, -1])
    x = displacement_by_recording(np.arange(8.0), np.arange(8.0), v)
    assert np.flatnonzero(x == 0).tolist() == [6]


def test_a_new_recording_has_no_reversal_yet():
    t = np.concatenate([np.arange(0, 1, 0.1), 50 + np.arange(0, 1, 0.1)])
    v = np.where(np.arange(20) % 10 < 5, 1.0, -1.0)
    assert np.isnan(displacement_by_recording(t, np.zeros(20), v)).tolist() == ([True] * 5 + [False] * 5) * 2


def test_a_function_of_the_variable_is_explained_and_noise_is_not(rng):
    x = rng.uniform(-1, 1, 5000)
    assert explained_share(x, np.sign(x)) > 0.99
    assert explained_share(x, rng.standard_normal(5000)) < 0.02


def test_two_branches_are_explained_where_the_direction_is_known(rng):
    x, forward = rng.uniform(-1, 1, 5000), rng.uniform(size=5000) > 0.5
    y = np.where(forward, 1.0, -1.0)
    assert explained_share(x, y) < 0.05
    assert explained_share(x, y, forward) > 0.97


def test_a_rest_is_shown_over_the_variable_that_made_it(shown, rng):
    for name, x in (("time", shown.evidence.t), ("position", shown.evidence.q[:, 0])):
        residual = 3 * x + 0.1 * rng.standard_normal(4000)
        assert strongest_variable(shown, joint_motions(None, shown), "j1", residual).name == name


def test_the_data_choose_among_the_candidates_of_a_payload(shown):
    evidence, motions = shown.evidence, joint_motions(None, shown)
    finding = Finding("payload", None, "posture", {}, 0.8, (0.7, 0.9), 0.9, (), "supported")
    noise = np.random.default_rng(0).standard_normal(4000)
    assert explaining_variable(shown, motions, finding, np.sin(evidence.q[:, 0]) + 0.1 * noise).name == "position"


def test_a_finding_of_the_whole_robot_is_shown_at_the_joint_that_gained_most(made_up):
    diagnosis = made_up(("a", "b", "c"), samples=100)
    gaps = list(diagnosis.joints)
    gaps[1] = dataclasses.replace(gaps[1], rms_before=9.0)
    diagnosis = dataclasses.replace(diagnosis, joints=tuple(gaps))
    assert joint_of(diagnosis, None) == 1
    assert joint_of(diagnosis, "a+c") in (0, 2)
    assert joint_of(diagnosis, "crank") == 1
    assert joint_of(diagnosis, "c") == 2


def test_a_coupling_is_shown_over_the_velocity_of_its_law(shown):
    ratio = Value(-0.5, 0.01, "1")
    variable = variable_of(shown, "joint_coupling", "j1+j2", ratio=ratio)
    v = shown.evidence.v
    assert variable.x == pytest.approx(v[:, 0] - 0.5 * v[:, 1])
    assert variable.name == "velocity of j1 -0.5 × that of j2"


def test_cogging_is_folded_into_one_period_of_its_strongest_order(shown):
    order, amplitude = Value([2.0, 20.0], [0.0, 0.0], "1"), Value([0.01, 0.5], [0.0, 0.0], "N m")
    variable = variable_of(shown, "cogging", order=order, amplitude=amplitude)
    assert np.ptp(variable.x) == pytest.approx(2 * np.pi / 20, rel=0.01)
    assert variable.name == "angle in one of 20 periods of a turn"


def test_less_than_a_period_is_not_folded(shown):
    variable = variable_of(shown, "encoder_eccentricity", order=Value(1.0, 0.0, "1"))
    assert variable.name == "position"


def test_presliding_is_shown_near_the_reversal(shown):
    assert variable_of(shown, "presliding_friction", displacement=Value(0.01, 1e-4, "rad")).reach == pytest.approx(0.08)


def test_the_transmitted_torque_is_the_one_that_the_evidence_holds(shown):
    given = np.full_like(shown.evidence.q, 7.0)
    evidence = dataclasses.replace(shown.evidence, tau_transmitted=given)
    variable = variable_of(dataclasses.replace(shown, evidence=evidence), "backlash")
    assert (variable.x == 7.0).all()


def test_a_rate_of_change_has_no_value_between_recordings(shown):
    # Finite differences of the modelled torque inside a recording.
    variable = variable_of(shown, "actuator_lag")
    evidence = shown.evidence
    assert np.isnan(variable.x[[0, 1999, 2000, 3999]]).all()
    slope = (evidence.tau_before[101, 0] - evidence.tau_before[99, 0]) / (evidence.t[101] - evidence.t[99])
    assert variable.x[100] == pytest.approx(slope)


def test_a_linear_joint_has_metres_and_forces(made_up):
    diagnosis = made_up(("j1",), samples=400, unit="N")
    assert variable_of(diagnosis, "rotor_inertia").unit == "m/s²"
    assert variable_of(diagnosis, "torque_constant").name == "modelled force"
