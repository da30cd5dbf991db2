"""Runs an example as its user would, without a process of its own: that takes two seconds before it begins."""

import io
import os
import runpy
import sys
import warnings
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from unittest import mock

from places import CHECKOUT

EXAMPLES = CHECKOUT / "examples"


@dataclass(frozen=True)
class Ended:
    """What an example leaves: ``code`` as a shell sees it, ``out`` and ``err`` as printed."""

    code: int
    out: str
    err: str


def ended(script: str, *words: object, **environment: str) -> Ended:
    """Calls a script of ``examples`` with words and more environment; a warning that a user would see is raised."""
    path, out, err = EXAMPLES / script, io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", [str(path), *map(str, words)]),
        mock.patch.object(sys, "path", [str(EXAMPLES), *sys.path]),
        mock.patch.dict(os.environ, environment),
        warnings.catch_warnings(),
        redirect_stdout(out),
        redirect_stderr(err),
    ):
        warnings.simplefilter("error")
        for silent in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", silent)  # as Python does, save in the script itself
        warnings.filterwarnings("error", category=DeprecationWarning, module="__main__")
        try:
            runpy.run_path(str(path), run_name="__main__")
        except SystemExit as end:
            if isinstance(end.code, str):
                print(end.code, file=err)
            code = 1 if isinstance(end.code, str) else end.code or 0
        else:
            code = 0
    return Ended(code, out.getvalue(), err.getvalue())


def printed(script: str, *words: object, **environment: str) -> str:
    """What an example prints, which has to end well."""
    done = ended(script, *words, **environment)
    assert (done.code, done.err) == (0, "")
    return done.out
