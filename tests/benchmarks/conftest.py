"""Lets the tests import the benchmarks, no part of the installed packages, and the builders in this folder."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE)]
