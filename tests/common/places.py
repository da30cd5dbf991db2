"""Folders of this checkout that tests read, the same from every depth of the tests."""

from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
ROBOTS = CHECKOUT / "tests" / "robots"
