"""The first make with slow motions: point to point with pauses, guided by hand, one joint after the other."""

from __future__ import annotations

from dataclasses import replace

from ..generator import case as first
from ..generator.case import Case, resolved_kind, write_case

__all__ = ["case_id", "draw_case", "resolved_kind", "write_case"]


def case_id(seed: int, kind: str) -> str:
    """A name that says nothing about the answer, and is no other make's."""
    return "s" + first.case_id(seed, kind)[1:]


def draw_case(seed: int, kind: str = "mixed") -> Case:
    """The case of a seed; the same seed and kind give the same bytes.

    Raises:
        NoCase: If the seed gives none.
    """
    case = first.draw_case(seed, kind, slow=True)
    name = case_id(seed, case.answer["kind"])
    return replace(case, id=name, answer={**case.answer, "id": name})
