# pyright: reportAttributeAccessIssue=false
"""Pinocchio's parsers, made to say what they say to the terminal."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import pinocchio as pin

from phantom_dyn.errors import RobotError

_AT_REST = "world_at_rest"
_POSE = ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")


@contextmanager
def _captured_output() -> Iterator[list[str]]:
    """Collect what C++ code prints: its streams know nothing of `sys.stderr`, so the descriptors are swapped."""
    lines: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    saved = [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile() as sink:
        try:
            os.dup2(sink.fileno(), 1)
            os.dup2(sink.fileno(), 2)
            yield lines
        finally:
            for descriptor, original in zip((1, 2), saved, strict=True):
                os.dup2(original, descriptor)
                os.close(original)
            sink.seek(0)
            lines.extend(sink.read().decode(errors="replace").splitlines())


def parse_model(path: Path, kind: Literal["urdf", "mjcf"]) -> pin.Model:
    """Pinocchio's model of a file, meshes not read.

    Raises:
        RobotError: If Pinocchio refuses it, or its parser drops the inertia of a link.
    """
    build = pin.buildModelFromUrdf if kind == "urdf" else pin.buildModelFromMJCF
    model, reason = None, ""
    with _captured_output() as printed:
        try:
            with _whole_tree(path, kind) as whole:
                model = build(str(whole))
        except Exception as problem:  # Boost.Python turns C++ exceptions into several Python ones
            # Pinocchio puts its source position in front of the message.
            reason = str(problem).rpartition("message:")[2].strip()
    errors = [line.removeprefix("Error:").strip() for line in printed if line.startswith("Error:")]
    # The URDF parser goes on without an inertia or a visual that it cannot read; only the first changes the dynamics.
    if model is None or any("inertial" in line.casefold() for line in errors):
        reason = "; ".join(re.sub(r"\s+", " ", text).rstrip(".") for text in errors or [reason])
        raise RobotError(f"{path} is not a robot that Pinocchio can read ({reason}): correct the file.")
    return model


@contextmanager
def _whole_tree(path: Path, kind: Literal["urdf", "mjcf"]) -> Iterator[Path]:
    """The file, or one in which every body of the world hangs on a body at rest.

    Pinocchio 4.1 reads the first body of a ``<worldbody>`` and drops the others without a word; of a first body without
    a joint, such as a base on a wall, it drops the pose.
    """
    root = ElementTree.parse(path).getroot()
    bodies = [(world, body) for world in root.iter("worldbody") for body in world.findall("body")]
    if kind == "urdf" or (len(bodies) < 2 and not any(_fixed_elsewhere(body) for _, body in bodies)):
        yield path
        return
    rest = ElementTree.SubElement(bodies[0][0], "body", {"name": _AT_REST})
    for world, body in bodies:
        world.remove(body)
        rest.append(body)
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / path.name
        ElementTree.ElementTree(root).write(whole)
        yield whole


def _fixed_elsewhere(body: ElementTree.Element) -> bool:
    moves = body.find("joint") is not None or body.find("freejoint") is not None
    return not moves and any(body.get(key) is not None for key in _POSE)
