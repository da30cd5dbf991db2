from collections.abc import Callable

import pytest

from phantom_dyn import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS


@pytest.fixture
def load(tmp_path) -> Callable[..., Robot]:
    """A robot of the tests with a robot.yaml of the given text, and changes to its file."""

    def loaded(robot: str, config: str, *changes: tuple[str, str]) -> Robot:
        path = tmp_path / robot
        text = (ROBOTS / robot).read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path.write_text(text)
        (tmp_path / "robot.yaml").write_text(config)
        return load_robot(path)

    return loaded
