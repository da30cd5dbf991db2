"""Answers as numbers that JSON knows."""

from __future__ import annotations

import numpy as np


def plain(value: object) -> object:
    """The same with numbers of arrays as plain numbers, within mappings and lists too."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value
