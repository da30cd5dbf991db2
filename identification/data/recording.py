"""Data types of a recording before any processing.

A `RawTable` holds columns under the names of the file, a `Table` holds them under the standard names (``t``,
``q.<joint>``, ...), and a `Recording` has arrays with one column per joint in the robot's order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from identification.data.drive_loop import DriveLoop
from identification.notes import Note, Remark
from phantom_dyn.array_types import Array, Float

_MOST_LISTED = 5  # largest number of times that a sentence lists


def row_place(row: int) -> str:
    """Words for the place of sample ``row`` (from 0) in a file without lines."""
    return f"row {row + 1}"


@dataclass(frozen=True)
class Table:
    """Columns of a file under their standard names (``t``, ``q.<joint>``, ...), before any robot is known.

    Attributes:
        file: Name of the file, for messages.
        columns: One 1-D float array per column, all of the same length.
        warnings: Warnings from reading, such as dropped repeated rows.
        compensated: Parts that a controller had subtracted from the torque of a joint, ``gravity``, ``friction`` or
            both; the key ``""`` stands for all joints.
        low_pass: Cut-off [Hz] of a first-order low pass that was applied to the torque of a joint and not to its
            position; the key ``""`` stands for all joints.
        named: Column of the file for each standard name in the user's column map; empty without a map.
        references_held: True if the format says that a reference acts from its sample to the next one.
        late: Time [s] by which the torque of a joint was recorded late; the key ``""`` stands for all joints.
    """

    file: str
    columns: Mapping[str, Float[Array, " _"]]
    warnings: tuple[str, ...] = ()
    compensated: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    low_pass: Mapping[str, float] = field(default_factory=dict)
    named: Mapping[str, str] = field(default_factory=dict)
    references_held: bool = False
    late: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RawTable(Table):
    """Columns of a file under the file's own names; lengths may differ.

    Attributes:
        problems: For each column that could not be read, the message of the error that its use raises.
        place: Words for the place of a sample (from 0) in the file, for messages.
        joint_names: Names of the joints of numbered columns such as ``q[0]``, if the file states them.
        numbered: True for a format that defines its numbered columns ``q[0]``, ``tau[0]``, ..., so that no map is
            needed.
        asks_units: True for a format that does not state the units of its joints, so that a column map has to.
        documented_joint_orders: Sequences of joint names that the format's documentation gives for its numbered
            columns; empty if it gives none.
    """

    problems: Mapping[str, str] = field(default_factory=dict)
    place: Callable[[int], str] = row_place
    joint_names: tuple[str, ...] = ()
    numbered: bool = False
    asks_units: bool = False
    documented_joint_orders: tuple[tuple[str, ...], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All column names, readable or not."""
        return (*self.columns, *self.problems)


@dataclass(frozen=True)
class BaseReadings:
    """Measurements of the sensors on a floating base, in the axes of the sensors' frames.

    Attributes:
        gyroscope: Frame of the gyroscope.
        accelerometer: Frame of the accelerometer.
        w: Angular velocity [rad/s], ``(N, 3)``.
        sf: Specific force [m/s^2], ``(N, 3)``.
        contacts: For each frame 1 while it touches something and 0 while it does not, shape ``(N,)``.
    """

    gyroscope: str
    accelerometer: str
    w: Float[Array, "N 3"]
    sf: Float[Array, "N 3"]
    contacts: Mapping[str, Float[Array, " N"]] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault:
    """A certain error of a recording, with which a diagnosis would be meaningless.

    Attributes:
        what: The fault as a clause, such as ``the positions of j1 and j2 are in degrees``.
        why: The evidence, with figures.
        mend: What to do about it; if a column map corrects the error, with the entries to copy into the map.
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
        temperature: Temperature of the drives [deg C], NaN for joints without a column.
        supply: Supply voltage of the drives [V], ``(N,)``.
        forces: Measured external forces [N] by frame, world axes, each ``(N, 3)``.
        positions: Measured positions [m] by frame, in the axes of the measuring device, each ``(N, 3)``.
        orientations: Measured orientations by frame as unit quaternions x, y, z, w, each ``(N, 4)``; each frame has a
            position as well.
        excluded: Intervals of time [s] that are left out of every fit.
        warnings: Sentences about the data.
        notes: Notes of later stages of the diagnosis on the recording.
        passive_q: Measured positions [rad or m] of passive joints of a closed chain by joint, each ``(N,)``.
        controlled: True if no torque was recorded, and ``tau`` is computed from the stated controllers.
        gains_estimated: Joints whose controllers were not stated, and whose gains were estimated from the motion.
        torque_from: The quantity that gave the torque of each joint: ``tau``, ``i`` or ``u``; empty if unknown.
        velocity_gain: Gain d [N m s/rad or N s/m], ``(nv,)``, of joints whose computed torque contains -d v (back-EMF,
            velocity gain of a controller). This v is a finite difference of positions. Later, -d v is computed again
            from filtered positions. None if there is no such joint.
        loops: Estimated position controller of each drive, None if it has none; empty if not estimated.
        references_held: True if the format or the robot says that a reference acts from its sample to the next.
        reference_gain: Torque per unit of the reference [N m/rad or N/m] if ``tau`` was computed from references, zero
            for other joints, ``(nv,)``; None if there is no such joint.
        reference_torque_limit: Limit of the torque from references, ``(nv,)``; None if ``reference_gain`` is None.
        friction_subtracted: Joints from whose torque a controller had subtracted friction. The model's friction is
            added when the velocities have been computed.
        unread: Joints whose torque was not measured in some rows. Their drives count as unknown.
        wrong: Certain faults; a recording with one is refused, see `identification.data.refusal`.
        anyway: True if the recording is used in spite of certain faults.
        named: Column of the file for each standard name in the user's column map; empty without a map.
        base: Readings of the sensors on a floating base; None for a fixed one.
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
    velocity_gain: Float[Array, " nv"] | None = None
    loops: tuple[DriveLoop | None, ...] = ()
    references_held: bool = False
    reference_gain: Float[Array, " nv"] | None = None
    reference_torque_limit: Float[Array, " nv"] | None = None
    friction_subtracted: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()
    wrong: tuple[Fault, ...] = ()
    anyway: bool = False
    named: Mapping[str, str] = field(default_factory=dict)
    base: BaseReadings | None = None

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Warnings and notes on the recording; those from reading come first."""
        return (*self.warnings, *self.notes)

    @property
    def poses_alone(self) -> bool:
        """True if the recording has measured poses and neither torque nor references."""
        return bool(self.positions) and self.tau is None and self.q_ref is None


def time_text(t: float) -> str:
    """A time [s] with six digits; from 1000 s on to the millisecond, as times since 1970 need more digits."""
    return f"{t:.6g}" if abs(t) < 1e3 else f"{t:.3f}".rstrip("0").rstrip(".")


def when(t: Float[Array, " n"]) -> str:
    """Words for several times [s], of which only the first few are listed."""
    more = f" and {len(t) - _MOST_LISTED} more" if len(t) > _MOST_LISTED else ""
    return "at t = " + ", ".join(time_text(time) for time in t[:_MOST_LISTED]) + f" s{more}"
