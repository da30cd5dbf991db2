"""Types of arrays with their shapes: jaxtyping's, which are loaded only where something looks at them.

Annotations are texts: readers and type checkers read them, and the tests check them. A run of the command does neither,
and loading jaxtyping takes a tenth of the time of all imports.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Bool, Complex, Float, Int
else:

    class _Kind:
        def __init__(self, name: str) -> None:
            self._name = name

        def __getitem__(self, shaped: Any) -> Any:
            """Jaxtyping's type where it is loaded, as in the tests; else an array of any shape."""
            loaded = sys.modules.get("jaxtyping")
            return np.ndarray if loaded is None else getattr(loaded, self._name)[shaped]

    Bool, Complex, Float, Int = (_Kind(name) for name in ("Bool", "Complex", "Float", "Int"))

Array = np.ndarray

__all__ = ["Array", "Bool", "Complex", "Float", "Int"]
