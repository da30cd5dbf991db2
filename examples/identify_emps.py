"""Mass and friction of the EMPS axis by ordinary least squares, beside what the authors of the recording publish."""

from __future__ import annotations

import sys
from pathlib import Path

from arguments import chosen_folder
from emps_log import write_emps_log

from identification.data.reading import read_recording
from identification.data.signals import process
from identification.estimators.weighted_least_squares import ols
from identification.regression.regressor import torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import LogError

# Effects on the axis, then the published M and parameters in the order of our columns, and the relative error [%].
MODELS = (
    (
        ("viscous_friction", "coulomb_friction", "torque_offset"),
        (95.1089, 203.5034, 20.3935, 3.1648),
        4.0834,
    ),
    (("direction_dependent_friction",), (95.1540, 20.1440, 20.6277, 166.7061, 240.4236), 3.1117),
)


def main(folder: Path) -> None:
    robot = load_robot("emps")
    log = process(read_recording(write_emps_log(folder), robot), robot)
    print(f"band 0 to {log.band.cutoff_hz:.1f} Hz, chosen from the data")
    for names, published, published_error in MODELS:
        effects = [(effect_named(name), "axis") for name in names]
        fit = ols(torque_regressor(robot, log, effects))
        print("\n" + ", ".join(names).replace("_", " "))
        for name, value, std, unit, theirs in zip(fit.names, fit.theta, fit.std(), fit.units, published, strict=True):
            print(f"  {name:<54} {value:9.4f} +- {std:7.4f} {unit:<7} published {theirs:9.4f}")
        print(
            f"  {'relative error of the force':<54} {fit.relative_error[0]:9.4f} %{'':<16} published {published_error}"
        )


if __name__ == "__main__":
    try:
        main(chosen_folder(__doc__, "emps"))
    except LogError as error:
        sys.exit(str(error))
