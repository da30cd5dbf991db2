"""The compiled laws of the catalogue, gathered from the files of its effects, and what calls one by its number.

A law is marked where it stands, see `phantom_dyn.effects.simulated.torque_law`; its number is made of its name. An
effect without a marked law is stepped in Python, and every effect beside it. Scalars in and out: a law that took an
array would cost more than its numbers, for counting who holds the array.

Compiled code cannot call a function that it finds in a list, so the text of the functions below is made of the list.
Numba does not see that a function which calls these must be compiled anew after a change of an effect's law or of the
catalogue: delete the ``__pycache__`` of `phantom_dyn.simulation.compiled` then. A law that it does not know gives no
number.
"""

from __future__ import annotations

import inspect
import sys
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.effects.drive.input_delay import delay_law
from phantom_dyn.effects.simulated import Channel, channel_of

LawFunction = Callable[..., Any]

# Inputs of the moment that a law of the torque channel may ask for; behind them are its parameters.
_INPUTS = ("q", "v", "load")


def laws_of(channel: Channel) -> tuple[LawFunction, ...]:
    """Compiled laws of a channel in the order of the catalogue, those of one file in the order in which they stand."""
    files = dict.fromkeys(type(effect).__module__ for effect in EFFECTS)
    marked = (value for file in files for value in vars(sys.modules[file]).values() if channel_of(value) == channel)
    # Without numba a law may be the plain function beside it.
    return tuple(dict.fromkeys(marked))


def number_of(law: LawFunction) -> int:
    """The number of a law, the same in whatever catalogue it is."""
    return zlib.crc32(f"{law.__module__}.{law.__name__}".encode())


TORQUES, COMMANDS, READINGS = laws_of("torque"), laws_of("command"), laws_of("reading")
# The one law with a memory too long for scalars: kernels call it themselves.
DELAY = number_of(delay_law)


def torque_call(law: str, names: list[str]) -> str:
    """Text that returns state and torque of a law, of which ``s0`` is the position of the step before.

    Args:
        law: What it is called in the text.
        names: Names of its arguments.

    Raises:
        TypeError: If they are not in the order of `phantom_dyn.effects.simulated.torque_law`.
    """
    inputs = [name for name in names if name in _INPUTS]
    first = names.index(inputs[0]) if inputs else 0
    numbers = [f"p{k}" for k in range(len(names) - first - len(inputs))]
    remembers = names[0] == "last"
    if names[first : first + len(inputs)] != inputs or remembers != (first > 0) or first > 3 or len(numbers) > 4:
        raise TypeError(
            f"A torque law takes {', '.join(names)}, wanted last and what it remembers (two numbers at most) if it has "
            f"a memory, then those of {', '.join(_INPUTS)} that it needs, then four parameters at most: order them so."
        )
    if not remembers:
        return f"return s0, s1, s2, {law}({', '.join([*inputs, *numbers])})"
    remembered = [f"s{k + 1}" for k in range(first - 1)]
    call = f"{law}({', '.join(['s0', *remembered, *inputs, *numbers])})"
    return f"{', '.join([*remembered, 'torque'])} = {call}; return q, s1, s2, torque"


def _command_call(law: str, names: list[str]) -> str:
    return f"return {law}(s0, tau, dt, p0)" if "dt" in names else f"return s0, {law}(tau, p0)"


def _reading_call(law: str, names: list[str]) -> str:
    return f"return {law}({', '.join(['q', *(f'p{k}' for k in range(len(names) - 1))])})"


def _by_number(
    head: str, unknown: str, laws: tuple[LawFunction, ...], call: Callable[[str, list[str]], str], doc: str
) -> LawFunction:
    """A compiled function that calls the law with a number, by comparing it with one number after the other."""
    known = {f"law_{number_of(law)}": law for law in laws if law is not delay_law}
    lines = [
        f"    if code == {name.removeprefix('law_')}:\n        {call(name, list(inspect.signature(law).parameters))}"
        for name, law in known.items()
    ]
    name, _, arguments = head.partition("(")
    body = "\n".join([*lines, f"    return {unknown}"])
    # What is compiled is kept under the name: other laws, another name.
    full = f"{name}_{zlib.crc32(body.encode()):08x}"
    scope: dict[str, Any] = {"__name__": __name__, "nan": np.nan, **known}
    exec(compile(f"def {full}({arguments}:\n{body}\n", __file__, "exec"), scope)
    made = scope[full]
    made.__doc__ = doc
    return jit(made)


torque_of = _by_number(
    "torque_of(code, p0, p1, p2, p3, s0, s1, s2, q, v, load)",
    "s0, s1, s2, nan",
    TORQUES,
    torque_call,
    "State (three numbers) and torque of the law ``code`` with parameters ``p`` and state ``s``.",
)
command_of = _by_number(
    "command_of(code, p0, s0, dt, tau)",
    "s0, nan",
    COMMANDS,
    _command_call,
    "State and torque that the drive gives when ``tau`` is asked for, by any law but that of a delay.",
)
reading_of = _by_number(
    "reading_of(code, p0, p1, p2, q)", "nan", READINGS, _reading_call, "Reading of an encoder at position ``q``."
)
