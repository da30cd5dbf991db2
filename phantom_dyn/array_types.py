"""Types of arrays with their shapes, and arrays that nobody can change.

The types are jaxtyping's, which is loaded only where something looks at them.

Annotations are texts: readers and type checkers read them, and the tests check them. A run of the command does neither,
and loading jaxtyping takes a tenth of the time of all imports.
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
            """Jaxtyping's type where it is loaded, as in the tests; else an array of any shape."""
            loaded = sys.modules.get("jaxtyping")
            return np.ndarray if loaded is None else getattr(loaded, self._name)[shaped]

    Bool, Complex, Float, Int = (_Kind(name) for name in ("Bool", "Complex", "Float", "Int"))

Array = np.ndarray

# Numbers that the annotations of arrays name.
_NUMBERS = {"Float": float, "Complex": complex, "Bool": bool, "Int": int}

__all__ = ["Array", "Bool", "Complex", "Float", "Int", "ReadOnlyArrays", "read_only"]


def read_only(array: Array, dtype: type = float) -> Array:
    """Contiguous private copy of ``array`` that cannot be written to; itself if it is one already."""
    if array.dtype == dtype and array.flags.owndata and array.flags.c_contiguous and not array.flags.writeable:
        return array
    copy = np.array(array, dtype=dtype, order="C")
    copy.flags.writeable = False
    return copy


@cache
def _arrays_of(kind: type[ReadOnlyArrays]) -> tuple[tuple[str, type], ...]:
    """Names and types of the fields that hold arrays, from their annotations."""
    named = ((field.name, str(field.type).partition("[")[0]) for field in fields(kind))  # type: ignore[arg-type]
    return tuple((name, _NUMBERS[word]) for name, word in named if word in _NUMBERS)


class ReadOnlyArrays:
    """Base of frozen dataclasses whose arrays are copied and cannot be written to; None stays None."""

    def __post_init__(self):
        for name, dtype in _arrays_of(type(self)):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, read_only(value, dtype))
