"""The documentation: every snippet runs, every command is one that the program understands, and the site builds."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shlex
import subprocess
import sys

import pytest

from called_example import printed
from identification.cli.main import COMMANDS
from phantom_dyn.effects.catalogue import EFFECTS
from places import CHECKOUT

# What the snippets call has tests of its own, which check its annotations.
pytestmark = pytest.mark.whole

DOCS = CHECKOUT / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if not {"_build", "generated"} & set(page.relative_to(DOCS).parts))


def names(pages):
    return [str(page.relative_to(CHECKOUT)) for page in pages]


def snippets(page):
    return re.findall(r"^```python\n(.*?)^```", page.read_text(), flags=re.DOTALL | re.MULTILINE)


def scripts(page):
    """Scripts of examples/ that the lesson begins with, each with its words."""
    lines = re.findall(r"^```\npython examples/(.*)\n```", page.read_text(), flags=re.MULTILINE)
    return [line.split() for line in lines]


# Lessons are whole; the snippets of other pages stand for files and clusters of the reader.
LESSONS = [page for page in PAGES if page.parent.name in ("tutorials", "how_to") and snippets(page)]
OTHERS = [page for page in PAGES if page not in LESSONS and snippets(page)]
# An arm of six joints: its diagnosis takes longest.
LONG = {"ur_rtde"}


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.nightly if page.stem in LONG else ()) for page in LESSONS],
    ids=names(LESSONS),
)
def test_the_python_of_a_page_runs_and_says_the_truth(page, tmp_path, monkeypatch, request):
    # Known truth: the assertions in the snippets themselves, on simulated recordings; of real ones, what is published.
    if "datasets.fetch" in page.read_text():
        monkeypatch.setenv("PHANTOM_DYN_DATA", str(request.getfixturevalue("data_folder")))
    monkeypatch.chdir(tmp_path)
    for script, *words in scripts(page):
        printed(script, *words)
    here = {}
    for snippet in snippets(page):
        exec(snippet, here)
    assert any(isinstance(node, ast.Assert) for text in snippets(page) for node in ast.walk(ast.parse(text)))


@pytest.mark.parametrize("page", OTHERS, ids=names(OTHERS))
def test_the_modules_and_names_that_other_snippets_import_exist(page):
    # Oracle: Python's own import.
    for snippet in snippets(page):
        for node in ast.walk(ast.parse(snippet)):
            if isinstance(node, ast.ImportFrom) and node.module:
                module = importlib.import_module(node.module)
                assert all(hasattr(module, alias.name) for alias in node.names)


def commands(page):
    """Lines of the blocks of a page that call the program, without their remarks."""
    blocks = re.findall(r"^```\n(.*?)^```", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    return [line.partition(" #")[0].partition(" > ")[0] for line in lines if line.startswith("phantom-dyn ")]


EVERY = [CHECKOUT / "README.md", *PAGES]
WITH_COMMANDS = [page for page in EVERY if commands(page)]


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=names(WITH_COMMANDS))
def test_the_commands_of_a_page_are_understood(page):
    # Oracle: the parser of each command, which ends the process where a word that it needs is missing.
    for line in commands(page):
        _, name, *words = shlex.split(line)
        _, left = importlib.import_module(COMMANDS[name][0]).parser().parse_known_intermixed_args(words)
        assert left == [], line


def test_every_page_is_in_the_table_of_contents():
    listed = re.findall(r"^([a-z0-9_/]+)$", (DOCS / "index.md").read_text(), flags=re.MULTILINE)
    pages = {str(page.relative_to(DOCS).with_suffix("")) for page in PAGES} - {"index"}
    assert pages | {"reference/python", "generated/commands", "generated/effects", "generated/keys"} == set(listed)


def test_the_reference_of_effects_has_the_law_and_the_ranges_of_each(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("generated_pages").effects_page()
    for effect in EFFECTS:
        assert f"\n{effect.name}\n{'-' * len(effect.name)}\n" in f"\n{page}"
    assert page.count(".. list-table::") == len(EFFECTS) + 1


def test_the_table_of_effects_has_what_each_is_in_the_order_of_the_catalogue(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("generated_pages").effects_page()
    assert re.findall(r"^   \* - `(\w+)`_$", page, flags=re.MULTILINE) == [effect.name for effect in EFFECTS]
    # By hand, from the law.
    assert "   * - `viscous_friction`_\n     - Viscous friction: ``torque = -c v``.\n     - ``coefficient``\n" in page
    assert "     - ``order``, ``amplitude``, ``phase``: lists\n" in page


def test_the_reference_of_commands_has_the_help_of_each(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("generated_pages").commands_page()
    assert all(f"   usage: phantom-dyn {name}" in page for name in COMMANDS)


def test_the_site_builds_without_a_warning_and_fetches_nothing(tmp_path):
    # Oracle: Sphinx itself, with every warning an error.
    pytest.importorskip("sphinx", reason="sphinx comes with make setup")
    pytest.importorskip("furo", reason="furo comes with make setup")
    pytest.importorskip("myst_parser", reason="myst-parser comes with make setup")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", str(DOCS), str(tmp_path)]
    environment = os.environ | {"PYTHONWARNINGS": ""}
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    pages = "".join(path.read_text() for path in tmp_path.rglob("*.html"))
    parts = re.findall(r"<(?:script|img|iframe|link)\b[^>]*>", pages)
    assert [part for part in parts if re.search(r"(?:src|href)=\"(?:https?:)?//", part)] == []
    assert 'id="phantom_dyn.diagnose"' in pages
