# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
"""Ranges of ``randomisation.yaml`` on a MuJoCo model, on a batch for MJX, and at each reset of a Gymnasium environment.

    python examples/randomised_training.py report/ --width widened --count 5

``report/`` is the folder of ``phantom-dyn diagnose --out``. Width ``posterior`` draws within the deviations of what was
found; ``widened`` within what the recordings cannot exclude as well. Numbers are drawn one by one, evenly. What MuJoCo
takes only when it compiles a file, such as a delay, is named and left out.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
import yaml

Width = Literal["posterior", "widened"]
FIELDS = {
    ("inertial", "mass"): "body_mass",
    ("inertial", "pos"): "body_ipos",
    ("joint", "damping"): "dof_damping",
    ("joint", "frictionloss"): "dof_frictionloss",
    ("joint", "armature"): "dof_armature",
    ("joint", "stiffness"): "jnt_stiffness",
    ("joint", "springref"): "qpos_spring",
    ("motor", "gear"): "actuator_gear",
    ("motor", "biasprm"): "actuator_biasprm",
    ("motor", "forcerange"): "actuator_forcerange",
    ("motor", "dynprm"): "actuator_dynprm",
}
"""Where MuJoCo keeps a number of the file, by element and attribute."""
UNSEEN = 1 / 3
"""Share of the numbers that a widened draw takes from what the recordings cannot exclude."""
INERTIA = ("inertial", "fullinertia")
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
DERIVED = ("body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0")
"""What MuJoCo computes from these when it compiles: contacts, limits and dry friction are as soft as these say."""
CHANGED = tuple(dict.fromkeys((*FIELDS.values(), "body_inertia", "body_iquat", *DERIVED)))


def ranges_in(path: Path) -> list[dict[str, Any]]:
    """The ranges of a ``randomisation.yaml``, one a number of the corrected MJCF."""
    return yaml.safe_load(path.read_text(encoding="utf-8"))["mjcf"]


def range_of(entry: dict[str, Any], width: Width, rng: np.random.Generator) -> tuple[float, float]:
    """Lower and upper end of one number; of unseen effects few at a time, as together they would have been seen."""
    low, high = entry["unseen_range"] if width == "widened" and rng.uniform() < UNSEEN else entry["range"]
    return low, high


def randomise(
    model: Any, ranges: list[dict[str, Any]], rng: np.random.Generator, *, width: Width = "posterior"
) -> tuple[str, ...]:
    """Draw every number of a MuJoCo model that has a range, in place; what cannot be set is returned by name."""
    skipped, inertias = [], {}
    for entry in ranges:
        value = rng.uniform(*range_of(entry, width, rng))
        kind = entry["element"], entry["attribute"]
        if kind == INERTIA:
            inertias.setdefault(entry["name"], {})[entry["index"]] = value
        elif kind in FIELDS and not entry.get("needs"):
            array = getattr(model, FIELDS[kind])
            row = place_of(model, *kind, entry["name"])
            array[(row, entry["index"]) if array.ndim == 2 else row] = value
        else:
            skipped.append(f"{entry['name']} {entry['attribute']}")
    for body, entries in inertias.items():
        set_inertia(model, body, entries)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return tuple(skipped)


def place_of(model: Any, element: str, attribute: str, name: str) -> int:
    """Row of a number in MuJoCo's array; an actuator is that of its joint, whatever its name is in the file."""
    if element == "inertial":
        return model.body(name).id
    if element == "motor":
        joint = model.joint(name.removesuffix("_motor")).id
        # Of a tendon's actuator the same number may be that of the tendon.
        on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
        return int(np.flatnonzero(on_joint & (model.actuator_trnid[:, 0] == joint))[0])
    joint = model.joint(name)
    if attribute == "stiffness":
        return joint.id
    return int(joint.qposadr[0] if attribute == "springref" else joint.dofadr[0])


def set_inertia(model: Any, body: str, entries: dict[int, float]) -> None:
    """Entries of the inertia of a body about its centre of mass, in the axes of the body."""
    row = model.body(body).id
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[row])
    turn = turn.reshape(3, 3)
    matrix = turn @ np.diag(model.body_inertia[row]) @ turn.T
    for index, value in entries.items():
        i, j = ENTRIES[index]
        matrix[i, j] = matrix[j, i] = value
    # Entries that are drawn one by one may belong to no body: the nearest with moments above zero takes their place.
    values, axes = np.linalg.eigh(matrix)
    values = np.maximum(values, 1e-6 * values.max())
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    model.body_inertia[row] = values
    mujoco.mju_mat2Quat(model.body_iquat[row], axes.ravel())


def batch(
    model: Any, ranges: list[dict[str, Any]], count: int, seed: int, *, width: Width = "posterior"
) -> dict[str, np.ndarray]:
    """Fields of so many randomised models, stacked: for ``mjx_model.tree_replace`` with these as batched axes."""
    rng, stacked = np.random.default_rng(seed), {name: [] for name in CHANGED}
    kept = {name: getattr(model, name).copy() for name in CHANGED}
    for _ in range(count):
        randomise(model, ranges, rng, width=width)
        for name, values in kept.items():
            stacked[name].append(getattr(model, name).copy())
            getattr(model, name)[:] = values
    return {name: np.stack(values) for name, values in stacked.items() if np.ptp(values, axis=0).any()}


def wrapped(env: Any, ranges: list[dict[str, Any]], *, width: Width = "posterior", seed: int = 0) -> Any:
    """A Gymnasium environment of MuJoCo whose model is drawn anew at every reset."""
    import gymnasium

    rng = np.random.default_rng(seed)
    kept = {name: getattr(env.unwrapped.model, name).copy() for name in CHANGED}

    class Randomised(gymnasium.Wrapper):
        def reset(self, **options: Any) -> Any:
            model: Any = env.unwrapped.model
            for name, values in kept.items():
                getattr(model, name)[:] = values
            randomise(model, ranges, rng, width=width)
            return self.env.reset(**options)

    return Randomised(env)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=Path)
    parser.add_argument("--width", choices=("posterior", "widened"), default="posterior")
    parser.add_argument("--count", type=int, default=3)
    arguments = parser.parse_args()
    model = mujoco.MjModel.from_xml_path(str(arguments.report / "corrected.xml"))
    ranges = ranges_in(arguments.report / "randomisation.yaml")
    for name, values in batch(model, ranges, arguments.count, 0, width=arguments.width).items():
        flat = values.reshape(arguments.count, -1)
        moved = np.flatnonzero(np.ptp(flat, axis=0))
        print(name, *(f"[{k}] {flat[:, k].min():.4g} to {flat[:, k].max():.4g}" for k in moved))


if __name__ == "__main__":
    main()
