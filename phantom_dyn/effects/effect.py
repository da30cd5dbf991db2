"""What every effect of the catalogue provides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


@dataclass(frozen=True)
class Parameter:
    """Name, unit and bounds of one parameter of an effect."""

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf


@dataclass(frozen=True)
class Signature:
    """What an effect leaves in inverse dynamics: drive torque needed per unit of each coefficient.

    Attributes:
        rows: Indices of the joints whose torque it touches.
        columns: Shape ``(N, len(rows), k)``; measured torque = model + ``columns @ coefficients``.
        names: One per coefficient.
        units: One per coefficient.
    """

    rows: tuple[int, ...]
    columns: Float[Array, "N m k"]
    names: tuple[str, ...]
    units: tuple[str, ...]


@runtime_checkable
class Effect(Protocol):
    """One cause of a gap between robot and model; ``joint`` is None for an effect of the whole robot.

    The parameters are the contract's; the coefficients are what the measured torque is linear in, once the
    ``shape`` parameters (a Stribeck velocity) are fixed. Where both agree, the coefficients are the parameters.
    ``regime`` is where the effect shows most; ``contains`` names the effects that are special cases of it;
    ``uses_acceleration`` says that its columns carry the noise of a twice differentiated position.
    """

    name: str
    scope: Literal["joint", "robot"]
    regime: str
    contains: tuple[str, ...]
    uses_acceleration: bool

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """The contract's parameters with units and bounds."""
        ...

    def shapes(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[float, ...]:
        """Values to try for the one parameter that the torque is not linear in; ``(nan,)`` if there is none."""
        ...

    def signature(self, robot: Robot, motion: Motion, joint: str | None, shape: float) -> Signature:
        """Columns of the effect, see `Signature`."""
        ...

    def from_coefficients(
        self, robot: Robot, joint: str | None, coefficients: Float[Array, " k"], shape: float
    ) -> Float[Array, " p"]:
        """The contract's parameters, in the order of `parameters`, from linear coefficients."""
        ...

    def probe(self, robot: Robot, motion: Motion, joint: str | None) -> tuple[str, Float[Array, " k"]]:
        """The parameter that says how large the effect is, and the coefficients of one unit of it."""
        ...

    def torque(
        self, robot: Robot, motion: Motion, joint: str | None, theta: Float[Array, " p"]
    ) -> Float[Array, "N nv"]:
        """Torque that the effect adds on the joints (friction opposes motion), from the contract's parameters."""
        ...
