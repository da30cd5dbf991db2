"""Writes the pages of docs/papers: what four papers state, beside what this project computes."""

from __future__ import annotations

import argparse
from pathlib import Path

from arguments import CHECKOUT
from papers import cea, cheap, phantom_loops, phantom_structure, stability, walking
from papers.page import Page

PAGES = (
    Page(
        "phantom",
        "The PHANToM haptic interface",
        "M. C. Çavuşoğlu, D. Feygin, F. Tendick, *A Critical Study of the Mechanical and Electrical Properties of the "
        "PHANToM Haptic Interface and Improvements for High-Performance Control*, Presence 11 (6), 2002.",
        (
            phantom_structure.kinematics,
            phantom_structure.dynamics,
            phantom_loops.electronics,
            phantom_loops.velocity,
            phantom_loops.response,
            phantom_loops.evaluation,
            phantom_loops.future,
            phantom_structure.appendix,
        ),
    ),
    Page(
        "cea_branch",
        "A haptic interface of three degrees of freedom",
        "A. Janot, C. Bidard, F. Gosselin, M. Gautier et al., *Modeling and Identification of a 3 DOF Haptic "
        "Interface*, IEEE International Conference on Robotics and Automation, 2007.",
        (
            cea.device,
            cea.geometry,
            cea.transmission,
            cea.friction,
            cea.minimum_parameters,
            cea.identification,
            cea.felt_by_a_hand,
        ),
    ),
    Page(
        "cheap_hardware",
        "Simulated cheap hardware",
        "I. Brouwer, K. E. MacLean, A. J. Hodgson, *Simulating Cheap Hardware: A platform for evaluating "
        "cost-performance trade-offs in haptic hardware design*.",
        (cheap.device, cheap.models, cheap.table_2, cheap.figures),
    ),
    Page(
        "advances_in_haptics",
        "Two chapters of Advances in Haptics",
        "J. J. Gil et al., chapter on stability and transparency (sections 3 to 5), and *Implementation of a Wireless "
        "Haptic Controller for Humanoid Robot Walking* (sections 1 and 2, and the beginning of 3), in *Advances in "
        "Haptics*, 2010. The copy at hand has lost tables and equations, and begins in section 4 of the first chapter.",
        (
            stability.linear_condition,
            stability.identification,
            stability.vibration,
            stability.relay,
            stability.transparency,
            walking.kinematics,
            walking.balance,
        ),
    ),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    default = CHECKOUT / "docs" / "papers"
    parser.add_argument("folder", type=Path, nargs="?", default=default, metavar="FOLDER", help="default: docs/papers")
    names = [page.name for page in PAGES]
    parser.add_argument("--page", choices=names, action="append", help="this one only; may be given more than once")
    chosen = parser.parse_args()
    chosen.folder.mkdir(parents=True, exist_ok=True)
    for page in PAGES:
        if not chosen.page or page.name in chosen.page:
            path = chosen.folder / f"{page.name}.md"
            path.write_text(page.text())
            print(f"wrote {path}", flush=True)


if __name__ == "__main__":
    main()
