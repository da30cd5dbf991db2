"""What every effect of the catalogue provides."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.robot import Robot

Array = np.ndarray
# What the torque is not linear in (a Stribeck velocity, the orders of a cogging torque); () if there is nothing.
Shape = tuple[float, ...]


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
        steps: The part of the columns that is made of the signs of velocities: it has no noise of accelerations.
    """

    rows: tuple[int, ...]
    columns: Float[Array, "N m k"]
    names: tuple[str, ...]
    units: tuple[str, ...]
    steps: Float[Array, "N m k"] | None = None


@dataclass(frozen=True)
class Moment:
    """One instant of a simulation, as a torque law sees it; arrays have one entry per joint.

    Attributes:
        t: Time [s].
        q: True joint positions [rad or m].
        v: True joint velocities.
        transmitted: Torque that the transmissions pass to the links.
    """

    t: float
    q: Float[Array, " nv"]
    v: Float[Array, " nv"]
    transmitted: Float[Array, " nv"]


@dataclass(frozen=True)
class Transmission:
    """A joint whose motor and link may move apart: a spring behind a play of full width ``gap``."""

    joint: str
    stiffness: float
    damping: float
    gap: float


@dataclass(frozen=True)
class Law:
    """A channel of `Simulated` on one joint, for compiled steps: a function that `simulation_laws` lists.

    Attributes:
        function: Compiled law on scalars, in the effect's own file.
        row: The joint.
        numbers: Its parameters, at most four.
        start: Its state at the start, at most three numbers.
        other: A joint whose speed counts too, ``share`` times, and that takes ``share`` of the torque.
        share: See ``other``.
    """

    function: Callable
    row: int
    numbers: tuple[float, ...] = ()
    start: tuple[float, ...] = ()
    other: int = 0
    share: float = 0.0


@dataclass(frozen=True)
class Simulated:
    """How one effect enters a simulation: the channels that it changes, and its state; None leaves a channel alone.

    Attributes:
        start: State at the start.
        robot: Rigid-body model that moves instead of the given one.
        command: ``(state, dt, tau) -> (state, tau)``: what the drive gives when ``tau`` is asked for.
        torque: ``(state, dt, moment) -> (state, torque)``: torque that it adds on the joints.
        reading: Position readings ``(nv,)`` from true positions at the encoders.
        transmission: A motor that is not rigidly tied to its link.
        inertia: What it adds to the joints' mass matrix, shape ``(nv, nv)``.
        laws: The same command, torque or reading once more, compiled; empty if there is only the Python above.
    """

    start: Float[Array, " s"] = field(default_factory=lambda: np.zeros(0))
    robot: Callable[[Robot], Robot] | None = None
    command: Callable[[Array, float, Array], tuple[Array, Array]] | None = None
    torque: Callable[[Array, float, Moment], tuple[Array, Array]] | None = None
    reading: Callable[[Array], Array] | None = None
    transmission: Transmission | None = None
    inertia: Float[Array, "nv nv"] | None = None
    laws: tuple[Law, ...] = ()


class Rival(ABC):
    """A cause that leaves columns in inverse dynamics; ``joint`` is None where it is one of the whole robot.

    The coefficients are what the measured torque is linear in, once the ``shape`` (a Stribeck velocity) is fixed. A law
    that is not linear in its parameter at all (a delay) takes its last estimate as shape: its column is the change of
    torque per unit of the parameter between zero and the shape, so that the law is exact where coefficient and shape
    agree.

    Attributes:
        name: The contract's, or one of its own for a cause that the catalogue has no name for.
        scope: Whether it sits on a joint (a name, or two joined by ``+``), on the whole robot, or on either.
        regime: Where the effect shows most.
        contains: Names of the effects that are special cases of it.
        uses_acceleration: True if its columns carry the noise of a twice differentiated position.
        shape_is_estimate: True if the shape is the last estimate of a coefficient, and no parameter of its own.
        follows_torque: True if its columns are made of the modelled torque, other findings included.
        stays: True if its columns of one shape stay the same whatever a fit has found: they are not made of the
            ``expected`` torque or of what a fit leaves.
    """

    name: str
    scope: Literal["joint", "robot", "either"] = "joint"
    regime: str
    contains: tuple[str, ...] = ()
    uses_acceleration: bool = False
    shape_is_estimate: bool = False
    follows_torque: bool = False
    stays: bool = False

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """Where it may sit: every joint, the whole robot (None), or both."""
        if self.scope == "robot":
            return (None,)
        return (None, *robot.joint_names) if self.scope == "either" else robot.joint_names

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Shapes to try at first: one that is empty if the torque is linear in every parameter."""
        return ((),)

    def refined(self, coefficients: Float[Array, " k"], shape: Shape) -> tuple[Shape, ...]:
        """Shapes to try next, about a fit: the same and its neighbours, or the last estimate of a secant."""
        return (shape,)

    def at_estimate(self, coefficients: Float[Array, " k"], shape: Shape) -> Shape:
        """The shape at which a law that takes its own parameter as shape agrees with its coefficients."""
        near = self.refined(coefficients, shape)
        return near[len(near) // 2]

    @abstractmethod
    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Columns of the effect, see `Signature`."""

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower and upper bound of each coefficient where physics has any; empty if it has none at all."""
        return ()

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Why no recording like this one can show the effect, in words; None if it may."""
        return None


class Effect(Rival):
    """One cause of a gap between robot and model that the catalogue has a name for.

    The parameters are the contract's; where they are what the torque is linear in, they are the coefficients.

    Attributes:
        seen_by: What makes it large: its coefficients, its shape (coefficient one is the whole effect), or neither,
            where no size is too small to be seen.
    """

    stays: bool = True
    seen_by: Literal["coefficient", "shape", "neither"] = "coefficient"

    @abstractmethod
    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """The contract's parameters with units and bounds."""

    def from_coefficients(
        self, robot: Robot, joint: str | None, coefficients: Float[Array, " k"], shape: Shape
    ) -> Float[Array, " p"]:
        """The contract's parameters, in the order of `parameters`, from linear coefficients."""
        return coefficients

    @abstractmethod
    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Float[Array, " k"]]:
        """The parameter that says how large the effect is, and the coefficients of one unit of it."""

    def probe_unit(self, robot: Robot, joint: str | None, name: str) -> str:
        """Unit of what `probe` names."""
        return next(parameter.unit for parameter in self.parameters(robot, joint) if parameter.name == name)

    @abstractmethod
    def torque(
        self, robot: Robot, operation: Operation, joint: str | None, theta: Float[Array, " p"]
    ) -> Float[Array, "N nv"]:
        """Torque that the effect adds on the joints (friction opposes motion), from the contract's parameters.

        For an effect of a reading, of the drive or of the transmission: minus the drive torque beyond the model's
        that the recording shows because of it.
        """

    @abstractmethod
    def simulated(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> Simulated:
        """How it enters a simulation, with the contract's parameters."""
