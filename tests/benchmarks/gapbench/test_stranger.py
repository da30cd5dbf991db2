"""A tool that was made up, written with what the card says and nothing else, is scored as a stranger would score it."""

from __future__ import annotations

import ast
import json
import subprocess
import sys

import pytest

from places import CHECKOUT

TOOL = """
import json
import sys
from pathlib import Path

import numpy as np

cases, answers = map(Path, sys.argv[1:])
answers.mkdir()
for case in cases.iterdir():
    log = np.genfromtxt(case / "log.csv", delimiter=",", names=True, deletechars="")
    joint = [name[2:] for name in log.dtype.names if name.startswith("q.")][-1]
    v = np.gradient(log["q." + joint], log["t"])
    sign = np.sign(v)
    # Half of the difference of the torques of both directions.
    torque = (log["tau." + joint][sign > 0].mean() - log["tau." + joint][sign < 0].mean()) / 2
    size = {"value": abs(float(torque)), "std": 0.1 * abs(float(torque))}
    answer = {
        "verdict": "explained",
        "findings": [
            {
                "effect": "coulomb_friction",
                "joint": joint,
                "probability": 0.5,
                "rivals": [{"effects": [{"effect": "viscous_friction", "joint": joint}], "probability": 0.5}],
                "parameters": {"torque": size},
            }
        ],
    }
    (answers / (case.name + ".json")).write_text(json.dumps(answer))
"""
SCORED = """
import sys
from benchmarks.gapbench.__main__ import main
code = main(sys.argv[1:])
loaded = {name.partition(".")[0] for name in sys.modules}
print("loaded:", sorted(loaded & {"phantom_dyn", "identification", "pinocchio"}), file=sys.stderr)
sys.exit(code)
"""
LOG = """t,q.j1,tau.j1
0.0,0.0,0.3
0.1,0.1,0.3
0.2,0.2,0.3
0.3,0.2,-0.3
0.4,0.1,-0.3
0.5,0.0,-0.3
"""


@pytest.fixture(scope="module")
def scored(tmp_path_factory):
    """What the command says of the tool, in a process of its own: an invented recording of 0.3 N m of friction."""
    work = tmp_path_factory.mktemp("stranger")
    case = work / "drawn" / "cases" / "c1"
    case.mkdir(parents=True)
    (case / "log.csv").write_text(LOG)
    (case / "robot.urdf").write_text("<robot/>")
    effect = {"effect": "coulomb_friction", "joint": "j1", "parameters": {"torque": 0.3}, "gap_in_floors": 9.0}
    answer = {
        "id": "c1",
        "kind": "single",
        "robot": "planar2",
        "joints": ["j1"],
        "effects": [effect],
        "outside": None,
        "paired_gap": 9.0,
        "gap_in_floors": [9.0],
        "noise_floor": [0.01],
    }
    (work / "drawn" / "answers").mkdir()
    (work / "drawn" / "answers" / "c1.json").write_text(json.dumps(answer))
    tool = [sys.executable, "-c", TOOL, str(work / "drawn" / "cases"), str(work / "tool")]
    subprocess.run(tool, check=True, cwd=work)
    words = ["score", str(work / "drawn"), str(work / "tool"), "--json", str(work / "score.json")]
    done = subprocess.run(
        [sys.executable, "-c", SCORED, *words], cwd=CHECKOUT, capture_output=True, text=True, check=True
    )
    return done, json.loads((work / "score.json").read_text())


def test_the_tool_has_some_thirty_lines():
    assert len(TOOL.strip().splitlines()) <= 33


def test_scoring_loads_neither_the_library_nor_its_engine(scored):
    assert scored[0].stderr == "loaded: []\n"


def test_the_made_up_tool_is_scored(scored):
    of = {name: groups["gap >= 0"] for name, groups in scored[1]["figures"].items()}
    assert (of["cause leading"]["hits"], of["cause leading"]["total"]) == (1, 1)
    assert of["size within its 95 % interval"]["hits"] == 1
    assert of["causes listed per case"]["mean"] == 2.0


def test_no_file_of_the_distribution_imports_the_library():
    barred = ("phantom_dyn", "identification", "pinocchio", "benchmarks")
    for path in (CHECKOUT / "benchmarks" / "gapbench").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [x.name for x in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            assert not [name for name in names if name.partition(".")[0] in barred], path
