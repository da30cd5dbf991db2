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


def test_a_missing_result_is_reported(tmp_path):
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


PAIR = {
    **answer("viscous_friction"),
    "kind": "pair",
    "effects": [
        {"effect": "viscous_friction", "joint": "j1", "parameters": {"coefficient": 0.5}},
        {"effect": "coulomb_friction", "joint": "j2", "parameters": {"torque": 0.2}},
    ],
    "gap_in_floors": [6.0, 3.0],
}


OUTSIDE = {**answer(), "kind": "outside", "outside": {"name": "shaker", "joint": "j1"}, "paired_gap": 5.0}


VISCOUS, COULOMB = answer("viscous_friction"), finding("coulomb_friction")

ON_J2 = answer("viscous_friction", "j2")

RIGHT, SMALL = finding("viscous_friction"), finding("payload", None, closed=0.1)

BESIDE_RIVAL = [[("viscous_friction", "j1")]]

HALF_CLOSED = entry(COULOMB, before=5.0, after=3.5)

CABLE, RIPPLE = (
    {**OUTSIDE, "outside": {"name": name, "joint": "j1"}} for name in ("cable_drag", "torque_ripple_with_load")
)


def ruled(name, truth, said, **judgement):
    return pytest.param(truth, said, judgement, id=name)


@pytest.mark.parametrize(
    ("truth", "said", "judgement"),
    [
        # By hand, each row by the rules of the sealed cases.
        ruled("a null without a gap", answer(), entry(), false_claim=False),
        ruled("a finding on a null", answer(), entry(SMALL), false_claim=True),
        *(
            ruled(f"a null that is {verdict}", answer(), entry(verdict=verdict), false_claim=True)
            for verdict in ("unknown", "partly_explained", "explained", "not_testable")
        ),
        ruled(
            "the right effect on the right joint",
            ON_J2,
            entry(finding("viscous_friction", "j2")),
            top1_strict=True,
            top1=True,
            exact=True,
            in_set=True,
            joint=True,
            extra=False,
        ),
        ruled("the right effect on another joint", ON_J2, entry(RIGHT), top1=False, in_set=False, joint=False),
        ruled("the one that closes most leads", VISCOUS, entry(SMALL, RIGHT), leading="viscous_friction"),
        ruled("a second finding is extra", VISCOUS, entry(RIGHT, SMALL), top1=True, exact=False, extra=True),
        ruled(
            "a listed rival puts the truth in the set",
            VISCOUS,
            entry(finding("coulomb_friction", rivals=BESIDE_RIVAL)),
            top1=False,
            in_set=True,
            set_size=2,
            wrong_but_fits=False,
        ),
        ruled(
            "a rival that claims more than the truth does not hold it",
            VISCOUS,
            entry(finding("coulomb_friction", rivals=[[("viscous_friction", "j1"), ("payload", None)]])),
            in_set=False,
        ),
        ruled("a closed gap without the truth in the set", VISCOUS, entry(COULOMB), wrong_but_fits=True),
        ruled(
            "a gap that is half closed",
            VISCOUS,
            HALF_CLOSED,
            gap_closed=pytest.approx((25.0 - 12.25) / 24.0),
            wrong_but_fits=False,
        ),
        ruled("no claim on a single", VISCOUS, entry(), top1=False, wrong_but_fits=False, leading="no_gap"),
        ruled("a diagnosis that failed", VISCOUS, FAILED, verdict="failed", top1=False, in_set=False),
        ruled(
            "error and coverage are those of the right finding",
            VISCOUS,
            entry(finding("viscous_friction", value=0.55, std=0.02)),
            errors=pytest.approx((0.1,)),
            covered=(False,),
        ),
        ruled(
            "a second finding with the rival of the first is extra",
            VISCOUS,
            entry(
                finding("coulomb_friction", rivals=BESIDE_RIVAL),
                finding("stribeck_friction", closed=0.1, rivals=BESIDE_RIVAL),
            ),
            extra=True,
        ),
        ruled(
            "both of a pair",
            PAIR,
            entry(RIGHT, finding("coulomb_friction", "j2", closed=0.3)),
            all_named=True,
            exact=True,
            in_set=True,
            joint=True,
            extra=False,
            set_size=2,
        ),
        ruled(
            "one of a pair",
            PAIR,
            entry(RIGHT),
            top1=True,
            all_named=False,
            in_set=False,
            joint=False,
            wrong_but_fits=True,
        ),
        ruled(
            "one of a pair among the rivals",
            PAIR,
            entry(RIGHT, finding("stribeck_friction", "j2", closed=0.3, rivals=[[("coulomb_friction", "j2")]])),
            all_named=False,
            in_set=True,
            extra=False,
            set_size=3,
        ),
        ruled("the gap of a pair is that of the smaller effect", PAIR, entry(), gap=3.0),
        *(
            ruled(
                f"a gap closed outside the catalogue that is {verdict}",
                OUTSIDE,
                entry(RIGHT, verdict=verdict),
                effect="shaker",
                wrong_but_fits=verdict != "unknown",
            )
            for verdict in ("unknown", "explained", "partly_explained")
        ),
        *(
            ruled(
                f"a cause outside the catalogue, of j1, named on {joint}",
                OUTSIDE,
                entry(finding("shaker", joint), verdict="explained"),
                outside_right=joint == "j1",
                wrong_but_fits=joint != "j1",
            )
            for joint in ("j1", "j2")
        ),
        ruled(
            "friction of a cable may depend on the position",
            CABLE,
            entry(finding("position_dependent_friction"), verdict="explained"),
            outside_right=True,
        ),
        ruled(
            "a ripple that grows with the load named by its law",
            RIPPLE,
            entry(finding("torque_ripple"), verdict="explained"),
            outside_right=True,
        ),
        ruled(
            "explained outside the catalogue, however little is closed",
            OUTSIDE,
            entry(RIGHT, verdict="explained", after=4.9),
            wrong_but_fits=True,
        ),
    ],
)
def test_a_case_is_judged_by_the_rules(truth, said, judgement):
    found = judged(truth, said)
    assert {name: getattr(found, name) for name in judgement} == judgement


def test_what_is_closed_is_measured_against_a_fit_that_knows_the_cause():
    """Closed form: losses 25, 4 and 1 of the given model, the diagnosis and the oracle."""
    x = judged(VISCOUS, entry(finding("viscous_friction"), after=2.0), entry(after=1.0))
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
