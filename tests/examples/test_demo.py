"""The demo names what it has drawn; oracles are known truths and published values."""

import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import phantom_dyn as dyn
from called_example import EXAMPLES, ended

# What the demo calls has tests of its own, which check its annotations.
pytestmark = pytest.mark.whole


@pytest.fixture
def demo(monkeypatch):
    """The demo as a module."""
    monkeypatch.syspath_prepend(EXAMPLES)
    return importlib.import_module("demo")


@pytest.mark.nightly
def test_the_demo_names_what_was_drawn_and_ends_with_reports_that_exist(mirror, tmp_path):
    # Known truth and published values: the fixed case is right, and EMPS stands beside its authors' estimates.
    # In a process of its own, as a user starts it: it starts others, which print where it does.
    command = [sys.executable, str(EXAMPLES / "demo.py"), "--out", str(tmp_path)]
    done = subprocess.run(command, env={**os.environ, **mirror}, capture_output=True, text=True)
    assert (done.returncode, "Traceback" in done.stderr) == (0, False)
    out = done.stdout
    (envelope,) = tmp_path.glob("envelope/*.json")
    (drawn,) = json.loads(envelope.read_text())["effects"]
    assert out.index("$ phantom-dyn diagnose") < out.index(f"drawn: Coulomb friction on joint {drawn['joint']}")
    assert "  agrees: yes, effect and joint\n" in out
    assert re.search(r"    mass +0\.\d+ ± \S+ +kg +simulated 0\.4\n", out)
    assert re.search(r"torque_positive .* published 20\.14|torque .* published 20\.39", out)
    assert reports(out, tmp_path) == ["emps/report", "arm", "report"]


def test_the_demo_opens_the_envelope_after_the_diagnosis_and_ends_with_reports(
    demo, monkeypatch, capsys, tmp_path, offline
):
    # Known truth: a stand-in for the command finds nothing, and sees no answer. Without a network EMPS is left out.
    def blind(robot: Path, log: Path, report: Path) -> dict:
        assert list(tmp_path.glob("envelope/*.json")) == []
        report.mkdir(parents=True)
        (report / "report.html").write_text("")
        return {"verdict": "no_gap", "findings": [], "joints": [], "seconds": 1.0}

    for name, value in offline.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(demo, "diagnosed", blind)
    assert demo.main(["--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    (envelope,) = tmp_path.glob("envelope/*.json")
    (drawn,) = json.loads(envelope.read_text())["effects"]
    assert f"drawn: Coulomb friction on joint {drawn['joint']}" in out
    assert "  agrees: no: nothing was found" in out
    assert re.search(r"^Left out: could not fetch DATA_EMPS.mat .*: take it from .*$", out, re.MULTILINE)
    assert reports(out, tmp_path) == ["arm", "report"]


def reports(out: str, folder: Path) -> list[str]:
    """Folders of the reports with whose paths the demo ended, each of which is there."""
    lines = out.partition("Open the report in a browser:\n")[2].splitlines()
    paths = [Path(line.removeprefix("  report: ")) for line in lines]
    assert all(path.is_file() for path in paths)
    return [str(path.parent.relative_to(folder)) for path in paths]


@pytest.mark.nightly
def test_the_size_that_the_fixed_demo_finds_is_the_drawn_one(demo, tmp_path):
    # Known truth: the friction that the generator drew, within three deviations.
    from benchmarks.blind.generate import draw_one

    case, envelope = draw_one(demo.FIXED_SEED, tmp_path / "cases", tmp_path / "envelope")
    (drawn,) = json.loads(envelope.read_text())["effects"]
    (finding,) = dyn.diagnose(case / "robot.urdf", case / "log.csv").findings
    (torque,) = finding.parameters.values()
    assert abs(torque.value - drawn["parameters"]["torque"]) < 3 * torque.std


@pytest.mark.parametrize(
    ("display", "terminal", "ci", "opens"),
    [("", True, "", 0), (":0", True, "", 1), (":0", False, "", 0), (":0", True, "true", 0)],
)
def test_the_demo_opens_its_report_only_where_somebody_looks(demo, tmp_path, monkeypatch, display, terminal, ci, opens):
    # Oracle: the calls of the browser.
    asked = []
    for name, value in {"DISPLAY": display, "WAYLAND_DISPLAY": "", "CI": ci}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal, raising=False)
    monkeypatch.setattr(demo.webbrowser, "open", asked.append)
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "report.html").write_text("")
    demo.end_with_reports(tmp_path)
    assert asked == [(tmp_path / "report" / "report.html").as_uri()] * opens


def test_the_demo_without_the_simulator_says_what_installs_it(demo, monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for name in [name for name in sys.modules if name.partition(".")[0] == "benchmarks"]:
        monkeypatch.delitem(sys.modules, name)
    assert not demo.sealed_case(demo.FIXED_SEED, tmp_path)
    assert "needs mujoco, which is not in this environment: run make demo" in capsys.readouterr().out


def test_the_demo_refuses_a_seed_that_is_kept_for_the_report():
    assert "--seed 1000 was given, wanted one from 0 to 999" in ended("demo.py", "--seed", 1000).err


@pytest.mark.parametrize(
    ("finding", "said"),
    [
        (("coulomb_friction", "j1", ()), r"yes, effect and joint"),
        (("coulomb_friction", "j2", ()), r"no: another cause was named"),
        (("viscous_friction", "j1", (("coulomb_friction", "j1"),)), r"in part: what was drawn is among the candidates"),
        (None, r"no: nothing was found of a change of 3\.0 noise floors"),
    ],
)
def test_the_demo_says_whether_the_diagnosis_agrees(finding, said, demo):
    # Known truth: Coulomb friction on j1.
    drawn = {"effect": "coulomb_friction", "joint": "j1", "parameters": {"torque": 0.1}}
    answer = {"id": "c", "kind": "single", "robot": "planar2", "joints": ["j1", "j2"], "effects": [drawn]}
    findings = []
    if finding is not None:
        effect, joint, others = finding
        rivals = [{"effects": [{"effect": e, "joint": j}], "probability": 0.4} for e, j in others]
        findings = [{"effect": effect, "joint": joint, "parameters": {}, "gap_closed": 0.9, "rivals": rivals}]
    diagnosis = {"verdict": "explained", "findings": findings, "joints": [], "seconds": 1.0}
    assert re.match(said, demo.agreement({**answer, "paired_gap": 3.0}, diagnosis))
