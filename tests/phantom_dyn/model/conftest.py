"""Robot files that a test changes."""

from pathlib import Path

import pytest

from phantom_dyn import load_robot


@pytest.fixture
def edited(tmp_path):
    """Load a robot file after replacing text in it."""

    def load(source: Path, *changes: tuple[str, str], config: str = ""):
        text = source.read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / source.name
        path.write_text(text)
        (tmp_path / "robot.yaml").write_text(config)
        return load_robot(path)

    return load
