"""Results of the Python interface: identifications, reference motions and simulated recordings."""

from __future__ import annotations

import html
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from identification.data.checks.check_recording import checked
from identification.data.recording import Recording
from identification.excitation.excite import Excitation
from identification.export.log_and_map_files import write_log
from identification.identify.identification import IdentifiedModel, Parameter
from identification.identify.identification_files import write_outputs
from identification.identify.identification_words import headline, summary
from phantom_dyn.arguments import FILE, FOLDER, NUMBER, SEED, takes
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import UsageError
from phantom_dyn.libraries import optional_library
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.simulate import Simulation

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, repr=False, eq=False)
class Identification:
    """Parameters of a robot that were estimated from recordings; ``print`` shows the summary of the command line.

    Attributes:
        result: All results, as in ``identification.json``.
        robot: The given model.
    """

    result: IdentifiedModel
    robot: Robot

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Base parameters of the links, then friction and drives: name, value, std, unit."""
        return (*self.result.base, *self.result.others)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the recordings and the estimate."""
        return self.result.warnings

    def __str__(self) -> str:
        return summary(self.result)

    def __repr__(self) -> str:
        return f"Identification of {self.robot.name} ({self.result.estimator})\n{headline(self.result)}"

    def _repr_html_(self) -> str:
        first, second = (html.escape(line) for line in repr(self).splitlines())
        return f"<p><b>{first}</b><br>{second}</p>"

    def to_dataframe(self) -> pandas.DataFrame:
        """One row per parameter: value, standard deviation, unit, and True if it is identified (differs from zero)."""
        pandas = optional_library("pandas")
        names = ("name", "value", "std", "unit", "regroups", "identified", "joint", "effect")
        rows = [{name: getattr(parameter, name) for name in names} for parameter in self.parameters]
        return pandas.DataFrame(rows, columns=list(names))

    @takes(folder=FOLDER)
    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write ``identification.json``, ``report.html`` and the corrected models into a folder; returns their paths.

        Raises:
            UsageError: If a file cannot be written.
        """
        return write_outputs(self.result, Path(folder))


class Columns(Protocol):
    """Base of results that are columns of a log: they can be converted to a table and written to a file."""

    def columns(self) -> dict[str, Float[Array, " N"]]:
        """The columns by name, all of the same length."""
        ...

    def to_dataframe(self) -> pandas.DataFrame:
        """The columns as a table."""
        return optional_library("pandas").DataFrame(self.columns())

    @takes(file=FILE)
    def save(self, file: str | Path) -> Path:
        """Write the columns as CSV, NPZ or Parquet, as the ending of the file states; returns its path.

        Raises:
            UsageError: If the ending is none of these, or the file cannot be written.
        """
        write_log(Path(file), self.columns())
        return Path(file)


@dataclass(frozen=True, repr=False, eq=False)
class Reference(Columns):
    """A reference motion for a robot, from rest to rest; ``print`` shows its excitation and the limits it reaches.

    Attributes:
        design: The design of the motion.
        rate_hz: Sample rate [Hz].
    """

    design: Excitation
    rate_hz: float

    @property
    def motion(self) -> Motion:
        """Time, positions, velocities and accelerations of the joints."""
        return self.design.motion(self.rate_hz)

    @property
    def robot(self) -> Robot:
        """The robot for which the motion was designed."""
        return self.design.robot

    def __str__(self) -> str:
        return "\n".join([self.design.summary(), *(f"Note: {note}" for note in self.design.notes)])

    def __repr__(self) -> str:
        first, _, second = self.design.summary().partition("\n")
        return f"Reference of {first}\n{second}"

    def columns(self) -> dict[str, Float[Array, " N"]]:
        """Columns ``t``, ``q_ref.<joint>``, ``v_ref.<joint>`` and ``a_ref.<joint>``."""
        return self.design.columns(self.rate_hz)


@dataclass(frozen=True, repr=False, eq=False)
class SimulatedRecording(Columns):
    """A simulated recording: times, position readings and drive torques.

    Attributes:
        robot: The model, without the simulated effects.
        simulation: The simulation, with the true motion.
    """

    robot: Robot
    simulation: Simulation

    def __repr__(self) -> str:
        t = self.simulation.t
        return (
            f"Simulated recording of {self.robot.name}: {len(t)} samples, {t[-1] - t[0]:.6g} s\n"
            f"Joints: {', '.join(self.robot.joint_names)}"
        )

    def columns(self) -> dict[str, Float[Array, " N"]]:
        """Columns ``t``, ``q.<joint>`` and ``tau.<joint>``."""
        out = {"t": np.array(self.simulation.t)}
        for name, values in (("q", self.simulation.q), ("tau", self.simulation.tau)):
            out |= {f"{name}.{joint}": np.array(values[:, k]) for k, joint in enumerate(self.robot.joint_names)}
        return out

    @takes(position_noise=NUMBER, torque_noise=NUMBER, seed=SEED)
    def recording(self, *, position_noise: float = 0.0, torque_noise: float = 0.0, seed: int = 0) -> Recording:
        """A recording to diagnose, with white noise added.

        Args:
            position_noise: Standard deviation of the noise of positions [rad or m].
            torque_noise: Standard deviation of the noise of torques [N m or N].
            seed: Seed of the noise.

        Raises:
            UsageError: If a standard deviation is negative.
        """
        if not (position_noise >= 0 and torque_noise >= 0):
            raise UsageError("a negative noise was given, wanted standard deviations of 0 or more.")
        rng = np.random.default_rng(seed)
        q, tau = self.simulation.q, self.simulation.tau
        found = Recording(
            file=f"simulated {self.robot.name}",
            joint_names=self.robot.joint_names,
            t=self.simulation.t,
            q=q + position_noise * rng.standard_normal(q.shape),
            tau=tau + torque_noise * rng.standard_normal(tau.shape),
        )
        result = checked(found, self.robot)
        return replace(found, warnings=result.warnings, wrong=result.wrong)
