"""An effect joins the catalogue with one file and one line, and what goes through all effects has it.

Oracle: the tests themselves, run in a copy of the checkout to which quadratic drag was added in this way.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from phantom_dyn.effects.catalogue import EFFECTS
from places import CHECKOUT

pytestmark = pytest.mark.whole

NAME = "quadratic_drag"
FILE = CHECKOUT / "tests" / "common" / f"{NAME}.py"
LINE = "    QuadraticDrag(),\n"
# All that goes through the catalogue, but simulations and diagnoses: those take minutes.
GOING_THROUGH_ALL = (
    "tests/phantom_dyn/effects/test_catalogue.py",
    "tests/phantom_dyn/effects/test_relations.py",
    "tests/identification/diagnosis/law/test_law_library.py",
    "tests/identification/diagnosis/columns/test_structure.py",
    "tests/identification/diagnosis/columns/test_terms.py",
    "tests/identification/scenarios/test_changes.py",
    "tests/identification/words",
    "tests/benchmarks/test_blind_tables.py",
    "tests/test_effect_imports.py",
    "tests/docs/test_site.py::test_the_reference_of_effects_has_the_law_and_the_ranges_of_each",
    "tests/docs/test_site.py::test_the_table_of_effects_has_what_each_is_in_the_order_of_the_catalogue",
    "tests/docs/test_site.py::test_the_modules_and_names_that_other_snippets_import_exist",
)
# Of these only what is about the effect itself: the rest is the same with it and without.
OF_THE_EFFECT = (
    "tests/identification/degrade/test_degraded_log.py",
    "tests/identification/reporting/page/test_explaining.py",
    "tests/phantom_dyn/effects/support/test_changed_robots.py",
    "tests/phantom_dyn/simulation/compiled/test_compiled_simulation.py",
)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory) -> Path:
    """A copy of the checkout with one file and one line more."""
    copy = tmp_path_factory.mktemp("checkout")
    for name in ("phantom_dyn", "identification", "benchmarks", "tests", "docs", "examples", "urdf"):
        shutil.copytree(CHECKOUT / name, copy / name, ignore=shutil.ignore_patterns("_build", "generated", "cases"))
    for name in ("pyproject.toml", "README.md", "CONTRIBUTING.md", "CHANGELOG.md"):
        shutil.copy2(CHECKOUT / name, copy / name)
    shutil.copy2(FILE, copy / "phantom_dyn" / "effects" / "friction" / FILE.name)
    catalogue = copy / "phantom_dyn" / "effects" / "catalogue.py"
    text = catalogue.read_text()
    imported = f"from phantom_dyn.effects.friction.{NAME} import QuadraticDrag\n"
    text = text.replace("from phantom_dyn.effects.load", f"{imported}from phantom_dyn.effects.load", 1)
    (last,) = re.findall(r"EFFECTS: .*?\n\)\n", text, flags=re.DOTALL)
    catalogue.write_text(text.replace(last, last.removesuffix(")\n") + LINE + ")\n"))
    return copy


def said_by_pytest(checkout: Path, *words: str) -> str:
    """What pytest says in the copy."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "-rpfE", *words]
    done = subprocess.run(command, cwd=checkout, capture_output=True, text=True, env=dict(os.environ))
    bad = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR", "E  "))]
    assert done.returncode == 0, "\n".join(bad) + done.stderr[-2000:]
    return done.stdout


@pytest.mark.nightly
def test_what_goes_through_all_effects_passes_with_it(checkout):
    out = said_by_pytest(checkout, *GOING_THROUGH_ALL)
    # It was there: the tests that have each effect as a case have it.
    assert len(re.findall(rf"^PASSED .*\[.*{NAME}.*\]", out, flags=re.MULTILINE)) > 4


def test_it_is_simulated_degraded_and_drawn_as_the_others_are(checkout):
    out = said_by_pytest(checkout, *OF_THE_EFFECT, "-k", NAME)
    assert {line.split("::")[0].removeprefix("PASSED ") for line in out.splitlines() if line.startswith("PASSED")} == {
        *OF_THE_EFFECT
    }


def test_the_catalogue_of_this_version_does_not_have_it():
    assert NAME not in {effect.name for effect in EFFECTS}
