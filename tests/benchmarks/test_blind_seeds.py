"""Which seeds are drawn, diagnosed, scored and published: by default the reporting ranges."""

from __future__ import annotations

import pytest

from benchmarks.blind import generate, publish, run
from benchmarks.blind.generate import REPORTING, case_ids, chosen_batches, draw_many, main, parser, seed_range
from benchmarks.gapbench.generator.case import draw_case, resolved_kind
from benchmarks.gapbench.makes import NoCase


def test_one_seed_is_a_range_of_one():
    assert seed_range("7") == range(7, 8)


@pytest.mark.parametrize("text", ["5:3", "a", "-2:4", "3:3"])
def test_seeds_that_are_no_range_are_refused(text, capsys):
    with pytest.raises(SystemExit):
        main([f"--seeds={text}", "--cases", "x", "--answers", "y"])
    assert "are no seeds: give FIRST:END" in capsys.readouterr().err


def test_without_seeds_the_reporting_ranges_are_written():
    given = parser().parse_args(["--cases", "x", "--answers", "y"])
    assert dict(chosen_batches(given)) == REPORTING


def test_ranges_of_several_kinds_are_chosen_together():
    given = parser().parse_args(["--singles", "0:9", "--outside", "3", "--cases", "x", "--answers", "y"])
    assert chosen_batches(given) == [("single", range(9)), ("outside", range(3, 4))]


def test_reporting_starts_behind_every_seed_that_was_opened_before():
    assert min(seeds[0] for seeds in REPORTING.values()) >= 11000
    assert {kind: len(seeds) for kind, seeds in REPORTING.items()} == {
        "single": 250,
        "null": 300,
        "pair": 80,
        "outside": 80,
    }


# Of two kinds at once; each of these seeds names one case.
SEEDS = ["--singles", "100:140", "--nulls", "100:120", "--pairs", "7", "--outside", "0:2"]
BATCHES = [("single", range(100, 140)), ("null", range(100, 120)), ("pair", range(7, 8)), ("outside", range(2))]


def test_the_run_takes_the_seeds_of_every_kind():
    assert chosen_batches(run.parser().parse_args(SEEDS)) == BATCHES


def test_the_run_takes_the_reporting_ranges_where_nothing_is_asked_for():
    assert dict(chosen_batches(run.parser().parse_args([]))) == REPORTING


def test_seeds_without_a_kind_are_mixed_and_come_before_those_of_a_kind():
    given = run.parser().parse_args(["--nulls", "3", "--seeds", "0:9"])
    assert chosen_batches(given) == [("mixed", range(9)), ("null", range(3, 4))]


def test_seeds_may_be_given_with_their_kind():
    assert chosen_batches(run.parser().parse_args(["--kind", "pair", "--seeds", "0:9"])) == [("pair", range(9))]


def test_a_kind_without_seeds_is_no_restriction():
    """The help says of --kind: of --seeds."""
    assert dict(chosen_batches(run.parser().parse_args(["--kind", "pair"]))) == REPORTING


@pytest.mark.parametrize("option", ["--seeds", "--singles", "--nulls", "--pairs", "--outside"])
@pytest.mark.parametrize("command", [generate.parser, run.parser])
def test_every_command_refuses_seeds_that_are_no_range(command, option, capsys):
    with pytest.raises(SystemExit) as stopped:
        command().parse_args([f"{option}=9:3"])
    assert stopped.value.code == 2
    assert f"argument {option}: '9:3' are no seeds: give FIRST:END" in capsys.readouterr().err


def test_what_is_run_is_what_is_published(tmp_path, monkeypatch):
    """The command line of the run, given to the publishing command, names the same seeds."""
    published = []
    monkeypatch.setattr(publish, "publish", lambda score, batches, checkout: published.append((score, batches)))
    publish.main(["--score", str(tmp_path), *SEEDS])
    assert published == [(tmp_path, BATCHES)]


def test_the_id_of_a_case_is_known_without_drawing_it():
    assert case_ids([("single", range(12, 13))]) == [draw_case(12, "single").id]


def test_a_case_that_is_asked_for_twice_is_listed_once():
    """A mixed case is one of its kind: all single seeds of the mixed ones are among the single ones."""
    singles = [seed for seed in range(20) if resolved_kind(seed, "mixed") == "single"]
    both = case_ids([("single", range(20)), ("mixed", range(20))])
    assert singles
    assert len(both) == len(set(both)) == 40 - len(singles)


def test_ids_come_in_the_order_of_the_batches():
    assert case_ids(BATCHES) == [name for batch in BATCHES for name in case_ids([batch])]


def test_a_seed_that_gives_no_case_is_told_and_the_others_are_drawn(tmp_path, monkeypatch, capsys):
    # Oracle: a make whose every odd seed gives none.
    def drawn(seed: int, kind: str, cases, answers, make) -> str:
        if seed % 2:
            raise NoCase(f"Seed {seed} gives none: use another seed.")
        return f"c{seed}"

    monkeypatch.setattr("benchmarks.gapbench.cases.draw", drawn)
    assert draw_many(range(4), "pair", tmp_path, tmp_path, 1) == ["c0", "c2"]
    assert capsys.readouterr().err == "Seed 1 gives none: use another seed.\nSeed 3 gives none: use another seed.\n"
