"""``corrected.urdf`` and ``corrected.xml``, each loaded again and compared before anybody gets it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float

from identification.export.corrected.corrected_mjcf import corrected_mjcf
from identification.export.corrected.corrected_urdf import corrected_urdf, said_by_urdf
from identification.export.corrected.left_out import mjcf_left_out, urdf_left_out
from identification.export.corrected.parts import Parts
from identification.export.corrected.reload_in_mujoco import rollout_errors, torque_difference
from identification.export.model_files.mjcf_file import mjcf_text
from identification.export.model_files.reload import TOLERANCE, some_motion, urdf_difference, versions
from phantom_dyn.errors import EstimationError, PhantomDynError
from phantom_dyn.model.loading import CONFIG_NAME
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.motion import Motion

Array = np.ndarray

URDF, MJCF = "corrected.urdf", "corrected.xml"
_HORIZON = 0.2
"""Length of a rollout [s]."""


@dataclass(frozen=True)
class ModelFile:
    """One file of a corrected model.

    Attributes:
        name: Of the file.
        text: Its content, empty if it cannot be written.
        notes: What it cannot say, how it was checked, or why it was not written.
    """

    name: str
    text: str
    notes: tuple[str, ...]


def model_files(parts: Parts, motion: Motion, *, folder: Path, config: Path | None = None) -> tuple[ModelFile, ...]:
    """URDF and MJCF of a corrected model.

    Args:
        parts: The model.
        motion: On which torques are compared.
        folder: Where the files will lie.
        config: The ``robot.yaml`` that was given, None for the one beside the robot's file.

    Raises:
        EstimationError: If a file that was written says something else than the model.
    """
    file = find_robot(parts.given.source)
    beside = file.with_name(CONFIG_NAME)
    stated = config if config is not None else beside if beside.is_file() else None
    few = some_motion(motion)

    def urdf() -> tuple[str, float]:
        text = corrected_urdf(parts, file, folder)
        return text, urdf_difference(text, said_by_urdf(parts), few, stated)

    def mjcf() -> tuple[str, float]:
        text = corrected_mjcf(parts)
        return text, torque_difference(text, parts, few)

    return (
        _made(URDF, urdf, versions().get("urdf", ""), urdf_left_out(parts, file)),
        _made(MJCF, mjcf, versions().get("mjcf", ""), mjcf_left_out(parts, file)),
    )


def rollout_note(parts: Parts, text: str, motion: Motion, tau: Float[Array, "N nv"]) -> tuple[str, ...]:
    """A sentence on how far MuJoCo leaves the recorded motion with the given and with the corrected model.

    Args:
        parts: The model.
        text: Its MJCF.
        motion: Of the recordings.
        tau: Logged torque at the same times.

    Returns:
        The sentence; nothing without MuJoCo, or where the motion is too short or the loops are not in the file.
    """
    chain = parts.robot.chain
    if find_spec("mujoco") is None or not text or (chain is not None and set(chain.passive) - set(chain.unknowns)):
        return ()
    try:
        before = rollout_errors(mjcf_text(parts.given), parts.given, motion, tau, horizon=_HORIZON)
        after = rollout_errors(text, parts.given, motion, tau, horizon=_HORIZON)
    except PhantomDynError:
        return ()
    places = zip(parts.given.joint_names, before, after, parts.given.position_units, strict=True)
    changes = ", ".join(f"{joint} {one:.3g} {unit} before and {two:.3g} after" for joint, one, two, unit in places)
    return (
        f"{MJCF}: rolled out in MuJoCo for {_HORIZON:g} s under the logged torque, it is this far from the recorded "
        f"motion (root mean square): {changes}.",
    )


def _made(name: str, make: Callable[[], tuple[str, float]], loaded_with: str, left_out: tuple[str, ...]) -> ModelFile:
    try:
        text, difference = make()
    except PhantomDynError as error:
        return ModelFile(name, "", (f"{name} was not written: {error}",))
    if difference > TOLERANCE:
        raise EstimationError(
            f"{name}, loaded again with {loaded_with}, needs torques that differ by {difference:.2g} of the largest "
            "from the corrected model's: this is an error of phantom-dyn, so nothing is written."
        )
    checked = (
        "not loaded again, as MuJoCo is not installed"
        if np.isnan(difference)
        else f"loaded again with {loaded_with}, it needs the same torques (to {difference:.1g} of the largest)"
    )
    notes = (f"{name}: {checked}.", *(f"{name}: {sentence[:1].lower()}{sentence[1:]}" for sentence in left_out))
    return ModelFile(name, _with_comment(text, left_out), notes)


def _with_comment(text: str, sentences: tuple[str, ...]) -> str:
    """The text with a comment behind the start of its root element; without sentences as it is."""
    if not sentences:
        return text
    lines = ["What this file cannot say of the corrected model (corrected.yaml has all of it):", *sentences]
    # A comment may not hold two dashes.
    comment = "\n    ".join(line.replace("--", "- -") for line in lines)
    start = text.index(">", text.index("<mujoco" if "<mujoco" in text else "<robot")) + 1
    return f"{text[:start]}\n  <!-- {comment}\n  -->{text[start:]}"
