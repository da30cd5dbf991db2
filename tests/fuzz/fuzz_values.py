"""Values that files ought not to hold, and the random choices that mutations are made of."""

import random
import struct

NUMBERS = (
    "0",
    "-1",
    "1e308",
    "-1e308",
    "1e400",
    "1e-308",
    "5e-324",
    "nan",
    "inf",
    "-inf",
    "1e7",
    "-1e-9",
    "1e20",
    "0x10",
    "1_000",
    "1,5",
    "9" * 400,
    "-" + "9" * 5000,
    "18446744073709551616",
    "١٢",
)
"""Numbers that are huge, tiny, infinite, none, or too long for a float; and what only looks like one."""

TEXTS = (
    "",
    " ",
    "text",
    "true",
    "null",
    "~",
    "=1+2",
    "+1+cmd",
    "-2+3",
    "@SUM(A1)",
    "\x1b[31mred\x1b[0m",
    "a\rb",
    "\x07bell",
    "\u202eleft",
    "\u2028",
    "../../etc",
    "/dev/zero",
    "x" * 3000,
    "é😀",
    "%s{0}{joint}",
    "<b>&amp;",
    "pin",
    "0 0",
    "1 2 3 4 5 6 7",
    "nan nan nan",
    "1e308 1e308 1e308",
)
"""Texts: empty, formulas, control characters, too long, too many numbers."""

YAML_VALUES = (
    "2023-02-30",
    "2024-13-45T99:99:99",
    "2001-01-01",
    "2001-12-14t21:59:43.10-99:00",
    "!!python/object/apply:os.system [ls]",
    "!!binary notbase64%",
    "!!timestamp 1",
    "!!int x",
    "!!float []",
    "!!set {a, b}",
    "!!omap [a: 1]",
    "!!pairs [a]",
    "!!bool 7",
    "!!null x",
    "!!map [1]",
    "!unknown x",
    "!!merge x",
    "&a [*a]",
    "&a {b: *a}",
    "*undefined",
    "[" * 3000,
    "[" * 3000 + "]" * 3000,
    "{a: " * 1200 + "1" + "}" * 1200,
    "1:2:3",
    "-1:59:59.9999",
    "190:20:30:40:50:60:70:80:90:99" * 40,
    "0b1",
    "0o17",
    "0b",
    "{}",
    "[]",
    "[1, 2]",
    "{a: 1}",
    "{<<: 3}",
    "{? [1, 2] : 3}",
    "{1: 2}",
    "{null: 2}",
    ".nan",
    ".inf",
    "-.INF",
    "|\n    block",
    '"\\x1b[31m"',
    '"\\ud800"',
    "''",
    "<<",
    "=",
)
"""What YAML alone can say: dates, tags, aliases, nesting, merges."""

LAUGHS = "".join(f"l{k}: &l{k} [{', '.join([f'*l{k - 1}'] * 9) if k else ', '.join(['lol'] * 9)}]\n" for k in range(9))
"""A list that becomes a thousand million texts when its aliases are followed."""


def value(rng: random.Random) -> str:
    """A number or text that a file ought not to hold."""
    return rng.choice(NUMBERS if rng.random() < 0.6 else TEXTS)


def float_value(rng: random.Random) -> float:
    """A number that no sensor gives, or a subtle one."""
    choices = (0.0, -1.0, 1e308, -1e308, 5e-324, float("nan"), float("inf"), -float("inf"), 1e9, 1e-12, 1e5, -0.0)
    return rng.choice(choices)


def bytes_value(rng: random.Random) -> bytes:
    """Bytes of a length or a count that is wrong."""
    number = rng.choice((0, 1, 255, 2**16, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1))
    size = "<I" if number < 2**32 and rng.random() < 0.5 else "<Q"
    return struct.pack(size, number)
