"""The compiled laws of the catalogue, gathered from the files of its effects, and what calls one by its number.

A law is marked where it stands, see `phantom_dyn.effects.simulated.torque_law`; its number is its place here, in the
order of the catalogue. An effect without a marked law is stepped in Python, and every effect beside it. Scalars in and
out: a law that took an array would cost more than its numbers, for counting who holds the array.

Compiled code cannot call a function that it finds in a list, so the text of the functions below is made of the list.
Numba does not see that a function which calls these must be compiled anew after a change of an effect's law or of the
catalogue: delete the ``__pycache__`` of `phantom_dyn.simulation.compiled` then.
"""

from __future__ import annotations

import inspect
import sys
import zlib
from collections.abc import Callable
from typing import Any

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


TORQUES, COMMANDS, READINGS = laws_of("torque"), laws_of("command"), laws_of("reading")
# The one law with a memory too long for scalars: kernels call it themselves.
DELAY = COMMANDS.index(delay_law)


def _torque_call(law: str, names: list[str]) -> str:
    """State and torque of a law: ``s0`` is the position of the step before, where it has a memory."""
    first = next((k for k, name in enumerate(names) if name in _INPUTS), 0)
    remembered = [f"s{k + 1}" for k in range(first - 1)]
    inputs = [name for name in names if name in _INPUTS]
    numbers = [f"p{k}" for k in range(len(names) - first - len(inputs))]
    if names[0] != "last":
        return f"return s0, s1, s2, {law}({', '.join([*inputs, *numbers])})"
    call = f"{law}({', '.join(['s0', *remembered, *inputs, *numbers])})"
    return f"{', '.join([*remembered, 'torque'])} = {call}; return q, s1, s2, torque"


def _command_call(law: str, names: list[str]) -> str:
    return f"return {law}(s0, tau, dt, p0)" if "dt" in names else f"return s0, {law}(tau, p0)"


def _reading_call(law: str, names: list[str]) -> str:
    return f"return {law}({', '.join(['q', *(f'p{k}' for k in range(len(names) - 1))])})"


def _by_number(
    name: str, arguments: str, laws: tuple[LawFunction, ...], call: Callable[[str, list[str]], str], doc: str
) -> LawFunction:
    """A compiled function that calls the law with a number, by comparing it with one number after the other."""
    known = {k: law for k, law in enumerate(laws) if law is not delay_law}
    calls = [(k, call(f"law_{k}", list(inspect.signature(law).parameters))) for k, law in known.items()]
    lines = [f"    if code == {k}:\n        {text}" for k, text in calls[:-1]]
    lines.append(f"    {calls[-1][1]}")
    text = "\n".join(lines)
    # What is compiled is kept under the name: other laws, another name.
    said = text + " ".join(law.__name__ for law in laws)
    full = f"{name}_{zlib.crc32(said.encode()):08x}"
    scope: dict[str, Any] = {"__name__": __name__, **{f"law_{k}": law for k, law in known.items()}}
    exec(compile(f"def {full}({arguments}):\n{text}\n", __file__, "exec"), scope)
    made = scope[full]
    made.__doc__ = doc
    return jit(made)


torque_of = _by_number(
    "torque_of",
    "code, p0, p1, p2, p3, s0, s1, s2, q, v, load",
    TORQUES,
    _torque_call,
    "State (three numbers) and torque of the law ``code`` with parameters ``p`` and state ``s``.",
)
command_of = _by_number(
    "command_of",
    "code, p0, s0, dt, tau",
    COMMANDS,
    _command_call,
    "State and torque that the drive gives when ``tau`` is asked for, by any law but that of a delay.",
)
reading_of = _by_number(
    "reading_of", "code, p0, p1, p2, q", READINGS, _reading_call, "Reading of an encoder at position ``q``."
)
