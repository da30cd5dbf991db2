"""Comparison of diagnoses: text, page and figures."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from html_page import Page
from identification.cli.main import main
from identification.diagnosis.result import EffectAt, NotTestable, Rival, Value
from identification.experiments.transmission import blocked_arm_loop, fit_transmission, triangular_torque
from identification.reporting.comparison import compare, comparison_text, distinct_names
from identification.reporting.comparison_page import comparison_page
from identification.reporting.experiment_figures import stiffness_figure
from identification.reporting.stored.diagnosis_files import json_text
from phantom_dyn.errors import ParameterError


def with_size(diagnosis, value, std):
    """The diagnosis with another size of its first finding."""
    first = replace(diagnosis.findings[0], parameters={"torque": Value(value, std, "N m")})
    return replace(diagnosis, findings=(first, *diagnosis.findings[1:]))


def test_a_diagnosis_has_not_changed_against_itself(made_up):
    found = compare([made_up(findings=3), made_up(findings=3)], ["a", "b"])
    assert found.changed == ()
    assert len(found.findings) == 3
    assert "None of 3 findings changed." in comparison_text(found)


@pytest.mark.parametrize(("other", "changed"), [(1.19, False), (1.21, True)])
def test_one_size_changed_if_it_differs_by_more_than_chance_explains(made_up, other, changed):
    # By hand: 1.96 * sqrt(0.06^2 + 0.08^2) = 0.196 for a single comparison.
    pair = [with_size(made_up(findings=1), 1.0, 0.06), with_size(made_up(findings=1), other, 0.08)]
    assert bool(compare(pair, ["a", "b"]).changed) is changed


@pytest.mark.parametrize(("other", "changed"), [(1.23, False), (1.25, True)])
def test_the_limit_grows_with_the_number_of_sizes(made_up, other, changed):
    # By hand: of three diagnoses three pairs, each at 5/3 %: 2.394 * 0.1 = 0.239.
    sizes = [(1.0, 0.06), (1.0, 0.06), (other, 0.08)]
    several = [with_size(made_up(findings=1), *size) for size in sizes]
    assert bool(compare(several, ["a", "b", "c"]).changed) is changed


def test_two_phases_are_apart_by_less_than_half_a_turn(made_up):
    made = made_up(findings=1)
    phases = [replace(made.findings[0], parameters={"phase": Value(x, 0.05, "rad")}) for x in (3.1, -3.1)]
    found = compare([replace(made, findings=(phase,)) for phase in phases], ["a", "b"])
    assert found.changed == ()


def test_a_size_without_deviation_is_shown_and_not_judged(made_up):
    nan = float("nan")
    found = compare([with_size(made_up(), 1.0, nan), with_size(made_up(), 2.0, nan)], ["a", "b"])
    assert found.findings[0].sizes[0].changed is None
    assert "torque: 1 N m -> 2 N m\n" in comparison_text(found)


def test_a_finding_that_is_gone_is_shown_with_what_would_have_been_seen(made_up):
    before = made_up(findings=1)
    bound = replace(before.bounds[0], effect="coulomb_friction", joint="j1", parameter="torque", unit="N m")
    text = comparison_text(compare([before, replace(made_up(findings=0), bounds=(bound,))], ["a", "b"]))
    assert "The verdict changed: explained -> no gap." in text
    line = "torque: 0.2510 (0.2498 to 0.2522) N m -> not found (a torque of 0.002 N m would have shown)"
    assert line in " ".join(text.split())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: replace(d, minor=d.findings, findings=()), "seen, but too small to matter"),
        (
            lambda d: replace(d, findings=(), not_testable=(NotTestable("coulomb_friction", "j1", "it rests"),)),
            "not testable there",
        ),
        (
            lambda d: replace(
                d,
                findings=(
                    replace(
                        d.findings[0],
                        effect="stribeck_friction",
                        rivals=(Rival((EffectAt("coulomb_friction", "j1"),), 0.3),),
                    ),
                ),
            ),
            "a rival of Stribeck friction on joint j1 (30 %)",
        ),
        (lambda d: replace(d, findings=()), "not found"),
    ],
)
def test_it_says_why_a_finding_is_not_there(made_up, change, said):
    made = made_up(findings=1)
    text = comparison_text(compare([made, change(made)], ["a", "b"]))
    assert f"-> {said}" in " ".join(text.split())


def test_the_table_has_the_residual_of_every_joint_in_every_diagnosis(made_up):
    text = comparison_text(compare([made_up(), made_up()], ["a", "b"]))
    assert ["j2", "0.125", "->", "0.0155", "0.125", "->", "0.0155", "N", "m"] in [
        line.split() for line in text.splitlines()
    ]


def test_no_line_is_longer_than_100_columns(made_up):
    names = tuple(f"joint_{'x' * 40}_{k}" for k in range(2))
    text = comparison_text(compare([made_up(names, 3), made_up(names, 0)], ["a" * 80, "b" * 80]))
    assert max(map(len, text.splitlines())) <= 100


def test_diagnoses_of_other_joints_are_refused(made_up):
    with pytest.raises(ParameterError, match="a is of the joints j1, j2 and b of j1: give diagnoses of one robot"):
        compare([made_up(), made_up(("j1",))], ["a", "b"])


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["x/a/diagnosis.json", "x/b/diagnosis.json"], ["a", "b"]),
        (["x/a/diagnosis.json", "y/a/diagnosis.json"], ["x/a", "y/a"]),
        (["old.json", "new.json"], ["old.json", "new.json"]),
        (["diagnosis.json", "a/diagnosis.json"], [".", "a"]),
    ],
)
def test_names_are_short_and_differ(paths, names):
    assert distinct_names(paths) == names


def test_the_command_compares_files(made_up, tmp_path, capsys):
    for name, count in (("a", 1), ("b", 2)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "diagnosis.json").write_text(json_text(made_up(findings=count)))
    assert main(["compare", str(tmp_path / "a"), str(tmp_path / "b" / "diagnosis.json")]) == 0
    said = capsys.readouterr().out
    assert "1 of 2 findings changed." in said
    assert "Viscous friction on joint j2, coefficient: not found -> 0.130 (0.089 to 0.171) N m s/rad" in said


def test_the_command_wants_two(capsys, tmp_path):
    assert main(["compare", str(Path(tmp_path) / "a.json")]) == 2
    assert "was given alone, wanted two diagnoses or more" in capsys.readouterr().err


@pytest.fixture
def grown(made_up):
    """Page of two diagnoses whose friction doubled."""
    pair = [with_size(made_up(findings=1), 1.0, 0.06), with_size(made_up(findings=1), 2.0, 0.06)]
    return comparison_page(compare(pair, ["<before>", "after"]))


def test_the_table_says_what_changed_with_intervals(grown):
    row = re.search(r"<tr><td>Coulomb friction on joint j1, torque</td>(.*?)</tr>", grown)
    assert row is not None
    # By hand: 1.96 * 0.06 = 0.118.
    cells = re.findall(r"<td>(.*?)</td>", row[1])
    assert cells == ["1.00 (0.88 to 1.12) N m", "2.00 (1.88 to 2.12) N m", "changed"]


def test_a_size_has_a_figure_with_its_unit_and_the_names_of_the_diagnoses(grown):
    assert "torque [N m]" in grown
    assert re.findall(r">(&lt;before&gt;|after)</text>", grown)[:2] == ["&lt;before&gt;", "after"]


def test_what_changed_is_orange_and_what_did_not_is_blue(made_up, grown):
    same = comparison_page(compare([made_up(findings=1)] * 2, ["a", "b"]))
    sizes = [re.search(r"<h2>Sizes</h2>(.*)<h2>", page, re.DOTALL) for page in (grown, same)]
    assert [("#d55e00" in part[0], "#0072b2" in part[0]) for part in sizes if part] == [(True, False), (False, True)]


def test_the_page_is_whole_and_runs_nothing(grown):
    assert Page(grown).open == []  # it fails at a tag that closes another
    assert not re.search(r"<script|https?://(?!www\.w3\.org)|<before>", grown)


def test_a_missing_finding_has_a_bar_up_to_what_would_have_been_seen(made_up):
    before = made_up(findings=1)
    bound = replace(
        before.bounds[0], effect="coulomb_friction", joint="j1", parameter="torque", unit="N m", below=0.123
    )
    page = comparison_page(compare([before, replace(made_up(findings=0), bounds=(bound,))], ["a", "b"]))
    assert "<p>b: not found (a torque of 0.123 N m would have shown)</p>" in page
    assert 'stroke="#808080"' in page


def test_a_list_of_sizes_has_a_curve_for_each_entry(made_up):
    orders = {"amplitude": Value([1.0, 2.0], [0.1, 0.1], "N m")}
    first = replace(made_up(findings=1).findings[0], effect="cogging", parameters=orders)
    page = comparison_page(compare([replace(made_up(findings=1), findings=(first,))] * 2, ["a", "b"]))
    sizes = re.search(r"<h2>Sizes</h2>(.*)<h2>", page, re.DOTALL)
    assert sizes is not None
    assert sizes[0].count("</title></g>") == 4


def test_the_command_writes_the_page(tmp_path, made_up, capsys):
    for name in ("a", "b"):
        (tmp_path / f"{name}.json").write_text(json_text(made_up()))
    out = tmp_path / "changes.html"
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json"), "--out", str(out)]) == 0
    assert f"wrote {out}" in capsys.readouterr().out
    assert "<h1>What changed: a.json and b.json</h1>" in out.read_text()


def test_a_folder_is_no_place_for_the_page(tmp_path, made_up, capsys):
    (tmp_path / "a.json").write_text(json_text(made_up()))
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "a.json"), "--out", str(tmp_path)]) == 2
    assert "is a folder, wanted a file" in capsys.readouterr().err


@pytest.mark.parametrize("count", [1, 4])
def test_no_recording_hides_another(count):
    """Four in two rows of three panels: two are left empty."""
    loops = []
    for frequency in (0.5, 0.7, 0.9, 1.1)[:count]:
        t = np.arange(0.0, 3 / frequency, 0.005)
        torque = triangular_torque(t, 1.5, frequency)
        loops.append(blocked_arm_loop(t, torque, stiffness=2000.0, damping=0.0, coulomb=0.12))
    figure = stiffness_figure("q2", loops, fit_transmission(loops, cutoff_hz=20.0))
    assert len(figure.axes) == count
    for ax, loop in zip(figure.axes, loops, strict=True):
        np.testing.assert_array_equal(ax.lines[0].get_ydata(), loop.torque)
        assert ax.get_xlim() == figure.axes[0].get_xlim()
