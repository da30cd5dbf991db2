"""Scores of the sealed cases: what is judged, least sizes."""

import json
import re

import pytest
from scored_by_hand import FAILED, answer, entry, finding, some_cases

from benchmarks.blind.score import as_json, load_baselines, load_pairs, main, report, write_score
from benchmarks.gapbench.scoring.judged import judged


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
    assert re.search(r"\| false claims on nulls +\| at most 2 % +\| -", report([]))
    assert as_json([])["figures"]["false claims on nulls"]["gap >= 2"]["total"] == 0


def test_a_missing_result_is_told(tmp_path):
    with pytest.raises(SystemExit, match="1 cases lack a result or an answer, first c9"):
        load_pairs(tmp_path, tmp_path, ["c9"])


def test_folders_are_scored_together(tmp_path, capsys):
    folders = {"answers": [], "results": []}
    said = entry(finding("coulomb_friction"), before=5.0, after=1.0)
    for name in ("one", "two"):
        for kind, content in (("answers", answer("coulomb_friction")), ("results", said)):
            folder = tmp_path / name / kind
            folder.mkdir(parents=True)
            (folder / f"{name}.json").write_text(json.dumps(content))
            folders[kind].append(str(folder))
    main(["--answers", *folders["answers"], "--results", *folders["results"], "--out", str(tmp_path / "out")])
    assert "Cases: 2." in capsys.readouterr().out


def test_folders_that_do_not_pair_are_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["--answers", "one", "two", "--results", "one", "--out", str(tmp_path)])
    assert "one folder of results for each folder of answers" in capsys.readouterr().err


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


@pytest.mark.parametrize(("joint", "right"), [("j1", True), ("j2", False)])
def test_a_cause_outside_the_catalogue_may_be_named_as_what_it_is(joint, right):
    x = judged(OUTSIDE, entry(finding("shaker", joint), verdict="explained"))
    assert (x.outside_right, x.wrong_but_fits) == (right, not right)


def test_friction_that_a_cable_makes_may_be_called_friction_that_depends_on_the_position():
    cable = {**OUTSIDE, "outside": {"name": "cable_drag", "joint": "j1"}}
    assert judged(cable, entry(finding("position_dependent_friction"), verdict="explained")).outside_right


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
