"""What explains a gap: figures and sections of a law."""

import dataclasses
import json

import numpy as np
import pytest

from identification.diagnosis.residual_law import Dependence, FrequencyResponse, InputCurve, InputGain, Law, LawTerm
from identification.diagnosis.result import Diagnosis, Finding, Unexplained, Value
from identification.reporting.diagnosis_summary import summary
from identification.reporting.page.diagnosis_report import report_html
from identification.reporting.page.explaining import (
    Variable,
    displacement_by_recording,
    explained_share,
    explaining_variable,
    joint_motions,
    joint_of,
    strongest_variable,
)
from identification.reporting.stored.diagnosis_files import json_text
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from identification.words.law_words import dependence_sentences
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
        ("load_dependent_friction", "torque through the transmission"),
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


LAW = Law("j2", ("v.j2", "q.j1"), "-2*sign(v)", 0.7, (0.6, 0.8), {"v.j2": (-1.0, 2.0)}, "rust on a hinge")

FOUND = Dependence(
    "j2", "N m", ("v.j2", "q.j1"),
    (InputGain(("v.j2", "q.j1"), 0.9, (0.8, 0.95), 0.2), InputGain(("t",), -0.1, (-0.3, 0.0), 0.2)),
    (InputCurve("v.j2", "rad/s", "", (0.0, 1.0), (1.0, -1.0), (0.5, -1.5), (1.5, -0.5)),),
    (LawTerm("sign(v)", "N m", -2.0, (-2.1, -1.9), 0.95),), 0.9, 0.88, 17,
)  # fmt: skip


@pytest.fixture
def lawful(made_up):
    rest = Unexplained(0.4, True, "j2", "low_speed", law=LAW, dependence=FOUND)
    return dataclasses.replace(made_up(), verdict="unknown", unexplained=rest)


@pytest.fixture
def lawless(lawful):
    found = dataclasses.replace(FOUND, terms=(), same_terms=0.0, predicted_share=0.0)
    return dataclasses.replace(lawful, unexplained=dataclasses.replace(lawful.unexplained, law=None, dependence=found))


def test_the_terminal_says_the_law_in_one_sentence(lawful):
    text = " ".join(summary(lawful).split())
    assert (
        "What is left on joint j2 depends on the velocity and the position of j1: -2*sign(v) [N m] closes 70 % "
        "(60 to 80 %) of the gap, looks most like rust on a hinge." in text
    )


def test_inputs_that_are_in_no_row_of_the_table_are_said_to_come_from_formulas():
    assert dependence_sentences(FOUND, None)[0] == "It depends on the velocity and the position of j1."
    other = dataclasses.replace(FOUND, inputs=("v.j2", "a.j2"))
    assert dependence_sentences(other, None)[:2] == [
        "It depends on the velocity and the acceleration.",
        "Most formulas that are fitted to random draws of the recording use them, but smooth functions of other inputs "
        "predict more.",
    ]


def test_the_terminal_names_the_inputs_where_no_formula_stands_out(lawless):
    text = " ".join(summary(lawless).split())
    assert "depends on the velocity and the position of j1; no formula stands out." in text


def test_the_terminal_says_no_law_of_the_little_that_an_explained_gap_leaves(lawful):
    assert "What is left" not in summary(dataclasses.replace(lawful, verdict="explained"))


def test_the_report_has_formula_range_and_terms(lawful):
    page = report_html(lawful)
    for text in ("<code>-2*sign(v) [N m]</code>", "v.j2 from -1 to 2", "rust on a hinge", "-2.1 to -1.9"):
        assert text in page


def test_the_report_says_which_inputs_are_beyond_chance(lawful):
    page = report_html(lawful)
    rows = page.split("What the residual depends on")[1]
    assert (
        rows.index("The velocity and the position of j1") < rows.index("yes") < rows.index("Time") < rows.index("no<")
    )


def test_a_curve_has_a_band(lawful):
    assert report_html(lawful).count("<polygon") == report_html(dataclasses.replace(lawful, unexplained=Unexplained(
        0.4, True, "j2", "low_speed"))).count("<polygon") + 1  # fmt: skip


def test_the_report_says_why_there_is_no_formula(lawless):
    assert "the best terms change" in " ".join(report_html(lawless).split())


def test_what_was_written_is_read_back(lawful, tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text(json_text(lawful), encoding="utf-8")
    assert read_diagnosis(path).unexplained == lawful.unexplained


def test_without_a_look_there_is_no_dependence_in_the_file(made_up):
    assert "dependence" not in json.loads(json_text(made_up()))["unexplained"]


RESPONSE = FrequencyResponse(
    "freq(v.j2)",
    "N m/(rad/s)",
    (0.1, 1.0),
    (3.0, 1.0),
    (2.5, 0.5),
    (3.5, 1.5),
    (0.0, -60.0),
    (-5.0, -70.0),
    (5.0, -50.0),
)


@pytest.fixture
def dynamic(lawful):
    law = dataclasses.replace(
        LAW, inputs=("freq(v.j2)",), formula="-3*low(v, 0.4 Hz)", valid={"freq(v.j2)": (0.1, 1.0)}
    )
    found = dataclasses.replace(FOUND, inputs=("freq(v.j2)",), curves=(), responses=(RESPONSE,))
    return dataclasses.replace(lawful, unexplained=dataclasses.replace(lawful.unexplained, law=law, dependence=found))


def test_a_frequency_is_said_in_words(dynamic):
    text = " ".join(summary(dynamic).split())
    assert "What is left on joint j2 depends on the frequency of the velocity: -3*low(v, 0.4 Hz)" in text


def test_the_report_says_what_a_frequency_means_and_where_it_is_known(dynamic):
    page = " ".join(report_html(dynamic).split())
    assert "Its response to the velocity has a gain and a phase that change with the frequency" in page
    assert "freq(v.j2) from 0.1 to 1 Hz" in page


def test_gain_and_phase_have_a_panel_each_with_a_band(dynamic):
    page = report_html(dynamic)
    dependence = dataclasses.replace(dynamic.unexplained.dependence, responses=())
    unexplained = dataclasses.replace(dynamic.unexplained, dependence=dependence)
    without = report_html(dataclasses.replace(dynamic, unexplained=unexplained))
    assert page.count("<polygon") == without.count("<polygon") + 2
    assert "gain [N m/(rad/s)]" in page
    assert "phase [deg]" in page


def test_the_file_has_the_keys_of_its_schema(dynamic):
    # Oracle: docs/files.md, and files that were written before the fields of the code had their names.
    found = json.loads(json_text(dynamic))["unexplained"]["dependence"]
    assert found["rest_closed"] == FOUND.predicted_share
    assert found["answers"][0]["input"] == "freq(v.j2)"


def test_gain_and_phase_are_read_back(dynamic, tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text(json_text(dynamic), encoding="utf-8")
    assert read_diagnosis(path).unexplained == dynamic.unexplained
