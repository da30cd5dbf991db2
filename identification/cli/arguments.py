"""The argument parser of every command."""

from __future__ import annotations

import argparse
import re
from typing import NoReturn

from phantom_dyn.errors import UsageError


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `UsageError` where argparse would print its usage and leave the process."""

    def _parse_optional(self, arg_string: str):
        # A stretch of time that begins before zero, -1:2, is no option although it begins as one.
        return None if re.match(r"-[\d.]", arg_string) else super()._parse_optional(arg_string)

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments in one sentence."""
        raise UsageError(f"{message.strip()}; see {self.prog} --help")
