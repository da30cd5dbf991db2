"""The command ``phantom-dyn map``: computes forces, masses and stiffness at the tip of a robot over its workspace."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from identification.cli.arguments import DONE, Parser, add_robot, one_blas_thread
from identification.cli.terminal.printed import say
from identification.cli.terminal.progress import MAP, Progress
from identification.files import require_own, require_writable_folder
from identification.stages import Announcement, Stage
from phantom_dyn.errors import UsageError, known_names
from phantom_dyn.libraries import missing_library
from phantom_dyn.model.robot_files import find_robot

if TYPE_CHECKING:
    import numpy as np

    from phantom_dyn.maps.operational_map import OperationalMap

_QUANTITIES = (
    "manipulability, apparent_mass, apparent_mass_matrix, stiffness, viscous_friction, coulomb_friction, "
    "coulomb_force, gravity_force"
)


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn map",
        description="Map what is felt at the tip of a robot over a grid, into map.npz, map.nc and figures. Points that "
        "the tip cannot reach, or where it is singular, are NaN and counted.",
        examples=(
            "map phantom_1_5 --quantity apparent_mass --grid x=0:0:1,y=-0.2:0.3:51,z=-0.2:0.2:41 --out maps/",
            "map robot.urdf --quantity manipulability,gravity_force --grid q.j1=-1:1:21,q.j2=-1:1:21 --out maps/",
        ),
    )
    add_robot(out)
    out.add_argument("--quantity", metavar="NAME[,NAME]", required=True, help=f"some of {_QUANTITIES}")
    out.add_argument(
        "--grid",
        metavar="x=START:STOP:COUNT,...",
        required=True,
        help="over the tip in the root frame [m] (x, y, z), or over joints [rad or m] (q.<joint>), with both ends; "
        "coordinates that are left out stay as in --q0",
    )
    out.add_argument("--out", metavar="DIR", type=Path, required=True, help="write the files there")
    out.add_argument("--frame", metavar="NAME", help="frame of the tip (default: tip, or the last frame)")
    out.add_argument(
        "--q0",
        metavar="Q",
        nargs="+",
        help="joint positions, one per joint or joint=position; the map follows the nearest branch (default: zero)",
    )
    out.add_argument(
        "--stiffness", metavar="K", nargs="+", help="stiffness of each joint [N m/rad] (default: that of the file)"
    )
    out.add_argument("--jobs", metavar="N", type=int, help="largest number of processes (default: one per core)")
    return out


def run(arguments: argparse.Namespace) -> int:
    """Compute the map, write the files and print a summary."""
    one_blas_thread()
    if arguments.jobs is not None and arguments.jobs < 1:
        raise UsageError(f"--jobs {arguments.jobs} was given, wanted a number of processes from 1 on")
    unmarked = ("map.nc", *(f"{name}.png" for name in _quantities(arguments)))
    require_writable_folder(arguments.out, ("map.npz", "map.nc"))
    require_own(arguments.out, ("map.npz", *unmarked), index="map.npz", unmarked=unmarked)
    find_robot(arguments.robot)
    from identification.export.log_and_map_files import NETCDF, write_map
    from phantom_dyn.maps.grid import read_grid
    from phantom_dyn.maps.map_model import map_model
    from phantom_dyn.maps.operational_map import operational_map
    from phantom_dyn.model.loading import load_robot

    with Progress(Stage.LOADING, sys.stderr, stages=MAP) as progress:
        robot = load_robot(arguments.robot, config=arguments.robot_config)
        model = map_model(
            robot,
            frame=arguments.frame,
            stiffness=joint_values("--stiffness", arguments.stiffness, robot.joint_names),
            posture=joint_values("--q0", arguments.q0, robot.joint_names),
        )
        grid = read_grid(arguments.grid, robot.joint_names)

        def done(points: int) -> None:
            progress.show(Announcement(Stage.MAP, points, grid.size))

        result = operational_map(model, grid, _quantities(arguments), jobs=arguments.jobs, progress=done)
        written = write_map(result, arguments.out, progress=progress.show)
    for line in _summary(result):
        say(line)
    for path in written:
        say(f"wrote {path}")
    if not any(path.name == NETCDF for path in written):
        say(f"note: {NETCDF} was not written. {missing_library('netCDF4')}")
    return DONE


def _quantities(arguments: argparse.Namespace) -> list[str]:
    return [name.strip() for name in arguments.quantity.split(",") if name.strip()]


def joint_values(option: str, words: list[str] | None, joints: tuple[str, ...]) -> np.ndarray | None:
    """Values of an option for each joint; None if the option was not given.

    The words are one number per joint in order, or ``joint=number`` for some joints and zero for the others.

    Raises:
        UsageError: If a joint is unknown, a word is no number, or the number of words is wrong.
    """
    if words is None:
        return None
    import numpy as np

    parts = [part for word in words for part in word.replace(",", " ").split()]
    try:
        if not any("=" in part for part in parts):
            values = np.array([float(part) for part in parts])
        else:
            values = np.zeros(len(joints))
            for part in parts:
                name, _, number = part.partition("=")
                name = name.removeprefix("q.")
                if name not in joints:
                    raise UsageError(
                        f"{option} names the unknown joint {name!r}, {known_names(name, joints, 'joints')}"
                    )
                values[joints.index(name)] = float(number)
    except ValueError as problem:
        if isinstance(problem, UsageError):
            raise
        raise UsageError(f"{option} {' '.join(words)} was given, wanted numbers such as 0,0.5,-0.5") from None
    if len(values) != len(joints):
        raise UsageError(f"{option} has {len(values)} numbers, wanted one for each of {', '.join(joints)}")
    return values


def _summary(result: OperationalMap) -> list[str]:
    """Lines with the number of points and the range of each quantity."""
    import numpy as np

    from phantom_dyn.maps.quantities import QUANTITIES

    size = result.grid.size
    lines = [
        f"{result.model.name}, frame {result.model.frame}: {size} points, {result.unreachable} out of reach, "
        f"{result.singular} singular"
    ]
    for name, values in result.values.items():
        finite = values[np.isfinite(values)]
        unit = f" {QUANTITIES[name].unit}" if QUANTITIES[name].unit else ""
        span = f"{finite.min():.6g} to {finite.max():.6g}{unit}" if finite.size else "nowhere"
        lines.append(f"  {name:<20} {span}")
    if result.unreachable == size:
        lines.append(
            "note: no point of the grid is within reach and within the limits of the joints: give another grid."
        )
    elif result.unreachable + result.singular == size:
        lines.append(
            f"note: there is no value at any point of the grid, as the frame {result.model.frame} cannot move in "
            f"{min(result.model.nv, 3)} independent directions there. A frame on the axis of a joint does not move "
            "with it: name one farther out with --frame, or add one to the robot file. If an arm of three joints moves "
            "in a plane, hold one of them (lock in robot.yaml)."
        )
    if "stiffness" in result.values:
        lines.append(f"  {result.model.stiffness_note}")
    return lines
