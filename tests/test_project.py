"""Tests that step MuJoCo leave no log of its warnings in the working folder."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
import zlib
from pathlib import Path

import jaxtyping
import mujoco
import numpy as np
import pytest

from identification.data.recording import Recording
from phantom_dyn import __version__
from phantom_dyn.libraries import OPTIONAL
from places import CHECKOUT

# Written in parts, so that this file does not name what it looks for.
REGISTRY_HOSTS = ("py" + "pi.org", "python" + "hosted.org", "npm" + "js.org", "ana" + "conda.org")
LOCAL_PLACES = ("file:" + "//", "/" + "opt/", "/ro" + "ot/", "/ho" + "me/", "/wo" + "rk/", "../" + "shared")


def committed_texts():
    """Path and text of every committed text file that is still there."""
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=CHECKOUT, capture_output=True, text=True, check=True)
    for name in filter(None, listing.stdout.split("\0")):
        path = CHECKOUT / name
        if path.is_file() and path.suffix not in {".png", ".npz", ".mat", ".stl", ".db3", ".mcap", ".parquet"}:
            yield name, path.read_text(encoding="utf-8", errors="replace")


def lock():
    return (CHECKOUT / "requirements.txt").read_text()


def locked_packages():
    return {re.match(r"[\w.\-]+", line)[0].lower() for line in lock().splitlines() if re.match(r"\S+==", line)}


def names_of(requirements):
    return {re.match(r"[\w.\-]+", requirement)[0].lower() for requirement in requirements}


def test_linear_algebra_runs_on_one_thread_in_tests():
    assert os.environ["OMP_NUM_THREADS"] == os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_rng_gives_the_same_numbers_in_every_run(rng):
    # Known truth: the seed is the checksum of the test's name, which does not change.
    name = "test_rng_gives_the_same_numbers_in_every_run"
    assert rng.random() == np.random.default_rng(zlib.crc32(name.encode())).random()


@pytest.mark.shapes
def test_a_wrong_shape_is_caught_by_the_annotations():
    # Oracle: jaxtyping's own check of the field `t: Float[Array, " N"]`.
    with pytest.raises(jaxtyping.TypeCheckError, match="Recording"):
        Recording(file="a.csv", joint_names=("j1",), t=np.zeros((2, 2)), q=np.zeros((2, 1)), tau=None)


def test_the_lock_pins_every_package_to_hashes():
    # Oracle: pip's own rule for --require-hashes, every requirement pinned by == with a hash on the next line.
    blocks = re.findall(r"^(\S+?)==\S+[^\n]*\\\n    --hash=sha256:[0-9a-f]{64}", lock(), flags=re.MULTILINE)
    assert {name.split("[")[0].lower() for name in blocks} == locked_packages()


def test_the_lock_names_no_address():
    assert not re.search(r"https?:|file:|@ |--index|--find-links", lock())


def test_the_lock_holds_every_declared_dependency():
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
    declared = names_of(project["project"]["dependencies"])
    for group in [*project["project"]["optional-dependencies"].values(), *project["dependency-groups"].values()]:
        declared |= names_of(group)
    assert declared - {"phantom-dyn"} <= locked_packages()


def test_the_badges_of_the_readme_say_what_the_project_declares():
    # Oracles: pyproject.toml, and the Makefile for the command that runs the tests.
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    said = {"licence": project["license"], "python": project["requires-python"].replace(">=", "") + " or later"}
    assert "\ntest: setup\n" in (CHECKOUT / "Makefile").read_text()
    said["tests"] = "make test"
    readme = (CHECKOUT / "README.md").read_text()
    for name, words in said.items():
        assert f": {words}</title>" in (CHECKOUT / "docs" / "badges" / f"{name}.svg").read_text()
        assert f": {words}](docs/badges/{name}.svg)" in readme


def test_the_figures_of_the_readme_stand_in_the_tables_of_sealed_cases():
    # Oracle: what the scorer wrote; of robots without a gap it counts those that are not called so.
    said = (CHECKOUT / "README.md").read_text().partition("## How good it is")[2].partition("\n## ")[0]
    table = (CHECKOUT / "docs" / "sealed_cases.md").read_text()
    figures = [tuple(map(int, one)) for one in re.findall(r"(\d+) \((\d+)\sto\s(\d+)\)", said)]
    assert len(figures) == 8
    for value, low, high in figures:
        counted = [(value, low, high), (100 - value, 100 - high, 100 - low)]
        assert any(f"| {share} % ({least} to {most})" in table for share, least, most in counted), value


def test_the_extras_are_those_that_sentences_about_missing_libraries_name():
    # Oracle: pyproject.toml; `all` is the others together.
    extras = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    (everything,) = extras.pop("all")
    assert everything == f"phantom-dyn[{','.join(extras)}]"
    named = {extra: {one.distribution for one in OPTIONAL if one.extra == extra} for extra in extras}
    assert named == {extra: names_of(requirements) for extra, requirements in extras.items()}


# Clarabel is what cvxpy is told to solve with.
MODULES = {"pin": "pinocchio", "pyyaml": "yaml", "cvxpy-base": "cvxpy", "clarabel": "cvxpy"}


def test_every_dependency_is_imported_by_the_packages():
    # Oracle: the imports in the source, inside functions too.
    declared = names_of(tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]["dependencies"])
    source = "\n".join(
        p.read_text() for name in ("phantom_dyn", "identification") for p in (CHECKOUT / name).rglob("*.py")
    )
    imported = set(re.findall(r"^\s*(?:from|import) (\w+)|import_module\(\"(\w+)\"\)", source, flags=re.MULTILINE))
    imported = {name for pair in imported for name in pair}
    assert {name for name in declared if MODULES.get(name, name) not in imported} == set()


@pytest.mark.parametrize("kind", [REGISTRY_HOSTS, LOCAL_PLACES], ids=["registry", "machine"])
def test_no_committed_file_names_a_place_that_others_do_not_have(kind):
    named = [(name, place) for name, text in committed_texts() for place in kind if place in text]
    assert named == []


def test_no_link_is_committed():
    # The target of a link is a place of the machine that made it. 120000 is the mode of a link in git.
    listing = subprocess.run(["git", "ls-files", "-s"], cwd=CHECKOUT, capture_output=True, text=True, check=True)
    assert not [line for line in listing.stdout.splitlines() if line.startswith("120000")]


def test_the_wheel_holds_both_packages_and_the_robots(tmp_path):
    # Oracle: hatchling, the build backend itself, as pip would call it.
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(command, cwd=CHECKOUT, capture_output=True, check=True)
    (wheel,) = tmp_path.glob(f"phantom_dyn-{__version__}-*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = {"phantom_dyn/__init__.py", "phantom_dyn/py.typed", "identification/__init__.py"}
    wanted |= {f"phantom_dyn/{path.relative_to(CHECKOUT)}" for path in CHECKOUT.glob("urdf/*/*.urdf")}
    beside = {"identification/py.typed", "phantom_dyn/urdf/emps/robot.urdf"}
    beside |= {f"identification/reporting/page/{name}" for name in ("robot_viewer.js", "curve_viewer.js")}
    assert wanted | beside <= names


@pytest.mark.parametrize(("ci", "outcome"), [("", "1 skipped"), ("true", "1 error")])
def test_without_the_recordings_a_test_is_skipped_but_under_ci_it_fails(ci, outcome, tmp_path):
    # Oracle: pytest itself, on a folder with our conftest.py and one test.
    shutil.copy(CHECKOUT / "tests" / "conftest.py", tmp_path)
    (tmp_path / "test_data.py").write_text("def test_it(data_folder): pass")
    environment = {**os.environ, "CI": ci, "PHANTOM_DYN_DATA": str(tmp_path / "missing")}
    command = [sys.executable, "-m", "pytest", "-ra", "-p", "no:cacheprovider", "-p", "no:xdist", "--rootdir", "."]
    child = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert outcome in child.stdout
    assert f"the real recordings are not at {tmp_path / 'missing'}: set PHANTOM_DYN_DATA" in child.stdout


SLIDER = """<mujoco><worldbody><body><joint type="slide"/><geom size="0.1"/></body></worldbody></mujoco>"""


def test_a_simulation_that_runs_away_writes_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_string(SLIDER)
    data = mujoco.MjData(model)
    data.qpos[:] = np.nan
    mujoco.mj_step(model, data)
    # MuJoCo has warned.
    assert data.warning[mujoco.mjtWarning.mjWARN_BADQPOS].number > 0
    assert not Path("MUJOCO_LOG.TXT").exists()
