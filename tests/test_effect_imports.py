"""Nobody outside `phantom_dyn.effects` knows single effects, so that a new one is one file and a line in the list."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import identification
import phantom_dyn
from phantom_dyn.effects.catalogue import EFFECTS

ROOTS = [Path(str(package.__file__)).parent for package in (phantom_dyn, identification)]
INSIDE = ROOTS[0] / "effects"
OUTSIDE = sorted(file for root in ROOTS for file in root.rglob("*.py") if not file.is_relative_to(INSIDE))
# One folder a kind of effect, with nothing else in it.
FOLDERS = {type(effect).__module__.rpartition(".")[0] for effect in EFFECTS}
# Who may import a law, and why.
IMPORTS = {
    # Cheap haptic hardware is made of these laws: they stand in one place, whatever uses them.
    "phantom_dyn/haptics/cheap/cheap_hardware.py": {
        "phantom_dyn.effects.drive.torque_saturation",
        "phantom_dyn.effects.friction.presliding_friction",
    },
    # A load that an earlier diagnosis found is carried by the given model, so that it may be taken off again.
    "identification/diagnosis/columns/operations.py": {"phantom_dyn.effects.load.payload"},
}
# Who may ask whether an effect is a certain one, and why.
NAMES = {
    # A load of an earlier diagnosis is a body of the given model, see above.
    "identification/diagnosis/columns/operations.py": {"payload"},
    # At rest nothing but play and elasticity shows, by a law of that scenario's own.
    "identification/scenarios/at_rest/diagnose_at_rest.py": {"backlash"},
    # Positions alone show the product of the first and a controller's gain, and of the second no more than its sum with
    # a gain that is estimated, so that scenario makes no claim on them. The third is the zero of a reference as well.
    "identification/scenarios/gain_ambiguities.py": {"torque_constant", "viscous_friction", "torque_offset"},
    # A controller's damping gain gives back viscous friction, and no other effect.
    "identification/scenarios/gain_or_load.py": {"viscous_friction"},
}


def name_of(file: Path) -> str:
    return str(file.relative_to(ROOTS[0].parent))


def imported(tree: ast.AST) -> Iterator[str]:
    """Modules that a file imports, inside functions too; of a package the names that are taken from it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))


def concrete(tree: ast.AST) -> set[str]:
    """Imported modules that are one effect each."""
    return {name for name in imported(tree) if name.rpartition(".")[0] in FOLDERS}


def compared(tree: ast.AST) -> set[str]:
    """Names of the catalogue with which a file compares the name of an effect."""
    known, out = {effect.name for effect in EFFECTS}, set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            parts = [part for side in (node.left, *node.comparators) for part in ast.walk(side)]
            asked = {getattr(part, "attr", getattr(part, "id", "")) for part in parts}
            if asked & {"effect", "effects"}:
                out |= {part.value for part in parts if isinstance(part, ast.Constant) and part.value in known}
    return out


def test_no_module_imports_or_asks_for_a_single_effect():
    offenders = {}
    for file in OUTSIDE:
        name, tree = name_of(file), ast.parse(file.read_text(encoding="utf-8"))
        found = concrete(tree) - IMPORTS.get(name, set()) | compared(tree) - NAMES.get(name, set())
        if found:
            offenders[name] = found
    assert offenders == {}


@pytest.mark.parametrize("file", sorted({*IMPORTS, *NAMES}))
def test_no_exception_outlives_its_need(file):
    tree = ast.parse((ROOTS[0].parent / file).read_text(encoding="utf-8"))
    assert concrete(tree) == IMPORTS.get(file, set())
    assert compared(tree) == NAMES.get(file, set())


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("from phantom_dyn.effects.drive.cogging import Cogging", {"phantom_dyn.effects.drive.cogging"}),
        ("def f():\n    from phantom_dyn.effects.drive import cogging", {"phantom_dyn.effects.drive.cogging"}),
        ("import phantom_dyn.effects.load.payload as p", {"phantom_dyn.effects.load.payload"}),
        ("from phantom_dyn.effects.support.rows import row_of", set()),
    ],
)
def test_an_import_is_seen_wherever_it_stands(text, found):
    assert concrete(ast.parse(text)) == found
