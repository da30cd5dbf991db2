"""What the scorer counts, on diagnoses written by hand."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

# The benchmarks are no part of the installed packages.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.confusion import confusion, confusion_text
from benchmarks.blind.figures import FIGURES, beyond
from benchmarks.blind.judged import judged
from benchmarks.blind.proportions import average, proportion, wilson
from benchmarks.blind.score import as_json, load_baselines, load_pairs, report, write_score

PARAMETERS = {
    "viscous_friction": {"coefficient": 0.5},
    "coulomb_friction": {"torque": 0.2},
    "payload": {"mass": 0.5, "center_x": 0.0, "center_y": 0.0, "center_z": -0.2},
    "inertial_parameters": {"mass_factor": 1.5, "center_factor": 1.1, "inertia_factor": 1.2},
    "rotor_inertia": {"inertia": 0.02},
    "torque_constant": {"ratio": 0.8},
    "direction_dependent_friction": {
        "torque_positive": 0.3,
        "torque_negative": 0.1,
        "coefficient_positive": 0.0,
        "coefficient_negative": 0.0,
    },
}
JOINTS = {"pendulum": ["j1"], "planar2": ["j1", "j2"], "spatial3": ["j1", "j2", "j3"]}


def answer(effect=None, joint: str | None = "j1", *, robot="planar2", gap=6.0, parameters=None):
    effects = [{"effect": effect, "joint": joint, "parameters": parameters or PARAMETERS[effect]}] if effect else []
    kind = "single" if effect else "null"
    return {
        "id": "c1",
        "kind": kind,
        "robot": robot,
        "joints": JOINTS[robot],
        "effects": effects,
        "paired_gap": gap if effect else 0.0,
    }


def finding(effect, joint: str | None = "j1", *, closed=0.9, rivals=(), value=None, std=0.0):
    names = PARAMETERS.get(effect, {})
    parameters = {k: {"value": v if value is None else value, "std": std, "unit": ""} for k, v in names.items()}
    listed = [{"effects": [{"effect": e, "joint": j} for e, j in rival], "probability": 0.1} for rival in rivals]
    return {"effect": effect, "joint": joint, "gap_closed": closed, "parameters": parameters, "rivals": listed}


def entry(*findings, verdict=None, before=5.0, after=1.0):
    joint = {"joint": "j1", "rms_before": before, "rms_after": after, "noise_floor": 1.0}
    verdict = verdict or ("explained" if findings else "no_gap")
    return {"diagnosis": {"verdict": verdict, "findings": list(findings), "joints": [joint]}, "seconds": 2.0}


FAILED = {"diagnosis": None, "seconds": 1.0}


@pytest.mark.parametrize(
    ("hits", "total", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_interval_has_the_published_values(hits, total, low, high):
    """Newcombe, Statistics in Medicine 17 (1998), table I, method 3."""
    assert wilson(hits, total) == pytest.approx((low, high), abs=5e-5)


def test_impossible_proportions_are_refused():
    with pytest.raises(ValueError, match="5 hits of 3 are no proportion"):
        wilson(5, 3)


def test_a_null_with_no_gap_is_no_false_claim():
    assert not judged(answer(), entry()).false_claim


def test_any_finding_on_a_null_is_a_false_claim():
    assert judged(answer(), entry(finding("payload", None))).false_claim


@pytest.mark.parametrize("verdict", ["unknown", "partly_explained", "explained", "not_testable"])
def test_any_other_verdict_on_a_null_is_a_false_claim(verdict):
    assert judged(answer(), entry(verdict=verdict)).false_claim


def test_the_right_effect_on_the_right_joint_is_strictly_right():
    x = judged(answer("viscous_friction", "j2"), entry(finding("viscous_friction", "j2")))
    assert (x.top1_strict, x.top1, x.exact, x.in_set, x.joint, x.extra) == (True, True, True, True, True, False)


def test_the_right_effect_on_the_wrong_joint_is_wrong():
    x = judged(answer("viscous_friction", "j2"), entry(finding("viscous_friction", "j1")))
    assert (x.top1, x.in_set, x.joint) == (False, False, False)


def test_the_leading_finding_is_the_one_that_closes_most():
    small, large = finding("payload", None, closed=0.1), finding("viscous_friction", closed=0.8)
    assert judged(answer("viscous_friction"), entry(small, large)).leading == "viscous_friction"


def test_a_second_finding_is_extra_and_not_exact():
    x = judged(answer("viscous_friction"), entry(finding("viscous_friction"), finding("payload", None, closed=0.1)))
    assert (x.top1, x.exact, x.extra) == (True, False, True)


def test_a_listed_rival_puts_the_truth_in_the_set():
    rivals = [[("viscous_friction", "j1")]]
    x = judged(answer("viscous_friction"), entry(finding("coulomb_friction", rivals=rivals)))
    assert (x.top1, x.in_set, x.set_size, x.wrong_but_fits) == (False, True, 2, False)


def test_a_rival_that_claims_more_than_the_truth_does_not_hold_it():
    rivals = [[("viscous_friction", "j1"), ("payload", None)]]
    assert not judged(answer("viscous_friction"), entry(finding("coulomb_friction", rivals=rivals))).in_set


def test_a_closed_gap_without_the_truth_in_the_set_fits_but_is_wrong():
    assert judged(answer("viscous_friction"), entry(finding("coulomb_friction"))).wrong_but_fits


def test_a_half_closed_gap_does_not_fit():
    x = judged(answer("viscous_friction"), entry(finding("coulomb_friction"), before=5.0, after=3.5))
    assert x.gap_closed == pytest.approx((25.0 - 12.25) / 24.0)
    assert not x.wrong_but_fits


def test_no_claim_on_a_single_is_neither_right_nor_wrong_but_fits():
    x = judged(answer("viscous_friction"), entry())
    assert (x.top1, x.wrong_but_fits, x.leading) == (False, False, "no_gap")


def test_a_failed_diagnosis_is_wrong_and_told():
    x = judged(answer("viscous_friction"), FAILED)
    assert (x.verdict, x.top1, x.in_set) == ("failed", False, False)


def test_magnitude_error_and_coverage_are_those_of_the_right_finding():
    x = judged(answer("viscous_friction"), entry(finding("viscous_friction", value=0.55, std=0.02)))
    assert x.errors == pytest.approx((0.1,))
    assert x.covered == (False,)


TWINS = [
    ("payload", None, "pendulum", ["inertial_parameters:j1"]),
    ("inertial_parameters", "j1", "pendulum", ["payload:", "rotor_inertia:j1"]),
    ("rotor_inertia", "j1", "pendulum", ["inertial_parameters:j1"]),
    ("rotor_inertia", "j1", "planar2", ["inertial_parameters:j1"]),
    ("rotor_inertia", "j2", "spatial3", ["inertial_parameters:j2"]),
    ("torque_constant", "j1", "pendulum", ["inertial_parameters:j1", "viscous_friction:j1"]),
    ("direction_dependent_friction", "j2", "planar2", ["coulomb_friction:j2", "torque_offset:j2"]),
]


def claims_of(texts):
    pairs = [text.split(":") for text in texts]
    return [finding(e, j or None, closed=0.9 - 0.1 * i) for i, (e, j) in enumerate(pairs)]


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


def some_cases():
    right = judged(answer("viscous_friction", gap=6.0), entry(finding("viscous_friction")))
    missed = judged(answer("coulomb_friction", gap=1.0), entry())
    return [right, missed, judged(answer(), entry()), judged(answer(), entry(finding("payload", None)))]


def test_confusion_counts_truth_against_what_leads():
    table = confusion(some_cases())
    assert table.counts[table.rows.index("none")][table.columns.index("payload")] == 1
    assert "viscous_friction" in confusion_text(table)


def figure(name, cases):
    return next(f for f in FIGURES if f.name == name).of(cases)


def test_false_claims_are_counted_over_nulls_alone():
    assert figure("false claims on nulls", some_cases()) == proportion([False, True])


def test_large_gaps_keep_the_nulls():
    assert [x.kind for x in beyond(some_cases(), 2.0)] == ["single", "null", "null"]


def test_an_aim_is_met_at_its_edge_and_missed_beyond_it():
    aim = next(f for f in FIGURES if f.name == "false claims on nulls")
    assert (aim.met(proportion([True] + 49 * [False])), aim.met(proportion([True] + 48 * [False]))) == (True, False)


def test_no_case_meets_no_aim():
    assert FIGURES[0].met(proportion([])) is None


def test_a_mean_has_the_normal_interval():
    """Closed form: 1, 2, 3 have the mean 2 and the standard error 1 / sqrt 3."""
    assert average([1.0, 2.0, 3.0]).interval == pytest.approx((2 - 1.959964 / 3**0.5, 2 + 1.959964 / 3**0.5))


PAIR = {
    **answer("viscous_friction"),
    "kind": "pair",
    "effects": [
        {"effect": "viscous_friction", "joint": "j1", "parameters": {"coefficient": 0.5}},
        {"effect": "coulomb_friction", "joint": "j2", "parameters": {"torque": 0.2}},
    ],
    "gap_in_floors": [6.0, 3.0],
}


def test_both_effects_of_a_pair_are_both_named():
    x = judged(PAIR, entry(finding("viscous_friction"), finding("coulomb_friction", "j2", closed=0.3)))
    assert (x.all_named, x.exact, x.in_set, x.joint, x.extra, x.set_size) == (True, True, True, True, False, 2)


def test_one_effect_of_a_pair_is_not_both():
    x = judged(PAIR, entry(finding("viscous_friction")))
    assert (x.top1, x.all_named, x.in_set, x.joint, x.wrong_but_fits) == (True, False, False, False, True)


def test_a_pair_with_one_effect_among_the_rivals_is_in_the_set_and_not_both_named():
    other = finding("stribeck_friction", "j2", closed=0.3, rivals=[[("coulomb_friction", "j2")]])
    x = judged(PAIR, entry(finding("viscous_friction"), other))
    assert (x.all_named, x.in_set, x.extra, x.set_size) == (False, True, False, 3)


def test_the_gap_of_a_pair_is_that_of_the_smaller_effect():
    assert judged(PAIR, entry()).gap == 3.0


def test_a_second_finding_that_shares_its_rival_with_the_first_is_extra():
    rivals = [[("viscous_friction", "j1")]]
    twice = [finding("coulomb_friction", rivals=rivals), finding("stribeck_friction", closed=0.1, rivals=rivals)]
    assert judged(answer("viscous_friction"), entry(*twice)).extra


OUTSIDE = {**answer(), "kind": "outside", "outside": {"name": "shaker", "joint": "j1"}, "paired_gap": 5.0}


@pytest.mark.parametrize(("verdict", "wrong"), [("unknown", False), ("explained", True), ("partly_explained", True)])
def test_a_closed_gap_outside_the_catalogue_is_wrong_unless_it_is_called_unknown(verdict, wrong):
    x = judged(OUTSIDE, entry(finding("viscous_friction"), verdict=verdict))
    assert (x.effect, x.wrong_but_fits) == ("shaker", wrong)


def test_explained_outside_the_catalogue_is_wrong_however_little_is_closed():
    assert judged(OUTSIDE, entry(finding("viscous_friction"), verdict="explained", after=4.9)).wrong_but_fits


def test_what_is_closed_is_measured_against_a_fit_that_knows_the_cause():
    """Closed form: losses 25, 4 and 1 of the given model, the diagnosis and the oracle."""
    x = judged(answer("viscous_friction"), entry(finding("viscous_friction"), after=2.0), entry(after=1.0))
    assert x.of_oracle == pytest.approx((25.0 - 4.0) / (25.0 - 1.0))


def test_joints_count_by_their_noise_floors_in_the_oracle():
    """Closed form: joint j2 has a floor of 2, so the losses are (25 + 4) / 2, (9 + 1) / 2 and (1 + 1) / 2."""

    def of_two(first, second):
        said = entry(finding("viscous_friction"))
        joints = [(5.0, first, 1.0), (4.0, second, 2.0)]
        said["diagnosis"]["joints"] = [
            {"joint": f"j{k}", "rms_before": b, "rms_after": a, "noise_floor": n}
            for k, (b, a, n) in enumerate(joints, start=1)
        ]
        return said

    x = judged(answer("viscous_friction"), of_two(3.0, 2.0), of_two(1.0, 2.0))
    assert x.of_oracle == pytest.approx((14.5 - 5.0) / (14.5 - 1.0))


def test_a_list_of_parameters_is_compared_number_by_number_and_phases_around_the_circle():
    truth = answer("cogging", parameters={"order": [12], "amplitude": [0.1], "phase": [3.1]})
    said = finding("cogging")
    said["parameters"] = {
        "order": {"value": [12], "std": [0.0], "unit": ""},
        "amplitude": {"value": [0.11], "std": [0.01], "unit": "N m"},
        "phase": {"value": [-3.1], "std": [0.01], "unit": "rad"},
    }
    x = judged(truth, entry(said))
    assert x.covered == (True, False)
    assert x.errors == pytest.approx((0.1, (2 * 3.141592653589793 - 6.2) / 3.141592653589793))


def test_baselines_are_scored_in_the_true_noise_floors(tmp_path):
    """A baseline knows no noise floor: with the true one, 4 after a gap of 5 floors is no fit."""
    said = entry(finding("coulomb_friction"), before=5.0, after=4.0)["diagnosis"]
    said["joints"][0]["noise_floor"] = 4.0
    (tmp_path / "c1.json").write_text(json.dumps({**FAILED, "diagnosis": {"always_coulomb": {**said, "seconds": 0.5}}}))
    answers = tmp_path / "answers"
    answers.mkdir()
    (answers / "c1.json").write_text(json.dumps(answer("viscous_friction") | {"noise_floor": [1.0]}))
    case = load_baselines(answers, tmp_path, ["c1"])["always_coulomb"][0]
    assert (case.gap_closed, case.seconds) == (pytest.approx((25.0 - 16.0) / 24.0), 0.5)


def test_a_baseline_that_was_left_out_has_no_cases(tmp_path):
    said = {"mujoco_sysid": {"left_out": "not installed", "verdict": "failed", "findings": [], "joints": []}}
    (tmp_path / "c1.json").write_text(json.dumps({**FAILED, "diagnosis": said}))
    answers = tmp_path / "answers"
    answers.mkdir()
    (answers / "c1.json").write_text(json.dumps(answer("viscous_friction")))
    assert load_baselines(answers, tmp_path, ["c1"])["mujoco_sysid"] == []


def test_the_score_is_written_as_text_numbers_and_picture(tmp_path):
    text = write_score(some_cases(), tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["confusion.png", "confusion.txt", "score.json", "score.md"]
    assert "50 % (9 to 91)" in text


def test_the_report_of_no_case_has_no_numbers():
    assert "| false claims on nulls                               | at most 2 %   | -" in report([])
    assert as_json([])["figures"]["false claims on nulls"]["gap >= 2"]["total"] == 0


def test_a_missing_result_is_told(tmp_path):
    with pytest.raises(SystemExit, match="1 cases lack a result or an answer, first c9"):
        load_pairs(tmp_path, tmp_path, ["c9"])
