"""Examples of haptics run, and so does the one of docs/haptics.md. Oracles: published values, and the scripts."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib
import pytest

from called_example import printed
from places import CHECKOUT

PAGE = (CHECKOUT / "docs" / "haptics.md").read_text()


pytestmark = pytest.mark.whole


@pytest.mark.nightly
def test_the_gallery_writes_every_figure_that_it_names_and_leaves_no_half_one(tmp_path):
    with matplotlib.rc_context({"savefig.dpi": 30}):  # a fifth of the dots: nobody looks at them
        out = printed("haptics_gallery.py", tmp_path)
    named = re.findall(r"^wrote (.*)$", out, flags=re.MULTILINE)
    assert len(named) == 24
    assert sorted(named) == sorted(str(path) for path in tmp_path.iterdir())
    assert all(Path(name).read_bytes().startswith(b"\x89PNG") for name in named)


@pytest.mark.nightly
def test_without_the_robots_of_the_walk_the_gallery_runs_to_its_end_and_says_what_it_left_out(tmp_path, monkeypatch):
    """As after a plain installation, which has no example-robot-data."""
    monkeypatch.setattr("phantom_dyn.model.robot_files.examples_folder", lambda: None)
    with matplotlib.rc_context({"savefig.dpi": 30}):
        out = printed("haptics_gallery.py", tmp_path)
    assert "left out joystick_walk.png: example:talos_reduced needs the package example-robot-data" in out
    assert "left out stairs.png" in out
    assert len(list(tmp_path.iterdir())) == out.count("wrote ") == out.count("\n") - 2


def test_the_example_of_the_page_finds_the_published_stiffness_and_draws_it(tmp_path, monkeypatch, capsys):
    # Published masses: 24372 N/m at 445.06 rad/s.
    (block,) = (text for text in re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL) if "bode.png" in text)
    monkeypatch.chdir(tmp_path)
    exec(block, {})
    stiffness, frequency = map(float, capsys.readouterr().out.split())
    assert stiffness == pytest.approx(24372, abs=1)
    assert frequency == pytest.approx(445.06, abs=0.01)
    assert (tmp_path / "bode.png").is_file()


def test_the_walk_keeps_its_margin_and_stops_within_two_steps(tmp_path):
    out = printed("joystick_walk.py", tmp_path)
    margin, landings = re.search(r"smallest margin ([\d.]+) mm", out), re.search(r"stop at 8.0 s, (\d) landings", out)
    assert margin
    assert landings
    assert float(margin[1]) > 0
    assert int(landings[1]) <= 2
    assert (tmp_path / "joystick_walk.png").is_file()
