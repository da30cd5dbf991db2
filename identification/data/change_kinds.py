"""Kinds of change between recordings that a user can name without stating the size of the change.

This module imports nothing else, so that the command line can list the names without loading NumPy.
"""

from __future__ import annotations

from typing import Literal, get_args

Kind = Literal["payload", "friction", "temperature", "controller"]
KINDS: tuple[Kind, ...] = get_args(Kind)
