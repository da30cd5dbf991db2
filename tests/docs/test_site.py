"""The documentation: site, pages of files and effects, constants."""

import ast
import importlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import pytest

from called_example import printed
from identification.cli.main import COMMANDS
from identification.data.change_kinds import KINDS
from identification.data.changes import KnownPayload
from identification.data.readers.column_map import WHOLE_KEYS, read_column_map
from identification.data.readers.contract_columns import Quantity
from identification.data.readers.map_source import ENTRY_KEYS
from identification.export.corrected.corrected_yaml import corrected_text, read_corrected
from identification.scenarios.recordings_file import CONTROLLER_KEYS, PAYLOAD_KEYS, RECORDING_KEYS, read_changes
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.model import robot_config
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot_config import read_robot_config
from places import CHECKOUT

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

# An arm of six joints takes longest, laws of a user are compiled, and two pages diagnose several recordings.
LONG = {"ur_rtde", "own_effects", "known_changes", "compare_diagnoses"}


@pytest.mark.whole
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


@pytest.mark.whole
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


@pytest.mark.whole
@pytest.mark.parametrize("page", WITH_COMMANDS, ids=names(WITH_COMMANDS))
def test_the_commands_of_a_page_are_understood(page):
    # Oracle: the parser of each command, which ends the process where a word that it needs is missing.
    for line in commands(page):
        _, name, *words = shlex.split(line)
        _, left = importlib.import_module(COMMANDS[name][0]).parser().parse_known_intermixed_args(words)
        assert left == [], line


@pytest.mark.whole
def test_every_page_is_in_the_table_of_contents():
    listed = re.findall(r"^([a-z0-9_/]+)$", (DOCS / "index.md").read_text(), flags=re.MULTILINE)
    pages = {str(page.relative_to(DOCS).with_suffix("")) for page in PAGES} - {"index"}
    assert pages | {"reference/python", "generated/commands", "generated/effects", "generated/keys"} == set(listed)


@pytest.mark.whole
def test_the_reference_of_effects_has_the_law_and_the_ranges_of_each(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("generated_pages").effects_page()
    for effect in EFFECTS:
        assert f"\n{effect.name}\n{'-' * len(effect.name)}\n" in f"\n{page}"
    assert page.count(".. list-table::") == len(EFFECTS) + 1


@pytest.mark.whole
def test_the_table_of_effects_has_what_each_is_in_the_order_of_the_catalogue(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("generated_pages").effects_page()
    assert re.findall(r"^   \* - `(\w+)`_$", page, flags=re.MULTILINE) == [effect.name for effect in EFFECTS]
    # By hand, from the law.
    assert "   * - `viscous_friction`_\n     - Viscous friction: ``torque = -c v``.\n     - ``coefficient``\n" in page
    assert "     - ``order``, ``amplitude``, ``phase``: lists\n" in page


@pytest.mark.whole
def test_the_reference_of_commands_has_the_help_of_each(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("generated_pages").commands_page()
    assert all(f"   usage: phantom-dyn {name}" in page for name in COMMANDS)


@pytest.mark.whole
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


FILES = Path(__file__).parents[2] / "docs"

PAGE = (FILES / "files.md").read_text(encoding="utf-8")


def block(first: str) -> str:
    """The YAML of the page that begins with a key."""
    (found,) = [text for text in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL) if text.startswith(f"{first}:")]
    return found


STRUCTS = [
    one
    for one in vars(robot_config).values()
    if isinstance(one, type) and issubclass(one, msgspec.Struct) and not one.__name__.startswith("_")
    if one is not msgspec.Struct
]


@pytest.mark.parametrize("struct", STRUCTS, ids=lambda struct: struct.__name__)
def test_every_key_of_a_robot_file_is_in_the_example(struct):
    text = block("gravity")
    assert [key for key in struct.__struct_encode_fields__ if not re.search(rf"\b{key}:", text)] == []


def test_the_example_of_a_robot_file_is_read(tmp_path):
    (tmp_path / "robot.yaml").write_text(block("gravity"))
    config = read_robot_config(tmp_path / "robot.yaml")
    assert set(config.joints) == {"j1", "j2", "j3"}
    assert len(config.loops) == 2


def test_every_key_of_a_column_map_is_on_the_page():
    text = PAGE[PAGE.index("## Column map") : PAGE.index("## recordings.yaml")]
    assert [key for key in (*ENTRY_KEYS, *WHOLE_KEYS) if not re.search(rf"\b{key}:", text)] == []


def test_the_example_of_a_column_map_is_read(tmp_path):
    (tmp_path / "columns.yaml").write_text(block("t"))
    columns = read_column_map(tmp_path / "columns.yaml")
    assert columns.compensated == {"": ("gravity",), "j3": ("gravity", "friction")}
    assert columns.low_pass == {"j4": 20.0}


def test_every_column_of_a_log_is_in_its_table():
    named = set(re.findall(r"`(\w+)[.`]", "".join(re.findall(r"^\| (`.*?) \|", PAGE, re.MULTILINE))))
    assert set(get_args(Quantity)) - named == set()


def test_every_key_of_a_recordings_file_is_in_the_example():
    text = block("recordings")
    keys = (*RECORDING_KEYS, *PAYLOAD_KEYS, *CONTROLLER_KEYS)
    assert [key for key in keys if not re.search(rf"\b{key}:", text)] == []
    assert [kind for kind in KINDS if kind not in text] == []


def test_the_example_of_a_recordings_file_is_read(tmp_path):
    (tmp_path / "recordings.yaml").write_text(block("recordings"))
    (tmp_path / "tau.csv").touch()
    logs = ["loaded.csv", "soft.csv", "warm.csv", "pos.csv"]
    loaded, soft, warm, beside = read_changes(tmp_path / "recordings.yaml", logs, ("j1",))
    assert loaded.payload == KnownPayload(1.0, (0.0, 0.0, -0.6))
    assert soft.controllers["j1"].delay == 0.002
    assert (warm.changed, warm.exclude) == (("friction", "temperature"), ((0.0, 1.5), (8.0, 9.0)))
    assert beside.beside == (str(tmp_path / "tau.csv"),)


def test_the_example_of_a_corrected_file_is_read_and_has_every_key(tmp_path):
    # Oracle: the writer, which writes every key that there is.
    (tmp_path / "corrected.yaml").write_text(block("schema"))
    model = read_corrected(tmp_path / "corrected.yaml")
    assert (model.effects[0].joint, model.adjusted[0].change, model.model_error[0].slow) == ("elbow", 0.03, 0.002)
    keys = set(re.findall(r"(\w+):", corrected_text(model)))
    assert keys == set(re.findall(r"(\w+):", block("schema")))


def test_the_generated_tables_have_every_key_of_a_robot_file(monkeypatch):
    monkeypatch.syspath_prepend(FILES)
    page = importlib.import_module("generated_pages").keys_page()
    assert [key for struct in STRUCTS for key in struct.__struct_encode_fields__ if f"``{key}``" not in page] == []
    # By hand, from the contract of robot.yaml.
    assert "   * - ``encoder_side``\n     - one of motor, link\n     - motor\n" in page
    assert "   * - ``w.<frame>.x``, ``w.<frame>.y``, ``w.<frame>.z``\n     - ``rad/s``, ``deg/s``\n" in page


CONSTANTS = (CHECKOUT / "docs" / "how_to" / "formats.md").read_text()

ROWS = re.findall(r"^\| (\S+) \| ([\d.]+) N m, ([\d.]+) A \([\d.]+ V\) \| ([\d.]+) \|$", CONSTANTS, flags=re.MULTILINE)


def test_each_constant_is_torque_over_current():
    assert len(ROWS) == 10
    for _, torque, current, constant in ROWS:
        assert float(constant) == pytest.approx(float(torque) / float(current), rel=5e-3)


def test_the_constants_of_the_ur10_are_read_as_torque_at_the_joint(tmp_path):
    (block,) = re.findall(r"```yaml\n(joints:\n  shoulder_pan_joint.*?)```", CONSTANTS, flags=re.DOTALL)
    (tmp_path / "robot.yaml").write_text(block)
    arm = load_robot("example:ur10", config=tmp_path / "robot.yaml")
    found = [(one.torque_constant or 0.0) * one.gear_ratio for one in arm.actuators]
    assert found == [13.5841, 14.2959, 11.3716, 11.2408, 11.7681, 11.7682]


@pytest.fixture(scope="module")
def figures():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(CHECKOUT / "docs")
        yield importlib.import_module("effect_figures")


@pytest.fixture(scope="module")
def operation(figures):
    return figures.swung(figures.smooth_arm())


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_every_effect_leaves_something_in_its_figure(figures, operation, effect):
    left, _ = figures.left_by(effect, operation)
    assert np.isfinite(left).all()
    assert np.ptp(left) > 1e-4 or np.abs(left).min() > 1e-4


def test_viscous_friction_is_a_line_over_velocity(figures, operation):
    panel = figures.effect_figure(effect_named("viscous_friction"), operation).axes[0]
    v, torque = panel.lines[0].get_data()
    np.testing.assert_allclose(torque, 0.2 * v, atol=1e-12)


def test_a_payload_needs_the_torque_of_its_weight_and_inertia(figures, operation):
    # By hand, m = 0.4 kg at l = 0.2 m from the level axis of the elbow: m l (l a - g cos q), down is positive.
    left, _ = figures.left_by(effect_named("payload"), operation)
    row = operation.robot.joint_names.index("elbow")
    wanted = 0.4 * 0.2 * (0.2 * operation.a[:, row] - 9.81 * np.cos(operation.q[:, row]))
    np.testing.assert_allclose(left, wanted, rtol=1e-9, atol=1e-9)


def test_the_time_in_which_springs_settle_is_not_drawn(figures, operation):
    t = figures.effect_figure(effect_named("cogging"), operation).axes[2].lines[0].get_xdata()
    assert t[0] >= 0 > operation.t[0]


def test_sizes_are_named_with_their_units(figures):
    assert figures.shown_sizes(effect_named("presliding_friction")) == "torque 0.5 N m; displacement 0.05 rad"
