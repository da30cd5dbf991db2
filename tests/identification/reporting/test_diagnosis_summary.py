import dataclasses
from pathlib import Path

import pytest

from identification.diagnosis.result import Gap, Hidden, Value
from identification.reporting.diagnosis_summary import summary, written_lines


@pytest.mark.parametrize(("joints", "findings"), [(1, 0), (2, 3), (7, 15)])
def test_no_line_is_longer_than_100_columns(made_up, joints, findings):
    names = tuple(f"a_very_long_name_of_joint_{'x' * 30}_{k}" for k in range(joints))
    assert max(map(len, summary(made_up(names, findings)).splitlines())) <= 100


def test_each_finding_is_named_with_place_size_and_sureness(made_up):
    text = " ".join(summary(made_up(findings=2)).split())
    assert "1. Coulomb friction on joint j1: 0.25100 ± 0.00060 N m; very likely (93 %), 83 % (80 to 86 %)" in text
    assert "2. Viscous friction on joint j2" in text


def test_the_table_gives_the_given_the_tolerated_and_the_corrected_model_and_the_floor(made_up):
    rows = [line.split() for line in summary(made_up(("axis",), unit="N")).splitlines()]
    assert ["axis", "0.25", "0.24", "0.031", "0.03", "N"] in rows


def test_a_joint_without_a_sample_that_is_judged_has_no_figures(made_up):
    diagnosis = made_up(("axis",))
    unjudged = dataclasses.replace(diagnosis.joints[0], hold_out_samples=0)
    rows = [" ".join(line.split()) for line in summary(dataclasses.replace(diagnosis, joints=(unjudged,))).splitlines()]
    assert "axis not judged not judged not judged not judged N m" in rows


def test_warnings_and_the_next_experiment_are_reported(made_up):
    text = summary(dataclasses.replace(made_up(), next_experiment={"say": "Move joint j1 slowly."}))
    assert "Next experiment: Move joint j1 slowly." in text
    assert "Warning: first.csv: 12 repeated rows were dropped" in text


def test_notes_are_reported(made_up):
    text = summary(dataclasses.replace(made_up(), notes=("Simulated motion is compared over 0.1 s.",)))
    assert "  Note: Simulated motion is compared over 0.1 s." in text


def test_friction_that_grew_says_what_its_ratio_is_of(made_up):
    made = made_up(findings=1)
    ratio = {**made.findings[0].parameters, "ratio": Value(1.504, 0.014, "1")}
    grown = dataclasses.replace(made.findings[0], recording="b.csv", parameters=ratio)
    text = " ".join(summary(dataclasses.replace(made, findings=(grown,))).split())
    assert "N m, where it is 1.504 ± 0.014 times what it is in the other recordings; " in text


def test_control_characters_in_names_do_not_reach_the_terminal(made_up):
    text = summary(dataclasses.replace(made_up(("j\x1b[31m",)), data_warnings=("a\x1b[2Jb",)))
    assert "\x1b" not in text


def test_the_headline_comes_first_and_notes_come_last(made_up):
    made = dataclasses.replace(made_up(findings=2), gap=Gap(0.984, (0.97, 0.99)), next_experiment={"say": "Move."})
    text = summary(made)
    order = [
        "is explained by",
        "of the gap is closed",
        "1. Coulomb",
        "RMS torque",
        "Next experiment",
        "Warning:",
        "Note:",
    ]
    places = [text.index(part) for part in order]
    assert places == sorted(places)


def test_the_gap_is_stated_before_and_after_for_the_joint_of_which_most_is_closed(made_up):
    made = dataclasses.replace(made_up(), gap=Gap(0.984, (0.97, 0.99)))
    wanted = "98 % (97 to 99 %) of the gap is closed, most on joint j1: 0.24 -> 0.031 N m (noise floor 0.03)."
    assert wanted in summary(made)
    # By hand: 20 floors of which 0.1 are closed, beside 8 of which 7 are.
    almost = {"rms_before": 0.02, "rms_within_tolerance": 0.02, "rms_after": 0.0199, "noise_floor": 0.001}
    open_still = dataclasses.replace(made.joints[1], **almost)
    assert wanted in summary(dataclasses.replace(made, joints=(made.joints[0], open_still)))


def test_a_joint_that_is_worse_in_tolerance_than_given_is_explained_and_does_not_lead(made_up):
    made = dataclasses.replace(made_up(), gap=Gap(0.984, (0.97, 0.99)))
    first = dataclasses.replace(made.joints[0], rms_before=0.0315)
    text = " ".join(summary(dataclasses.replace(made, joints=(first, made.joints[1]))).split())
    assert "is closed, most on joint j2:" in text
    assert "In tolerance joint j1 is worse than given: changes within the tolerances are fitted to all joints" in text
    assert "is worse than given" not in summary(made)


def carried_by_tolerances(made_up):
    """Everything is closed, a quarter of it by the finding; the mass of a link has moved as far as it may."""
    made = made_up()
    finding = dataclasses.replace(made.findings[0], share=0.25)
    limit = dataclasses.replace(made.adjusted[0], change=0.1, at_limit=True, hides=Hidden("change", 0.1))
    return dataclasses.replace(made, findings=(finding,), gap=Gap(0.984, (0.97, 0.99)), adjusted=(limit,))


def test_what_is_left_within_the_interval_of_the_noise_may_be_no_gap(made_up):
    made = made_up()
    wide = {
        "rms_after": 0.14,
        "noise_floor": 0.002,
        "noise_floor_interval": (0.002, 0.16),
        "discrepancy": 0.12,
        "closed": 0.4,
    }
    first = dataclasses.replace(made.joints[0], **wide)
    text = " ".join(summary(dataclasses.replace(made, joints=(first, made.joints[1]))).split())
    # The root of the sum of squares of 0.16 and 0.12 is 0.2.
    assert "What is left on joint j1 may be no gap: noise and the errors of a sound model reach up to 0.2 N m" in text
    assert "may be no gap" not in summary(made)
    closed = dataclasses.replace(first, closed=0.95)
    assert "may be no gap" not in summary(dataclasses.replace(made, joints=(closed, made.joints[1])))
    left = dataclasses.replace(made.unexplained, structured=True, joint="j1")
    assert "may be no gap" not in summary(dataclasses.replace(made, joints=(first, made.joints[1]), unexplained=left))


@pytest.mark.parametrize("verdict", ["explained", "partly_explained", "unknown"])
def test_what_changes_within_tolerance_carry_is_in_the_sentence_of_the_verdict(made_up, verdict):
    # By hand: 98.4 % are closed, 25 % of them by the finding.
    text = " ".join(summary(dataclasses.replace(carried_by_tolerances(made_up), verdict=verdict)).split())
    assert "Changes within the tolerances close 73 % of the gap. The change of link2 mass ends at the limit" in text
    assert "98 % (97 to 99 %) of the gap is closed (25 % by the findings), most on" in text


def test_what_findings_carry_alone_needs_no_word_on_tolerances(made_up):
    made = carried_by_tolerances(made_up)
    finding = dataclasses.replace(made.findings[0], share=0.97)
    text = summary(dataclasses.replace(made, findings=(finding,)))
    assert "carry" not in text
    assert "by the findings" not in text


def test_without_a_gap_there_is_no_line_about_it(made_up):
    assert "of the gap is closed" not in summary(made_up(findings=0))


@pytest.mark.parametrize(("count", "more"), [(3, ""), (4, "  1 more in the report."), (9, "  6 more in the report.")])
def test_at_most_five_notes_are_shown(made_up, count, more):
    # Five in all: a warning, what moved within tolerance, then notes.
    text = summary(dataclasses.replace(made_up(), notes=tuple(f"Number {k}." for k in range(count))))
    shown = [line for line in text.splitlines() if line.startswith(("  Note:", "  Warning:", "  1 modelled"))]
    assert len(shown) == min(count + 2, 5)
    assert text.splitlines()[-1] == (more or f"  Note: Number {count - 1}.")


@pytest.mark.parametrize(
    ("count", "more"), [(20, None), (90, "70 more in the report and in diagnosis.json (--out DIR).")]
)
def test_at_most_twenty_findings_are_listed_and_the_others_counted(made_up, count, more):
    findings = tuple(dataclasses.replace(made_up().findings[0], joint=f"j{k}") for k in range(count))
    text = summary(dataclasses.replace(made_up(), findings=findings))
    assert "  20. " in text
    assert "  21. " not in text
    assert ("more in the report" in text) == bool(more)
    assert more is None or more in text


def test_warnings_are_shown_before_notes(made_up):
    many = dataclasses.replace(made_up(), notes=("A note.",) * 9, data_warnings=tuple(f"w{k}" for k in range(5)))
    assert summary(many).count("Warning: ") == 5


def test_of_many_sizes_only_those_that_differ_from_nothing_are_listed(made_up):
    # By hand: 3, 40 and 2.5 deviations differ, 0.5 and 1 do not.
    made = made_up(findings=1)
    sizes = {"m": (0.3, 0.1), "mx": (0.05, 0.1), "my": (4.0, 0.1), "mz": (0.1, 0.1), "Ixx": (0.25, 0.1)}
    parameters = {f"arm.{name}": Value(*size, "kg m^2") for name, size in sizes.items()}
    many = dataclasses.replace(made.findings[0], effect="inertial_parameters", parameters=parameters)
    text = " ".join(summary(dataclasses.replace(made, findings=(many,))).split())
    assert (
        ": arm.m 0.30 ± 0.10 kg m^2, arm.my 4.00 ± 0.10 kg m^2, arm.Ixx 0.25 ± 0.10 kg m^2, 2 more in the report; "
    ) in text


def test_many_sizes_that_do_not_differ_from_nothing_are_counted(made_up):
    made = made_up(findings=1)
    parameters = {f"arm.{name}": Value(0.1, 0.1, "kg") for name in "abcde"}
    many = dataclasses.replace(made.findings[0], effect="inertial_parameters", parameters=parameters)
    assert "on joint j1: 5 sizes in the report; " in " ".join(
        summary(dataclasses.replace(made, findings=(many,))).split()
    )


def test_the_files_of_a_folder_are_reported_together_and_any_other_alone():
    out = Path("report")
    lines = written_lines([out / "diagnosis.json", out / "report.html", Path("d.json")], out)
    assert lines == ["wrote report: diagnosis.json, report.html", "wrote d.json"]
