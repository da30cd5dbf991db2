"""What may have changed between two recordings by an unknown amount; apart, as a command lists it before it works."""

from __future__ import annotations

from typing import Literal, get_args

Kind = Literal["payload", "friction", "temperature", "controller"]
KINDS: tuple[Kind, ...] = get_args(Kind)
