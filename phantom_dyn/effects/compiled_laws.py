"""Collects the compiled laws of all effects, and makes compiled functions that call a law by its number.

The file of an effect marks its laws with a decorator, see `phantom_dyn.effects.simulated.torque_law`. The number of a
law is a checksum of its name. If an effect has no marked law, the whole simulation is stepped in Python. Laws take and
return scalars: for an array, numba would count references, which takes longer than the law itself.

Compiled code cannot call a function from a list. So this module writes the source of a function that compares the given
number with the number of each law, and compiles this function. It returns NaN for an unknown number.

After a change of a law or of the catalogue, the callers of this function have to be compiled again, which numba does
not notice: delete the ``__pycache__`` of `phantom_dyn.simulation.compiled` then.
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

# Arguments of a torque law that describe the state of the joint; its parameters follow them.
_INPUTS = ("q", "v", "load")


def laws_of(channel: Channel) -> tuple[LawFunction, ...]:
    """Compiled laws of a channel, in the order of the catalogue and of the file."""
    files = dict.fromkeys(type(effect).__module__ for effect in EFFECTS)
    marked = (value for file in files for value in vars(sys.modules[file]).values() if channel_of(value) == channel)
    return tuple(dict.fromkeys(marked))


def number_of(law: LawFunction) -> int:
    """Number of a law, which does not depend on the other laws of the catalogue."""
    return zlib.crc32(f"{law.__module__}.{law.__name__}".encode())


TORQUES, COMMANDS, READINGS = laws_of("torque"), laws_of("command"), laws_of("reading")
DELAY = number_of(delay_law)
"""Number of the delay law. Its state does not fit into scalars, so that simulations call it directly."""


def torque_call(law: str, names: list[str]) -> str:
    """Source of the return statement that calls a torque law: new state (``s0``, ``s1``, ``s2``), then the torque.

    For a law with a memory, ``s0`` is the position at the step before.

    Args:
        law: Name of the law in the source.
        names: Names of the law's arguments.

    Raises:
        TypeError: If the arguments are not in the order of `phantom_dyn.effects.simulated.torque_law`.
    """
    # Arguments of a law: ``first`` numbers of memory, then inputs, then parameters.
    inputs = [name for name in names if name in _INPUTS]
    first = names.index(inputs[0]) if inputs else 0
    numbers = [f"p{k}" for k in range(len(names) - first - len(inputs))]
    remembers = names[0] == "last"
    if names[first : first + len(inputs)] != inputs or remembers != (first > 0) or first > 3 or len(numbers) > 4:
        raise TypeError(
            f"A torque law takes {', '.join(names)}: give it last and at most two numbers of memory if it has a "
            f"memory, then those of {', '.join(_INPUTS)} that it needs, then at most four parameters."
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
    """A compiled function that calls the law with a given number.

    Args:
        head: Name and arguments of the function, as in ``reading_of(code, q)``; ``code`` is the number of a law.
        unknown: Source of the values that are returned for an unknown number.
        laws: The laws.
        call: Function that writes the statement that calls a law, from the law's name and its arguments.
        doc: Docstring of the made function.
    """
    known = {f"law_{number_of(law)}": law for law in laws if law is not delay_law}
    lines = [
        f"    if code == {name.removeprefix('law_')}:\n        {call(name, list(inspect.signature(law).parameters))}"
        for name, law in known.items()
    ]
    name, _, arguments = head.partition("(")
    body = "\n".join([*lines, f"    return {unknown}"])
    # Numba caches compiled code by the name of the function, so that other laws need another name.
    cached_as = f"{name}_{zlib.crc32(body.encode()):08x}"
    scope: dict[str, Any] = {"__name__": __name__, "nan": np.nan, **known}
    exec(compile(f"def {cached_as}({arguments}:\n{body}\n", __file__, "exec"), scope)
    made = scope[cached_as]
    made.__doc__ = doc
    return jit(made)


torque_of = _by_number(
    "torque_of(code, p0, p1, p2, p3, s0, s1, s2, q, v, load)",
    "s0, s1, s2, nan",
    TORQUES,
    torque_call,
    "New state (three numbers) and torque of the law ``code`` with parameters ``p`` and state ``s``.",
)
command_of = _by_number(
    "command_of(code, p0, s0, dt, tau)",
    "s0, nan",
    COMMANDS,
    _command_call,
    "New state, and torque that the drive gives for the command ``tau``; for every law except the delay.",
)
reading_of = _by_number(
    "reading_of(code, p0, p1, p2, q)", "nan", READINGS, _reading_call, "Reading of an encoder at position ``q``."
)
