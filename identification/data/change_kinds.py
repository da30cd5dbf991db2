"""Names of the changes between two recordings whose amount need not be known.

They have a module of their own so that the command line can list them without loading NumPy.
"""

from __future__ import annotations

from typing import Literal, get_args

Kind = Literal["payload", "friction", "temperature", "controller"]
KINDS: tuple[Kind, ...] = get_args(Kind)
