"""Types for annotations of arrays with their shapes, and read-only copies of arrays.

For type checkers and tests these annotations are types of jaxtyping. The command line does not need them, and importing
jaxtyping would take a tenth of the time of all imports. So this module uses jaxtyping only if it is already imported.
"""

from __future__ import annotations

import sys
from dataclasses import fields
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Bool, Complex, Float, Int
else:

    class _Kind:
        def __init__(self, name: str) -> None:
            self._name = name

        def __getitem__(self, shaped: Any) -> Any:
            """Jaxtyping's type if jaxtyping is imported, as in the tests; otherwise an array of any shape."""
            loaded = sys.modules.get("jaxtyping")
            return np.ndarray if loaded is None else getattr(loaded, self._name)[shaped]

    Bool, Complex, Float, Int = (_Kind(name) for name in ("Bool", "Complex", "Float", "Int"))

Array = np.ndarray

# Type of an array's elements for each annotation.
_DTYPES = {"Float": float, "Complex": complex, "Bool": bool, "Int": int}

__all__ = ["Array", "Bool", "Complex", "Float", "Int", "ReadOnlyArrays", "read_only"]


def read_only(array: Array, dtype: type = float) -> Array:
    """Contiguous read-only copy of ``array``; ``array`` itself if it is contiguous, read-only and owns its data."""
    if array.dtype == dtype and array.flags.owndata and array.flags.c_contiguous and not array.flags.writeable:
        return array
    copy = np.array(array, dtype=dtype, order="C")
    copy.flags.writeable = False
    return copy


@cache
def _arrays_of(kind: type[ReadOnlyArrays]) -> tuple[tuple[str, type], ...]:
    """Names of the fields that hold arrays and the types of their elements, from the annotations."""
    named = ((field.name, str(field.type).partition("[")[0]) for field in fields(kind))  # type: ignore[arg-type]
    return tuple((name, _DTYPES[word]) for name, word in named if word in _DTYPES)


class ReadOnlyArrays:
    """Base class of frozen dataclasses, which replaces their arrays by read-only copies; None stays None."""

    def __post_init__(self):
        for name, dtype in _arrays_of(type(self)):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, read_only(value, dtype))
