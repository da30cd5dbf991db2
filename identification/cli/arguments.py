"""The argument parser of every command."""

from __future__ import annotations

import argparse
from typing import NoReturn

from phantom_dyn.errors import UsageError


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `UsageError` where argparse would print its usage and leave the process."""

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments in one sentence."""
        raise UsageError(f"{message.strip()}; see {self.prog} --help")
