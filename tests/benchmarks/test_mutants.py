"""Mutation testing and kills of running commands."""

import json
import os
from pathlib import Path

import pytest

from benchmarks import kills
from benchmarks.mutant_sample import AREAS, CHECKOUT, left_out, worth_trying
from benchmarks.mutants import covering, wilson

SOURCE = """\
from x import property
def f(a: int | None, b=1 + 2) -> int | None:
    raise ValueError(f"{a + 1} is wrong")
class A:
    @property(1 + 2)
    def g(self):
        c: int | str = 3 - 4
        return c
"""


@pytest.mark.parametrize(
    ("killed", "tried", "low", "high"),
    # Brown, Cai and DasGupta (2001): (p + z^2/2n +- z sqrt(p q / n + z^2 / 4 n^2)) / (1 + z^2 / n), by hand.
    [(0, 10, 0.0, 0.27753), (10, 10, 0.72247, 1.0), (5, 10, 0.23659, 0.76341), (0, 0, 0.0, 1.0)],
)
def test_the_interval_is_that_of_wilson(killed, tried, low, high):
    assert wilson(killed, tried) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(
    ("line", "text", "out"),
    [
        (2, "| None, b", True),
        (2, "+ 2", False),
        (2, "| None:", True),
        (3, "+ 1", True),
        (5, "+ 2", True),
        (7, "| str", True),
        (7, "- 4", False),
    ],
    ids=["argument", "default", "result", "message", "decorator", "variable", "value"],
)
def test_annotations_texts_and_decorators_are_no_mutants(line, text, out):
    assert left_out(SOURCE)(line, SOURCE.splitlines()[line - 1].index(text)) is out


@pytest.mark.parametrize(
    ("operator", "tried"),
    [
        ("ReplaceBinaryOperator_Add_Sub", True),
        ("ReplaceBinaryOperator_Mul_RShift", False),
        ("ReplaceBinaryOperator_Add_BitAnd", False),
        ("ReplaceBinaryOperator_BitAnd_BitOr", True),
        ("ReplaceBinaryOperator_BitOr_Add", False),
        ("ReplaceComparisonOperator_Lt_LtE", True),
        ("ReplaceComparisonOperator_Lt_IsNot", False),
        ("ReplaceComparisonOperator_Is_IsNot", True),
        ("NumberReplacer", True),
        ("RemoveDecorator", False),
    ],
)
def test_a_change_that_fails_by_its_type_alone_is_no_mutant(operator, tried):
    assert worth_trying(operator) is tried


@pytest.mark.parametrize("area", AREAS, ids=lambda area: area.code)
def test_every_area_is_there_and_has_tests(area):
    assert (CHECKOUT / area.code).exists()
    assert covering(area, area.code, CHECKOUT)


def test_tests_named_after_the_changed_file_are_run_first():
    effects = AREAS[0]
    first = covering(effects, "phantom_dyn/effects/friction/joint_coupling.py", CHECKOUT)[0]
    assert first == "tests/phantom_dyn/effects/friction/test_joint_coupling.py"


def test_an_effect_is_covered_by_the_tests_of_its_folder_and_of_no_folder():
    effects = AREAS[0]
    found = covering(effects, "phantom_dyn/effects/friction/joint_coupling.py", CHECKOUT)
    assert {Path(file).parent.name for file in found} == {"friction", "effects"}
    everything = covering(effects, "phantom_dyn/effects/support/rows.py", CHECKOUT)
    assert {Path(file).parent.name for file in everything} > {"friction", "effects", "drive", "support"}


RUN, OTHER = "0" * 32, "1" * 32


@pytest.mark.nightly
@pytest.mark.whole
def test_runs_killed_at_random_moments_leave_nothing_broken(tmp_path):
    tally = kills.killed(3, 3, tmp_path)
    assert tally.wrong == []
    assert sum(tally.kills.values()) == 3


@pytest.fixture
def folder(tmp_path):
    """A set of files of one run."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "diagnosis.json").write_text(json.dumps({"run": RUN, "next_experiment": None}))
    (out / "report.html").write_text(f"<html></html>\n<!-- run: {RUN} -->\n")
    (out / "corrected.yaml").write_text(f"a: 1\n# run: {RUN}\n")
    (out / "mine.txt").write_text("what I noted\n")
    (tmp_path / "tmp").mkdir()
    return tmp_path


OTHERS_MOTION = json.dumps({"run": RUN, "next_experiment": {"reference_sha256": "another"}})


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, []),
        (
            {"corrected.yaml": f"a: 1\n# run: {OTHER}\n"},
            ["mixed: out: corrected.yaml are not of the run of diagnosis.json"],
        ),
        (
            {"next.csv": "t\n0\n", "diagnosis.json": OTHERS_MOTION},
            ["mixed: out: next.csv are not of the run of diagnosis.json"],
        ),
        ({"report.html": None}, ["broken: out lacks report.html"]),
    ],
    ids=["whole", "a file of another run", "a motion of another run", "a file is missing"],
)
def test_a_set_is_right_whose_files_are_all_there_and_of_one_run(folder, files, said):
    for name, text in files.items():
        path = folder / "out" / name
        path.unlink() if text is None else path.write_text(text)
    assert kills.wrong_set(folder / "out") == said


def test_half_a_file_is_seen(folder):
    (folder / "out" / "diagnosis.json").write_text('{"run": ')
    assert kills.wrong_set(folder / "out")[0].startswith("broken: out")


def test_litter_is_seen(folder):
    (folder / "out" / f".a.12{kills.MARK}.json").write_text("")
    (folder / "tmp" / "tmpabc").write_text("")
    assert len(kills.litter(folder)) == 2


def test_a_process_is_known_by_its_token(monkeypatch):
    assert kills.alive("nobody has this") == []
    pipe = kills.subprocess.PIPE
    child = kills.subprocess.Popen(["cat"], env={**os.environ, "PHANTOM_DYN_KILLS": "mine"}, stdin=pipe, stdout=pipe)
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        # What it gives back shows that it runs: while a program is being loaded, its environment is empty.
        child.stdin.write(b"1")
        child.stdin.flush()
        child.stdout.read(1)
        assert kills.alive("mine") == [child.pid]
    finally:
        child.kill()
        child.communicate()
