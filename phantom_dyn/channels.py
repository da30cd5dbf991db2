"""The effects' channels in a simulation that Python steps: commands, torques and readings with their states."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phantom_dyn.effects.effect import Moment, Simulated
from phantom_dyn.errors import ParameterError
from phantom_dyn.stepping import Machine, State

Array = np.ndarray

# What a drive is asked for [N m or N], shape (nv,), from time, position readings and velocities at the encoders.
Controller = Callable[[float, Array, Array], Array]


class Channels:
    """The effects' channels with their states, which move on with every step."""

    def __init__(self, machine: Machine, parts: tuple[Simulated, ...], controller: Controller, *, held: bool):
        self._controller, self._held = controller, held
        self._seen, self._drives = list(machine.encoders), list(machine.drives)
        self._readings = [part.reading for part in parts if part.reading is not None]
        self._commands = [part.command for part in parts if part.command is not None]
        self._laws = [part.torque for part in parts if part.torque is not None]
        self._command_states = [part.start for part in parts if part.command is not None]
        self._law_states = [part.start for part in parts if part.torque is not None]
        self._asked = np.zeros(machine.robot.nv)
        self._given: Array | None = None

    def reading(self, state: State) -> Array:
        """Position readings of a state."""
        return self._read(state.x[self._seen])

    def _read(self, q: Array) -> Array:
        for reading in self._readings:
            q = reading(q)
        return q

    def sample(self, t: float, state: State) -> tuple[Array, Array]:
        """What the drives are asked for at a sample, and what they gave in the step before it."""
        self._asked = self.ask(t, state.x, state.v)
        return self._asked, self._asked if self._given is None else self._given

    def ask(self, t: float, x: Array, v: Array) -> Array:
        """What the controller asks of the drives in a state."""
        tau = np.asarray(self._controller(t, self._read(x[self._seen]), v[self._seen]), dtype=float)
        if tau.shape != (len(self._drives),):
            wanted = f"wanted {len(self._drives)} numbers, one a joint"
            raise ParameterError(f"The controller gave a torque of shape {tau.shape}, {wanted}.")
        return tau

    def torques(self, h: float) -> Callable[[float, Array, Array, Array], tuple[Array, Array]]:
        """Drive torque and the effects' torques for one step of ``h`` seconds."""

        def at(t: float, x: Array, v: Array, transmitted: Array) -> tuple[Array, Array]:
            tau = self._asked if self._held else self.ask(t, x, v)
            for i, command in enumerate(self._commands):
                self._command_states[i], tau = command(self._command_states[i], h, tau)
            self._given = tau
            added = np.zeros(len(tau))
            if not self._laws:
                return tau, added
            moment = Moment(t, x[self._drives], v[self._drives], transmitted)
            for i, law in enumerate(self._laws):
                self._law_states[i], torque = law(self._law_states[i], h, moment)
                added = added + torque
            return tau, added

        return at
