"""Stages that a command announces and those that it is said to have. Oracle: the commands themselves."""

from __future__ import annotations

import pytest

from identification.cli.main import main
from identification.cli.terminal.percentage import EXCITATION, IDENTIFICATION, MAP
from identification.cli.terminal.progress import Progress

pytestmark = pytest.mark.whole

COMMANDS = {
    "identify": (IDENTIFICATION, ["identify", "{pendulum}", "{log}", "--out", "{out}"]),
    "excite": (EXCITATION, ["excite", "{pendulum}", "--duration", "2", "--out", "{out}.csv"]),
    "map": (MAP, ["map", "{arm}", "--quantity", "manipulability", "--grid", "q.turn=-1:1:3", "--out", "{out}"]),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_every_announcement_is_of_a_stage_and_every_stage_is_announced(
    command, pendulum, arm, log, tmp_path, monkeypatch
):
    stages, words = COMMANDS[command]
    announced = []
    monkeypatch.setattr(Progress, "_take", lambda self, now: announced.append(now.stage))
    given = {"pendulum": pendulum, "arm": arm, "log": log, "out": tmp_path / "out"}
    assert main([word.format(**given) for word in words]) == 0
    places = [list(stages).index(stage) for stage in announced]
    assert places == sorted(places)
    assert set(places) == set(range(len(stages)))
