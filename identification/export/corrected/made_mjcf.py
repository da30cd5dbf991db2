# pyright: reportAttributeAccessIssue=false
"""``corrected.xml`` and its check: the given MJCF with the findings, or a new one made from the model.

A new one is made where the robot's file is a URDF, and where settings of the given MJCF would change the meaning of the
findings; a note gives the reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from identification.export.corrected.corrected_mjcf import corrected_mjcf
from identification.export.corrected.corrected_model import CorrectedModel
from identification.export.corrected.given_mjcf import edited_mjcf
from identification.export.corrected.reload_in_mujoco import edited_difference, torque_difference
from identification.export.corrected.urdf_shapes import with_urdf_shapes
from identification.export.model_files.mujoco_library import mujoco_problem
from identification.export.model_files.reload import TOLERANCE
from identification.notes import Code, Note
from phantom_dyn.errors import EstimationError, PhantomDynError, RobotError
from phantom_dyn.model.from_mjcf.mjcf import drawn_configuration
from phantom_dyn.model.loading import read_model
from phantom_dyn.motion import Motion


@dataclass(frozen=True)
class MadeMjcf:
    """Text of an MJCF with the result of its check.

    Attributes:
        text: Text of the file.
        difference: Largest difference of torques in MuJoCo from the corrected model's, over the largest torque; NaN if
            it was not loaded.
        unchecked: Why it was not loaded again, as the end of a sentence; empty if it was.
        edited: True if it is the given file with the findings.
        left_out: Notes on numbers that its drives cannot have, and on why it is no edited copy of the given file.
    """

    text: str
    difference: float
    unchecked: str
    edited: bool
    left_out: tuple[Note, ...] = ()


def made_mjcf(corrected: CorrectedModel, motion: Motion, *, file: Path, folder: Path) -> MadeMjcf:
    """The MJCF of a corrected model.

    Args:
        corrected: The model.
        motion: Motion on which torques are compared.
        file: The robot's file.
        folder: Folder into which the file will be written.

    Raises:
        ParameterError: If a body cannot exist, or not in MuJoCo.
        RobotError: If MuJoCo refuses the text.
        EstimationError: If the torques of the file differ from those of the model.
    """
    if file.suffix == ".urdf":
        return _new(corrected, motion, file, folder, ())
    try:
        return _edited(corrected, motion, file, folder)
    except PhantomDynError as error:
        return _new(corrected, motion, file, None, (Note(Code.GIVEN_FILE_NOT_IN_IT, None, {"problem": str(error)}),))


def _new(
    corrected: CorrectedModel, motion: Motion, file: Path, folder: Path | None, left_out: tuple[Note, ...]
) -> MadeMjcf:
    """An MJCF that is made from the model, with the shapes of a URDF if ``folder`` is given."""
    text = corrected_mjcf(corrected)
    problem = mujoco_problem(text)
    difference = torque_difference(text, corrected, motion)
    if folder is None:
        return MadeMjcf(text, difference, problem or "", False, left_out)
    try:
        # With the whole paths of meshes, as the folder may not be there yet.
        loaded, without = with_urdf_shapes(text, corrected.robot, file, None)
        difference = torque_difference(loaded, corrected, motion)
        if difference > TOLERANCE:
            raise EstimationError("with them, MuJoCo needs other torques.")
        text = with_urdf_shapes(text, corrected.robot, file, folder)[0]
    except (PhantomDynError, ValueError) as error:
        without = (f"The shapes of the URDF are not in it: {error}",)
        difference = torque_difference(text, corrected, motion)
    remarks = (Note(Code.FILE_REMARK, None, {"sentence": sentence}) for sentence in without)
    return MadeMjcf(text, difference, problem or "", False, (*left_out, *remarks))


def _edited(corrected: CorrectedModel, motion: Motion, file: Path, folder: Path) -> MadeMjcf:
    text, left_out = edited_mjcf(corrected, file, folder)
    problem = mujoco_problem(text) or _refused(file)
    if problem:
        return MadeMjcf(text, float("nan"), problem, True, tuple(left_out.values()))
    # With the whole paths of meshes, as the folder may not be there yet.
    held = replace(corrected, offsets={name: x for name, x in corrected.offsets.items() if name not in left_out})
    difference = edited_difference(edited_mjcf(corrected, file, None)[0], held, motion, _held(file))
    if difference > TOLERANCE:
        raise EstimationError(
            f"with the findings in it, MuJoCo needs torques that differ by {difference:.2g} of the largest from the "
            "corrected model's, as it holds more than the model was read from."
        )
    return MadeMjcf(text, difference, "", True, tuple(left_out.values()))


def _refused(file: Path) -> str:
    """Why MuJoCo refuses the given file, for example for missing meshes; empty if it accepts it."""
    import mujoco

    try:
        mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        return f"MuJoCo refuses the given file as well ({' '.join(str(error).split())})"
    return ""


def _held(file: Path) -> dict[str, float]:
    """Positions at which joints of the file are held that follow others, or are backlash."""
    try:
        facts, model = read_model(file)
    except RobotError:
        return {}
    drawn = drawn_configuration(model)
    play = {name: float(drawn[model.joints[model.getJointId(name)].idx_q]) for name in facts.play}
    return {name: law.offset for name, law in facts.followers.items()} | play
