"""The functions of ``import phantom_dyn as dyn``: the same as the commands, with paths or objects as arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from identification.api.diagnosed import diagnosis_of_changes, diagnosis_of_recordings, paths_of
from identification.api.diagnosis import Diagnosis
from identification.api.inputs import (
    COLUMNS,
    RecordingsLike,
    RobotLike,
    as_tuple,
    described,
    recordings_of,
    robot_of,
)
from identification.api.results import (
    Identification,
    Reference,
    SimulatedRecording,
)
from identification.api.simulated import causes_of, reference_of, tracking, with_named_effects
from identification.data import reading
from identification.data.checked_file import CheckedRecording, checked_file, checked_recording
from identification.data.recording import Recording
from identification.estimators.estimator_list import estimator_named
from identification.excitation.excite import PlannedRecording
from identification.excitation.excite import excite as designed
from identification.excitation.limits import limits_of
from identification.excitation.motion_shapes import FourierSeries
from identification.export.known_model import known_model
from identification.identify.identified_model import JointTerms, friction_terms
from identification.identify.identify import identify as identified
from identification.reporting import comparison
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from identification.words.stage_words import in_words
from phantom_dyn.arguments import (
    FLAG,
    NAMES,
    NUMBER,
    NUMBERS,
    SEED,
    STRETCHES,
    TEXT,
    TEXT_CALLBACK,
    WHOLE,
    or_none,
    path_of,
    takes,
)
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.user.user_effects import EffectsLike, with_user_effects
from phantom_dyn.errors import UsageError
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.operational_map import dataset, operational_map
from phantom_dyn.model.robot_files import looks_like_robot
from phantom_dyn.motion import Motion
from phantom_dyn.simulation import simulate as simulation

if TYPE_CHECKING:
    import xarray

Paths = str | Path | Iterable[str | Path]
EffectLike = tuple[str | Effect | type[Effect], str | None, Mapping[str, float | Sequence[float]]]
"""An effect (of the catalogue or your own), its joint (None for the whole robot) and its parameters, such as
``("coulomb_friction", "j1", {"torque": 0.3})``."""


@takes(
    columns=or_none(COLUMNS),
    topic=or_none(TEXT),
    ref_topic=or_none(TEXT),
    exclude=STRETCHES,
    torque_needed=FLAG,
    anyway=FLAG,
)
def read_recording(
    path: str | Path,
    robot: RobotLike,
    *,
    columns: str | Path | None = None,
    topic: str | None = None,
    ref_topic: str | None = None,
    exclude: Sequence[tuple[float, float]] = (),
    torque_needed: bool = True,
    anyway: bool = False,
) -> Recording:
    """A checked recording of a robot from a file; its ``warnings`` say what may be wrong with it.

    Args:
        path: CSV, Parquet, NPZ, ROS 1 or ROS 2 bag, MCAP, or an episode of a LeRobot dataset, as in
            ``dataset/episode_000003``.
        robot: File, ``example:NAME``, built-in name, or what `load_robot` returned.
        columns: Column map (YAML) or the name of a built-in one, such as ``ur_rtde``, if the columns have other names
            or units.
        topic: Topic of joint states in a bag that has several.
        ref_topic: Topic of the references in a bag, if it differs from that of the joint states.
        exclude: Intervals of time [s] to leave out of every fit, as in ``[(0, 1.5)]``.
        torque_needed: False if only the motion is used.
        anyway: True to use the recording although it has certain faults.

    Raises:
        LogError: If the file cannot be used; one sentence names the column and row, and says what to do.
    """
    if not isinstance(path, str | Path):
        raise UsageError(f"{described(path)} was given as a recording, wanted the path of a log, then the robot.")
    if looks_like_robot(str(path)):
        raise UsageError(f"{path} was given as a recording and is a robot: give the path of the log, then the robot.")
    loaded = robot_of(robot)
    return reading.read_recording(
        path,
        loaded,
        columns=columns,
        topic=topic,
        ref_topic=ref_topic,
        excluded=exclude,
        torque_needed=torque_needed,
        anyway=anyway,
    )


@takes(
    changes=or_none(path_of("the path of a recordings.yaml")),
    columns=or_none(COLUMNS),
    motion_only=FLAG,
    progress=TEXT_CALLBACK,
)
def diagnose(
    robot: RobotLike,
    recordings: RecordingsLike,
    *,
    hold_out: RecordingsLike = (),
    known: Paths = (),
    changes: str | Path | None = None,
    columns: str | Path | None = None,
    effects: EffectsLike = (),
    motion_only: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Find effects that the model of a robot lacks, from recordings, with their joints, sizes and probabilities.

    Args:
        robot: File, ``example:NAME``, built-in name, or what `load_robot` returned.
        recordings: Path or recording, or several; they are judged on blocks that no fit has used.
        hold_out: Recordings that no fit uses; if there are any, all figures are computed on them.
        known: ``corrected.yaml`` of earlier diagnoses, whose findings are added to the model.
        changes: ``recordings.yaml`` that states how the recordings differ; the recordings have to be given as paths.
        columns: Column map (YAML) for recordings that are paths.
        effects: Effects of your own in addition to the catalogue: a Python file, classes or instances, see
            `docs/how_to/own_effects.md`.
        motion_only: True to use the torques that the controllers command instead of recorded torques. For recordings
            without torques this is the default.
        progress: Called with words on each stage, as in ``progress=print``.

    Raises:
        UsageError: If an argument is of the wrong kind.
        LogError: If a recording cannot be used, or is certainly wrong.
        RobotError: If the robot cannot be loaded.
        EffectError: If an effect of your own cannot be used.
    """
    loaded = with_user_effects(robot_of(robot, recordings), effects)
    added, loaded = known_model(tuple(Path(file) for file in paths_of(known, "known")), loaded)
    if changes is not None:
        return diagnosis_of_changes(loaded, recordings, hold_out, added, changes, columns, in_words(progress))
    return diagnosis_of_recordings(
        loaded, recordings, hold_out, added, columns, in_words(progress), motion_only=motion_only
    )


@takes(estimator=TEXT, friction=NAMES, rotors=FLAG, columns=or_none(COLUMNS), progress=TEXT_CALLBACK)
def identify(
    robot: RobotLike,
    recordings: RecordingsLike,
    *,
    hold_out: RecordingsLike = (),
    estimator: str = "wls",
    friction: Sequence[str] = ("viscous", "coulomb", "offset"),
    rotors: bool = False,
    columns: str | Path | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Estimate base parameters, friction and drives of a robot, with errors on held-out data.

    Args:
        robot: File, ``example:NAME``, built-in name, or what `load_robot` returned.
        recordings: Path or recording, or several. The last fifth of a single recording is held out; of several
            recordings the last one is held out.
        hold_out: Recordings that are held out; all of ``recordings`` are then used for the fit.
        estimator: ``ols``, ``wls``, ``irls``, ``consistent``; with references and controllers ``iv``, ``didim``.
        friction: Friction of every joint: ``viscous``, ``coulomb``, ``offset``, ``direction_dependent``, or ``none``.
        rotors: True to estimate rotor inertias, too.
        columns: Column map (YAML) for recordings that are paths.
        progress: Called with words on each stage.

    Raises:
        UsageError: If an argument is of the wrong kind.
        LogError: If a recording cannot be used, or is certainly wrong.
        IdentifiabilityError: If the recordings excite too few parameters.
    """
    estimator_named(estimator)
    terms = JointTerms(friction_terms([friction] if isinstance(friction, str) else list(friction)), rotors)
    loaded = robot_of(robot, recordings)
    found = identified(
        loaded,
        recordings_of(recordings, loaded, columns=columns),
        hold_out=recordings_of(hold_out, loaded, columns=columns) if as_tuple(hold_out) else (),
        estimator=estimator,
        terms=terms,
        config=loaded.config,
        progress=in_words(progress),
    )
    return Identification(found, loaded)


@takes(duration=NUMBER, rate=NUMBER, harmonics=WHOLE, share=NUMBER, seed=SEED, progress=TEXT_CALLBACK)
def excite(
    robot: RobotLike,
    *,
    duration: float = 10.0,
    rate: float = 100.0,
    harmonics: int = 5,
    share: float = 1.0,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Reference:
    """A motion from rest to rest, within the robot's limits, from which its inertial parameters can be identified.

    Args:
        robot: File, ``example:NAME``, built-in name, or what `load_robot` returned.
        duration: Duration of the motion [s].
        rate: Sample rate [Hz].
        harmonics: Number of harmonics of the motion's Fourier series.
        share: Share of the velocity and torque limits to use.
        seed: Seed of the random motions from which the search starts.
        progress: Called with words on each stage.

    Raises:
        ParameterError: If no motion keeps the limits; the message names the limit that is exceeded most.
    """
    from identification.excitation.collisions import collisions_of

    loaded = robot_of(robot)
    limits = limits_of(loaded, share=share, collisions=collisions_of(loaded))
    design = designed(
        loaded,
        FourierSeries(duration, harmonics),
        limits=limits,
        planned=PlannedRecording(rate),
        seed=seed,
        progress=in_words(progress),
    )
    return Reference(design, rate)


@takes(columns=or_none(COLUMNS), topic=or_none(TEXT), ref_topic=or_none(TEXT))
def check(
    robot: RobotLike | Recording,
    recording: str | Path | Recording | None = None,
    *,
    columns: str | Path | None = None,
    topic: str | None = None,
    ref_topic: str | None = None,
) -> CheckedRecording:
    """Certain faults and possible errors of a recording; ``print`` shows them.

    Args:
        robot: The robot that was recorded. It may be left out, as in ``check("log.csv")``; fewer checks are then made.
        recording: A path, or what `read_recording` returned.
        columns: Column map (YAML) or the name of a built-in one, if the columns have other names or units.
        topic: Topic of joint states in a bag that has several.
        ref_topic: Topic of the references in a bag, if it differs from that of the joint states.

    Raises:
        UsageError: If an argument is of the wrong kind.
        LogError: If the file cannot be read as a recording.
    """
    only_recording = recording is None
    given = robot if only_recording else recording
    if isinstance(given, Recording):
        return checked_recording(given, with_robot=True)
    if not isinstance(given, str | Path) or (looks_like_robot(str(given)) and only_recording):
        raise UsageError(f"{described(given)} was given as a recording, wanted a path or a recording.")
    loaded = None if only_recording or isinstance(robot, Recording) else robot_of(robot, given)
    return checked_file(given, loaded, columns=columns, topic=topic, ref_topic=ref_topic)


def compare(*diagnoses: Diagnosis | str | Path) -> comparison.Comparison:
    """Compare two or more diagnoses: verdicts, findings, and sizes with their 95 % intervals.

    Args:
        diagnoses: Results of `diagnose`, or paths of ``diagnosis.json`` or of the folder that contains it.

    Raises:
        UsageError: If one of them is no diagnosis.
        ParameterError: If there are fewer than two, or they are of different joints.
    """
    found, paths = [], []
    for k, given in enumerate(diagnoses, start=1):
        if isinstance(given, Diagnosis):
            found.append(given.result)
            paths.append(f"diagnosis {k}")
        elif isinstance(given, str | Path):
            found.append(read_diagnosis(given))
            paths.append(str(given))
        else:
            raise UsageError(
                f"{described(given)} was given as a diagnosis, wanted what diagnose returned or a diagnosis.json."
            )
    return comparison.compare(found, comparison.distinct_names(paths))


def simulate(
    robot: RobotLike,
    reference: str | Path | Motion | Reference,
    *,
    effects: str | Path | Diagnosis | Iterable[EffectLike] = (),
    own_effects: EffectsLike = (),
    kp: Float[Array, " nv"] | Sequence[float] | float | None = None,
    kd: Float[Array, " nv"] | Sequence[float] | float | None = None,
) -> SimulatedRecording:
    """Simulate a robot along a reference, with effects that its model lacks.

    Args:
        robot: File, ``example:NAME``, built-in name, or what `load_robot` returned.
        reference: Result of `excite`, a motion, or a table with ``t`` and ``q_ref.<joint>``.
        effects: Effects that the robot has in addition to its model: tuples of effect, joint and parameters, a
            diagnosis, or its ``corrected.yaml``.
        own_effects: Effects of your own whose names ``effects`` contains: a Python file, classes or instances. A tuple
            in ``effects`` may also contain the class instead of the name.
        kp: Position gains [N m/rad or N/m]. By default those of ``robot.yaml``. If these are missing, feedback with a
            bandwidth of 5 Hz and critical damping is added to the torque that the model needs for the reference.
        kd: Velocity gains [N m s/rad or N s/m], with the same default.

    Raises:
        UsageError: If an argument is of the wrong kind.
        ParameterError: If an effect or gain is impossible, or the motion diverges.
        EffectError: If an effect of your own cannot be used.
    """
    named = effects if isinstance(effects, str | Path | Diagnosis) else as_tuple(effects)
    loaded = robot_of(robot, reference if isinstance(reference, str | Path) else ())
    loaded = with_named_effects(with_user_effects(loaded, own_effects), named)
    motion = reference_of(loaded, reference)
    causes = causes_of(loaded, named)
    law = tracking(loaded, motion, kp, kd)
    made = simulation.simulate(loaded, causes, law, motion.t, motion.q[0], motion.v[0])
    return SimulatedRecording(loaded, made)


@takes(
    grid=TEXT,
    quantities=NAMES,
    frame=or_none(TEXT),
    q0=or_none(NUMBERS),
    stiffness=or_none(NUMBERS),
    jobs=or_none(WHOLE),
)
def map_workspace(
    robot: RobotLike,
    grid: str,
    quantities: str | Sequence[str] = "manipulability",
    *,
    frame: str | None = None,
    q0: Float[Array, " nv"] | Sequence[float] | None = None,
    stiffness: Float[Array, " nv"] | Sequence[float] | None = None,
    jobs: int | Literal[1] | None = None,
) -> xarray.Dataset:
    """Inertia and forces at the tip of a robot over its workspace, as an xarray dataset with units.

    Args:
        robot: File, ``example:NAME``, built-in name, or what `load_robot` returned.
        grid: Positions of the tip [m] as in ``x=0:0:1,y=-0.2:0.2:41,z=-0.1:0.3:41``, or of joints as in
            ``q.j1=-1:1:21``.
        quantities: Names, such as ``apparent_mass``, ``stiffness``, ``gravity_force``.
        frame: Frame of the tip; by default the frame ``tip``, or the last frame if there is none.
        q0: Joint positions near which the solution of the inverse kinematics is chosen.
        stiffness: Stiffness of each joint [N m/rad], if the robot file does not state it.
        jobs: Largest number of processes.

    Raises:
        ParameterError: If grid, quantity or a value cannot be used.
    """
    loaded = robot_of(robot)
    model = map_model(
        loaded,
        frame=frame,
        stiffness=None if stiffness is None else np.array(stiffness, dtype=float),
        posture=None if q0 is None else np.array(q0, dtype=float),
    )
    names = quantities.split(",") if isinstance(quantities, str) else list(quantities)
    made = operational_map(model, read_grid(grid, loaded.joint_names), [name.strip() for name in names], jobs=jobs)
    return dataset(made)
