"""Objects of annotated types from plain data; the oracle is the object that was written down by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar

import pytest

from identification.reporting.stored.typed_json import from_json

Name = TypeVar("Name")


@dataclass(frozen=True)
class Inner(Generic[Name]):
    """A part with a type variable."""

    names: tuple[Name, ...]
    kind: Literal["a", "b"] = "a"


@dataclass(frozen=True)
class Outer:
    """An object with fields of every kind that can be read."""

    size: float
    count: int
    part: Inner[str]
    sizes: float | list[float]
    pair: tuple[float, float] | None
    by_name: Mapping[str, float] = field(default_factory=dict)
    free: dict | None = None


PLAIN = {"size": 1, "count": 2, "part": {"names": ["x"]}, "sizes": [1.0, 2.0], "pair": None}


def test_an_object_with_parts_has_the_annotated_types():
    whole = PLAIN | {"by_name": {"j1": 3}, "free": {"any": [1]}}
    found = from_json(Outer, whole)
    assert found == Outer(1.0, 2, Inner(("x",)), [1.0, 2.0], None, {"j1": 3.0}, {"any": [1]})
    assert isinstance(found.size, float)


def test_null_for_a_number_is_nan_and_for_an_optional_one_none():
    found = from_json(Outer, PLAIN | {"size": None, "pair": [None, 2]})
    assert math.isnan(found.size)
    assert math.isnan(found.pair[0])
    assert from_json(float | None, None) is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"size": True}, r"Expected float, got bool - at \$\.size"),
        ({"size": 1e151}, r"Expected a number of at most 1e\+150 - at \$\.size"),
        ({"count": True}, r"Expected int, got bool - at \$\.count"),
        ({"count": 1.0}, r"Expected int, got float - at \$\.count"),
        ({"part": []}, r"Expected object, got list - at \$\.part"),
        ({"part": {"names": [1]}}, r"Expected str, got int - at \$\.part\.names\[0\]"),
        ({"part": {"names": [], "kind": "c"}}, r"Expected one of a, b, got str - at \$\.part\.kind"),
        ({"part": {"names": [], "more": 1}}, r"Unknown key more - at \$\.part"),
        ({"part": {}}, r"Missing key names - at \$\.part"),
        ({"pair": [1.0]}, r"Expected 2 entries, got 1 - at \$\.pair"),
        ({"pair": "ab"}, r"Expected array, got str - at \$\.pair"),
        ({"by_name": [1]}, r"Expected object, got list - at \$\.by_name"),
    ],
)
def test_data_of_another_layout_is_refused_with_its_place(change: dict[str, Any], said: str):
    with pytest.raises(ValueError, match=said):
        from_json(Outer, PLAIN | change)
