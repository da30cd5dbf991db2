"""phantom_dyn: robots, effects and dynamics; it knows nothing of recordings or fitting."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from phantom_dyn.model.loading import load_robot as load_robot

__version__ = "0.1.0"
__all__ = ["__version__", "load_robot"]


def __getattr__(name: str) -> Any:
    """Load what needs Pinocchio on first use, so that the command line starts at once."""
    if name == "load_robot":
        from phantom_dyn.model.loading import load_robot

        return load_robot
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
