"""The page on the architecture names what the packages have. Oracle: their files and what these define."""

import ast
import re
from pathlib import Path

import pytest

from places import CHECKOUT

PAGE = (CHECKOUT / "docs" / "architecture.md").read_text()
PACKAGES = ("phantom_dyn", "identification")
FILES = [path for package in PACKAGES for path in (CHECKOUT / package).rglob("*.py")]
PLACES = {
    place.relative_to(CHECKOUT) for file in FILES for place in (file, *file.parents) if place.is_relative_to(CHECKOUT)
}
TOP_FOLDERS = sorted(path.parent.name for package in PACKAGES for path in (CHECKOUT / package).glob("*/__init__.py"))


def defined(file: Path) -> set[str]:
    """Functions, classes and constants of a module."""
    nodes = list(ast.walk(ast.parse(file.read_text())))
    names = {node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    return names | {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}


def ends_with(place: Path, said: str) -> bool:
    """True if the path ends with these parts."""
    parts = Path(said).parts
    return place.parts[-len(parts) :] == parts


DIAGRAM = "".join(re.findall(r"^```mermaid\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE))
PROSE = re.sub(r"^```.*?^```", "", PAGE, flags=re.DOTALL | re.MULTILINE)
QUOTED = sorted(set(re.findall(r"`([^`\n]+)`", PROSE)))
PATHS = [said for said in QUOTED if re.fullmatch(r"[\w/.]+(/|\.py)", said)]
NAMES = [said for said in QUOTED if re.fullmatch(r"\w+", said)]
DRAWN = re.findall(r"\w+\.py", DIAGRAM)


@pytest.mark.parametrize("said", sorted({*PATHS, *DRAWN}))
def test_every_file_and_folder_that_the_page_names_is_there(said):
    assert any(ends_with(place, said) for place in PLACES) or (CHECKOUT / said).exists()


def test_every_name_in_the_prose_is_defined():
    known = {name for file in FILES for name in defined(file)} | {part for place in PLACES for part in place.parts}
    assert set(NAMES) <= known


def test_every_top_folder_is_in_the_diagram():
    assert set(TOP_FOLDERS) - set(re.findall(r"\w+", DIAGRAM)) == set()
