"""No stage reads the sentence of another. Oracle: the syntax trees of all modules."""

import ast
from pathlib import Path

import pytest

import identification

ROOT = Path(identification.__file__).parent
PARSERS = {
    "startswith",
    "endswith",
    "removeprefix",
    "removesuffix",
    "partition",
    "rpartition",
    "split",
    "find",
    "index",
}
SAID = {
    "note",
    "notes",
    "warning",
    "warnings",
    "sentence",
    "sentences",
    "hides",
    "said",
    "remark",
    "data_warnings",
}


def said(node: ast.expr) -> bool:
    """True of a variable or an attribute that holds a note, a warning or their sentences, or an element of one."""
    while isinstance(node, ast.Subscript):
        node = node.value
    name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
    return name in SAID


def parsed(tree: ast.Module) -> list[int]:
    """Lines that take a sentence apart, or look for words in one."""
    out = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in PARSERS:
            out += [node.lineno] if said(node.func.value) else []
        # A container of notes may be asked what it holds; text is looked for in one note.
        if isinstance(node, ast.Compare) and any(isinstance(op, ast.In | ast.NotIn) for op in node.ops):
            out += [node.lineno] if any(said(one) and not many(one) for one in node.comparators) else []
    return out


def many(node: ast.expr) -> bool:
    name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
    return name.endswith("s") and name != "hides"


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("warning.startswith('No gains')", [1]),
        ("first.warnings[-1].removeprefix(name)", [1]),
        ("any('not written' in note for note in notes)", [1]),
        ("float(change.hides.removesuffix('kg'))", [1]),
        ("note.code in INCOMPLETE_FILES\nname.startswith('a')", []),
    ],
)
def test_the_check_sees_what_takes_a_sentence_apart(source, lines):
    assert parsed(ast.parse(source)) == lines


def stages() -> list[Path]:
    """Modules that are no place of words: neither words nor reports nor the command line, which has arguments."""
    places = {"words", "reporting", "cli"}
    return [path for path in sorted(ROOT.rglob("*.py")) if path.relative_to(ROOT).parts[0] not in places]


def test_no_stage_takes_the_sentence_of_another_apart():
    found = {p.relative_to(ROOT).as_posix(): len(parsed(ast.parse(p.read_text()))) for p in stages()}
    assert {name: count for name, count in found.items() if count} == {}
