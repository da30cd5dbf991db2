"""The table of all makes: which value is the worst, and nothing without a run."""

import json

import pytest
from scored_by_hand import answer, entry, finding

from benchmarks.blind.score import write_score
from benchmarks.blind.worst import finished, main, scored, worst, worst_of_makes
from benchmarks.gapbench.scoring.figures import FIGURES
from benchmarks.gapbench.scoring.judged import judged
from benchmarks.gapbench.scoring.proportions import Proportion


def figure(name):
    return next(one for one in FIGURES if one.name == name)


def a_run(folder, make, *said):
    """A scored run of one single after another; each is named by ``said``."""
    cases, answers = [], folder / "answers"
    answers.mkdir(parents=True)
    for seed, effect in enumerate(said):
        one = answer("viscous_friction") | {"id": f"{make}{seed}", "seed": seed}
        if make != "mujoco":
            one["make"] = make
        (answers / f"{one['id']}.json").write_text(json.dumps(one))
        cases.append(judged(one, entry(finding(effect))))
    write_score(cases, folder / "score")
    return folder


@pytest.fixture
def runs(tmp_path):
    """Two makes: one is right in one of two singles, the other in both."""
    first = a_run(tmp_path / "blind", "mujoco", "viscous_friction", "coulomb_friction")
    return [first, a_run(tmp_path / "blind-drake", "drake", "viscous_friction", "viscous_friction")]


def row(text, name):
    return [cell.strip() for cell in next(x for x in text.splitlines() if x.startswith(f"| {name} ")).split("|")[1:-1]]


def test_the_least_share_that_is_right_is_the_worst(runs):
    said = row(worst_of_makes([scored(run) for run in runs]), "true effect among the listed ones")
    assert said[2:] == ["50 % (9 to 91)", "100 % (34 to 100)", "mujoco: 50 % (9 to 91)"]


def test_the_largest_share_that_is_wrong_is_the_worst():
    scores = {"a": Proportion(1, 10), "b": Proportion(3, 10)}
    assert worst(figure("false claims on nulls"), scores) == "b: 30 % (11 to 60)"


@pytest.mark.parametrize(("hits", "is_worst"), [(99, True), (93, False)])
def test_the_worst_coverage_is_the_farthest_from_what_is_to_be_reached(hits, is_worst):
    """95 % is within; 99 % is above what is to be reached and 93 % again within, farther from its ends."""
    scores = {"a": Proportion(92, 100), "b": Proportion(hits, 100)}
    assert worst(figure("parameter within its 95 % interval"), scores).startswith("b") == is_worst


def test_a_figure_without_a_run_stays_empty(runs):
    said = row(worst_of_makes([scored(run) for run in runs]), "both effects of a pair")
    assert said[2:] == ["-", "-", ""]


def test_one_make_has_no_worst(runs):
    said = row(worst_of_makes([scored(runs[0])]), "true effect among the listed ones")
    assert said[-1] == ""


def test_cases_of_development_seeds_are_reported_as_such(runs):
    assert row(worst_of_makes([scored(run) for run in runs]), "cases")[2] == "2 single (development)"


def test_a_make_is_not_counted_twice(runs):
    with pytest.raises(ValueError, match="Two runs are of the same make among mujoco, mujoco"):
        worst_of_makes([scored(runs[0]), scored(runs[0])])


def test_a_run_without_a_score_is_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no score: give the folder of a finished run"):
        scored(tmp_path)


def test_finished_runs_are_found_beside_each_other(runs, tmp_path):
    (tmp_path / "blind-field").mkdir()
    assert finished(tmp_path) == runs


def test_the_table_is_written_where_it_is_asked_for(runs, tmp_path, capsys):
    main([*map(str, runs), "--out", str(tmp_path / "out.md")])
    assert (tmp_path / "out.md").read_text() == capsys.readouterr().out
