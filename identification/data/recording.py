"""The three stages of a recording before any processing: a file's own columns, named columns, a robot's joints.

`RawTable` holds columns under the names of the file, `Table` under the contract's (``t``, ``q.<joint>``, ...), and
`Recording` one column per joint in the robot's order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from identification.data.drive_loop import DriveLoop
from identification.notes import Note, Said
from phantom_dyn.array_types import Array, Float


def row_place(row: int) -> str:
    """Where sample ``row`` (from 0) stands in a file that has no lines."""
    return f"row {row + 1}"


@dataclass(frozen=True)
class RawTable:
    """Columns of a file under the file's own names.

    Attributes:
        file: Name of the file, for messages.
        columns: One 1-D float array per column that could be read as numbers; lengths may differ.
        problems: For each other column the sentence to raise if somebody wants it.
        place: Where a sample (from 0) stands in the file, as its reader would say it.
        warnings: What was noticed while reading.
        compensated: What a controller had taken out of the torque of a joint, ``gravity``, ``friction`` or both; ``""``
            is all joints.
        low_pass: Cut-off [Hz] of the low pass of first order that the torque of a joint went through, and the positions
            did not; ``""`` is all joints.
        joint_names: Of the joints that columns number, as in ``q[0]``, where the file states them.
        numbered: True for a format that says what its numbered columns ``q[0]``, ``tau[0]``, ... are, so that no map is
            needed.
        asks_units: True for a format that does not say in which units its joints are, so that a map has to.
        motor_orders: Orders of joint names that the format's documentation gives for its numbers, if it does.
        named: By the contract's name, the column of the file that a map of the user's took; empty without one.
        references_held: True if the format says that a reference acts from its sample to the next.
    """

    file: str
    columns: Mapping[str, Array]
    problems: Mapping[str, str] = field(default_factory=dict)
    place: Callable[[int], str] = row_place
    warnings: tuple[str, ...] = ()
    compensated: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    low_pass: Mapping[str, float] = field(default_factory=dict)
    joint_names: tuple[str, ...] = ()
    numbered: bool = False
    asks_units: bool = False
    motor_orders: tuple[tuple[str, ...], ...] = ()
    named: Mapping[str, str] = field(default_factory=dict)
    references_held: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """All column names, readable or not."""
        return (*self.columns, *self.problems)


@dataclass(frozen=True)
class Table:
    """Columns of a file under the contract's names (``t``, ``q.<joint>``, ...), before any robot is known.

    Attributes:
        file: Name of the file, for messages.
        columns: One 1-D float array per column, all of the same length.
        warnings: What was noticed while reading (dropped repeated rows and the like).
        compensated: What a controller had taken out of the torque of a joint, ``gravity``, ``friction`` or both; ``""``
            is all joints.
        low_pass: Cut-off [Hz] of the low pass of first order that the torque of a joint went through, and the positions
            did not; ``""`` is all joints.
        named: By the contract's name, the column of the file that a map of the user's took; empty without one.
        references_held: True if the format says that a reference acts from its sample to the next.
    """

    file: str
    columns: Mapping[str, Float[Array, " N"]]
    warnings: tuple[str, ...] = ()
    compensated: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    low_pass: Mapping[str, float] = field(default_factory=dict)
    named: Mapping[str, str] = field(default_factory=dict)
    references_held: bool = False


@dataclass(frozen=True)
class BaseReadings:
    """What the sensors on a base read that is not bolted down, in the axes of their frames.

    Attributes:
        gyroscope: Frame of the gyroscope.
        accelerometer: Frame of the accelerometer.
        w: Angular velocity [rad/s], ``(N, 3)``.
        sf: Specific force [m/s^2], ``(N, 3)``.
        contacts: 1 while a frame touches something, 0 while it does not, by frame, each ``(N,)``.
    """

    gyroscope: str
    accelerometer: str
    w: Float[Array, "N 3"]
    sf: Float[Array, "N 3"]
    contacts: Mapping[str, Float[Array, " N"]] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault:
    """One thing that is certainly wrong with a recording, so that a diagnosis of it would mean nothing.

    Attributes:
        what: The end of a sentence, such as ``the positions of j1 and j2 are in degrees``.
        why: What shows it, with figures.
        mend: What to do; where entries of a column map mend it, they are in it ready to copy.
    """

    what: str
    why: str
    mend: str


@dataclass(frozen=True)
class Recording:
    """Raw samples of one recording for the joints of one robot; None where a quantity was not recorded.

    Attributes:
        file: Name of the file, for messages.
        joint_names: The robot's joints, in its order; second axis of every array.
        t: Time [s], strictly increasing, shape ``(N,)``.
        q: Measured positions [rad or m], shape ``(N, nv)``.
        tau: Drive torque on the joint side [N m or N]; zeros for joints that are not actuated.
        v: Measured velocities.
        current: Motor currents [A].
        voltage: Motor voltages [V].
        q_ref: References of the position controllers.
        v_ref: References of the velocity controllers.
        x: Link-side positions of a second encoder.
        temperature: Of the drives [deg C], NaN for joints without a column.
        supply: Voltage that feeds the drives [V], ``(N,)``.
        forces: Measured external forces [N] by frame, world axes, each ``(N, 3)``.
        positions: Measured positions [m] by frame, in the axes of whatever measured them, each ``(N, 3)``.
        orientations: Measured orientations by frame as unit quaternions x, y, z, w, each ``(N, 4)``; each frame has a
            position as well.
        excluded: Stretches of time [s] that are left out of every fit.
        warnings: Sentences about the data.
        notes: What later stages have to say of it.
        passive_q: Measured positions [rad or m] of passive joints of a closed chain by joint, each ``(N,)``.
        controlled: True if no torque was recorded, and ``tau`` is what the stated controllers ask for.
        gains_estimated: Joints whose controller nobody has stated, so that its gains were estimated from the motion.
        torque_from: The quantity that gave the torque of each joint: ``tau``, ``i`` or ``u``; empty where not known.
        slowing: Torque per velocity [N m s/rad or N s/m] by which ``tau`` falls with speed, where it was computed with
            differences of positions (back-EMF, damping of a controller), ``(nv,)``: whoever filters the positions
            computes it anew. None: nowhere.
        loops: What regression says of each drive's own loop, None where nothing; empty where nobody looked.
        references_held: True if the format or the robot says that a reference acts from its sample to the next.
        follows: Torque per unit of the reference [N m/rad or N/m] where ``tau`` was computed from references, zero
            elsewhere, ``(nv,)``; None: nowhere.
        follows_up_to: Where that part of the torque is clipped, ``(nv,)``; None with it.
        friction_taken: Joints from whose torque a controller had taken friction: the model's is put back once the
            velocities are known.
        wrong: What is certainly wrong with it; such a recording is refused, see `identification.data.refusal`.
        anyway: True if it is to be judged although something is wrong with it.
        named: By the contract's name, the column of the file that a map of the user's took; empty without one.
        base: What the sensors on a base read that is not bolted down; None for one that is.
    """

    file: str
    joint_names: tuple[str, ...]
    t: Float[Array, " N"]
    q: Float[Array, "N nv"]
    tau: Float[Array, "N nv"] | None
    v: Float[Array, "N nv"] | None = None
    current: Float[Array, "N nv"] | None = None
    voltage: Float[Array, "N nv"] | None = None
    q_ref: Float[Array, "N nv"] | None = None
    v_ref: Float[Array, "N nv"] | None = None
    x: Float[Array, "N nv"] | None = None
    temperature: Float[Array, "N nv"] | None = None
    supply: Float[Array, " N"] | None = None
    forces: Mapping[str, Float[Array, "N 3"]] = field(default_factory=dict)
    positions: Mapping[str, Float[Array, "N 3"]] = field(default_factory=dict)
    orientations: Mapping[str, Float[Array, "N 4"]] = field(default_factory=dict)
    excluded: tuple[tuple[float, float], ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[Note, ...] = ()
    passive_q: Mapping[str, Float[Array, " N"]] = field(default_factory=dict)
    controlled: bool = False
    gains_estimated: tuple[str, ...] = ()
    torque_from: Mapping[str, str] = field(default_factory=dict)
    slowing: Float[Array, " nv"] | None = None
    loops: tuple[DriveLoop | None, ...] = ()
    references_held: bool = False
    follows: Float[Array, " nv"] | None = None
    follows_up_to: Float[Array, " nv"] | None = None
    friction_taken: tuple[str, ...] = ()
    wrong: tuple[Fault, ...] = ()
    anyway: bool = False
    named: Mapping[str, str] = field(default_factory=dict)
    base: BaseReadings | None = None

    @property
    def said(self) -> tuple[Said, ...]:
        """Everything that there is to say of it, what was read first."""
        return (*self.warnings, *self.notes)

    @property
    def poses_alone(self) -> bool:
        """True if it holds measured poses of a frame and neither torque nor references."""
        return bool(self.positions) and self.tau is None and self.q_ref is None
