"""The paper on the CEA branch: geometry, friction tests, base parameters, identification, and what a hand feels."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from cea_figures import around_the_posture, stiffnesses
from cea_two_branches import rods_by_feet, turns, within_reach, written
from identify_cea import LENGTHS as TRIED
from identify_cea import SEED, base_parameters, blocked_arm, friction_tests

from identification.experiments.cea_identification import simulate_identification
from identification.experiments.parallelogram_friction import passive_friction
from papers.page import NOT_GIVEN, Row, Section, compared, exact
from phantom_dyn.devices.cea import (
    COULOMB_RANGE_N,
    FRICTION_TESTS,
    INERTIAL,
    LENGTHS,
    STIFFNESS_RANGE,
    STIFFNESS_UNITS,
    TRANSMISSION_STIFFNESS,
    LinkLengths,
    closure_error,
    joint_stiffness,
    passive_jacobian,
    passive_positions,
    resonance_hz,
    table_1,
)
from phantom_dyn.devices.cea_dynamics import STIFFNESS_OF_RANGES, Felt, longest_arm, nearest_posture
from phantom_dyn.devices.cea_two_branches import two_branches_urdf, two_branches_yaml
from phantom_dyn.dynamics.kinematics import frame_pose

EXAMPLE = "`examples/identify_cea.py`"


def device() -> Section:
    with tempfile.TemporaryDirectory() as folder:
        robot = written(Path(folder), two_branches_urdf(), two_branches_yaml())
        _, place = frame_pose(robot, within_reach(np.linspace(0.0, 40.0, 400)), "tip")
    spans = 1e3 * np.ptp(place, axis=0)
    about = turns()
    return Section(
        "IV Medical haptic interface, Figures 1 and 2",
        "`examples/cea_two_branches.py`",
        (
            Row(
                "workspace in translation",
                "more than 200 mm in any direction",
                f"a motion within {' x '.join(f'{span:.0f}' for span in spans)} mm",
                "",
                "lengths of links and platform are not given and are assumed; one motion, not the largest",
            ),
            Row(
                "workspace in rotation",
                "over 150 degrees about any axis",
                f"{about['x']:.0f} and {about['z']:.0f} degrees of the platform about x and z, any of the handle "
                "about its own axis",
                "",
                "platform of 120 mm assumed; ends where the universal joint is singular; collisions and stops left out",
            ),
        ),
    )


def geometry() -> Section:
    q = np.array([0.3, 0.4, -0.5])
    rows = table_1(LENGTHS)
    printed = (*rows[:-1], type(rows[-1])(8, 3, 0.0, -LENGTHS.d6, turns=False))
    slope = np.array([passive_positions(q[None] + e)[0] - passive_positions(q[None])[0] for e in 1e-6 * np.eye(3)]).T
    slope = slope[[0, 2, 1]] / 1e-6
    return Section(
        "V.A Geometry, Table 1 and equations (8) to (12)",
        "`phantom_dyn.devices.cea`",
        (
            Row("Table 1, all but d3, d4, d6, d8", "printed", "used as printed", "none", ""),
            Row("d3, d4, d6", NOT_GIVEN, f"{LENGTHS.d3:g}, {LENGTHS.d4:g}, {LENGTHS.d6:g} m", "", "see section VII"),
            Row(
                "Table 1, d8",
                "-d6: the loop closes",
                f"+d6: closes, {exact(closure_error(q, rows)[0])}",
                f"{1e3 * closure_error(q, printed)[0]:.0f} mm as printed",
                "misprint: with -d6 the loop misses closure by 2 d6",
            ),
            Row(
                "(12), L",
                "printed",
                "the same",
                "none" if np.allclose(slope, passive_jacobian(), atol=1e-8) else "differs",
                "derivative of (8), (9), (11)",
            ),
            Row(
                "direction of gravity in frame 0",
                NOT_GIVEN,
                "(0, -1, 0)",
                "",
                "MX1 and MY1R show only if axis 1 is not vertical",
            ),
            Row("(4), (5)", "E(rho^T rho); norm", "E(rho rho^T); norm squared", "", "misprints"),
        ),
    )


def transmission() -> Section:
    unit = STIFFNESS_UNITS["N m/mrad"]
    value, std = blocked_arm().value("K")
    rows = [
        Row(
            f"Table 2, {name}",
            f"{stiffness.value} N m/rad ({stiffness.deviation} %)",
            f"{value / unit:.4f} N m/mrad ({100 * std / value:.3f} %)",
            "a factor of 1000 by the unit",
            "one simulation for all three, from 2.0 N m/mrad; noise of 0.01 N m and 1 urad assumed",
        )
        for name, stiffness in TRANSMISSION_STIFFNESS.items()
    ]
    inertias = [INERTIAL[name].value for name in ("ZZ1R", "ZZ2R", "ZZ3R")]
    for name in STIFFNESS_UNITS:
        found = ", ".join(f"{resonance_hz(2.0 * STIFFNESS_UNITS[name], inertia):.1f}" for inertia in inertias)
        rows.append(
            Row(
                f"bandwidth of joints 1, 2, 5, if the unit is {name}",
                "close to 20 Hz",
                f"{found} Hz",
                "",
                "the only reading within a factor of two of stiffness and bandwidth" if name == "N m/mrad" else "",
            )
        )
    shown_by = f"{EXAMPLE}; a figure of a recording: `phantom-dyn experiment stiffness`"
    return Section("V.B Cable transmission, Table 2 and Figure 4", shown_by, tuple(rows))


def friction() -> Section:
    first, tests = friction_tests()
    fits = (first, *(fit for test in tests.values() for fit in test.values()))
    rows = []
    for name, published in FRICTION_TESTS.items():
        value, std = next(fit for fit in fits if name in fit.names).value(name)
        simulated = name.replace("t2", "t1").replace("t3", "t1")
        truth = FRICTION_TESTS[simulated].value
        printed = f"{published.value:.3f}"
        row = compared(f"{name} ({published.unit})", printed, value, f"({100 * std / value:.1f} %)", digits=4)
        reason = f"simulated from {truth:.3f}; noise puts ours {abs(value - truth) / std:.1f} deviations away"
        if (apart := abs(published.value - truth) / published.std) > 0:
            reason += f"; a joint is simulated with one friction, {simulated}, and the paper's two tests differ by "
            reason += f"{apart:.1f} of the deviation that it states"
        rows.append(Row(row.what, f"{printed} ({published.deviation:g} %)", row.ours, row.difference, reason))
    for name, (value, std) in passive_friction(tests).items():
        rows.append(
            Row(
                f"{name}, passive joints",
                "neglected",
                f"{value:.4f} +- {std:.4f}",
                "",
                "not distinguished from 0" if abs(value) < 2 * std else "there",
            )
        )
    rows.append(
        compared(
            "condition number of W",
            "6",
            tests["t1"][1].condition,
            "",
            reason='"close to 6"; depends on the motion, which is assumed',
        )
    )
    rows.append(Row("last row", "FV5t3 again", "FC5t3", "", "misprint"))
    shown_by = f"{EXAMPLE}; a figure of a recording: `phantom-dyn experiment friction`"
    return Section("V.C Friction, Table 3, Figure 5, (15) to (17)", shown_by, tuple(rows))


def minimum_parameters() -> Section:
    base = base_parameters()
    regroups = list(base.regroupings())
    named = next(line for line in regroups if line.startswith("link1.myR"))
    with tempfile.TemporaryDirectory() as folder:
        rods = rods_by_feet(Path(folder))
    without, one, both, across = rods.values()
    return Section(
        "V.D Minimum inertial parameters, Figure 6",
        f"{EXAMPLE} and `examples/cea_two_branches.py`",
        (
            Row(
                "inertial base parameters",
                "20 of the 29 names",
                f"{base.rank} of {len(base.names)}",
                "+1",
                "the list lacks MY4: the radial first moment of the support does not regroup with link 1",
            ),
            Row("MY1R", "regrouped", f"`{named}`", "", "one of the regroupings, which are all printed"),
            Row(
                "parameters that one rod adds",
                "1",
                f"{one - without}, and {both - without} by both",
                "none",
                f"with its foot along X1; across X1 it adds {across - without}",
            ),
        ),
    )


def identification() -> Section:
    found = simulate_identification(np.random.default_rng(SEED))
    fit = found.fit
    rows = []
    for name, published in INERTIAL.items():
        value, std = fit.value(name)
        printed = f"{published.value:.4f}" if name not in ("FV1", "FV2R", "FV5R") else f"{published.value:.3f}"
        row = compared(f"{name} ({published.unit})", printed, value, f"({100 * std / abs(value):.2f} %)", digits=5)
        away = abs(value - published.value) / std
        rows.append(
            Row(
                row.what,
                f"{printed} ({published.deviation:g} %)",
                row.ours,
                row.difference,
                f"noise puts ours {away:.1f} deviations away",
            )
        )
    above = ", ".join(
        f"{100 * (INERTIAL[one].value / FRICTION_TESTS[other].value - 1):+.0f} %"
        for one, other in (("FV1", "FV1"), ("FV2R", "FV2t1"), ("FV5R", "FV5t1"))
    )
    rows.append(
        Row(
            "viscous friction over that of Table 3",
            f"FV1, FV2, FV5: {above}",
            "one value in each simulation",
            "",
            "the two tables of the paper differ; they state deviations of 9 to 22 %",
        )
    )
    rows += [
        Row(
            "rows of W",
            "15000",
            str(fit.rows),
            "",
            "three joints, 100 s at 200 Hz, every fourth sample kept",
        ),
        compared("condition number of W", "50", fit.condition, "", reason='"close to 50"; the motion is not given'),
        Row(
            "Figure 7, error of the torque of the forearm on an unseen motion",
            "a figure",
            f"{found.cross_error[2]:.1f} %",
            "",
            "joints 1 and 2: " + ", ".join(f"{error:.1f} %" for error in found.cross_error[:2]),
        ),
    ]
    return Section(
        "VI Identification results, Table 4 and Figure 7",
        f"{EXAMPLE}; Figure 7: `examples/cea_figures.py`. In brackets: relative deviations. Ours is simulated from "
        "Table 4, with 0.05 N m of noise and an encoder of 0.1 mrad assumed: its deviations follow from these",
        tuple(rows),
    )


def _within_ranges(felt: Felt) -> bool:
    """True if Coulomb force and stiffness are within what the paper states."""
    force, stiffness = felt.coulomb[0], felt.stiffness
    (least_force, most_force), (least, most) = COULOMB_RANGE_N, STIFFNESS_RANGE
    return bool(least_force <= force <= most_force and stiffness.min() >= least and stiffness.max() <= most)


def felt_by_a_hand() -> Section:
    result = around_the_posture()
    _, natural = nearest_posture()
    mass, stiffness = result.values["apparent_mass"], stiffnesses(result)
    force = result.values["coulomb_force"]
    weight = [1e3 * limit / 9.81 for limit in COULOMB_RANGE_N]
    tried = {(d3, d4): nearest_posture(lengths=LinkLengths(d3, d4))[1] for d3, d4 in TRIED}
    masses = [1e3 * one.mass[0] for one in tried.values() if _within_ranges(one)]
    least, most = min(masses), max(masses)
    rows = [
        Row(
            "link lengths",
            NOT_GIVEN,
            f"{LENGTHS.d3:g} and {LENGTHS.d4:g} m",
            "",
            f"posture and joint stiffness ({STIFFNESS_OF_RANGES:g} N m/rad) are those at which all three ranges hold; "
            f"the unit of Table 2 read as N m/mrad gives {joint_stiffness()[0]:g}",
        ),
        Row(
            "Figure 8, largest apparent mass at the natural posture",
            "close to 650 g",
            f"{1e3 * natural.mass[0]:.0f} g",
            f"{100 * (natural.mass[0] / 0.65 - 1):+.0f} %",
            f"no lengths are given: with those of the rows below at which both other ranges hold, {least:.0f} to "
            f"{most:.0f} g; "
            f"ours {1e3 * np.nanmin(mass):.0f} to {1e3 * np.nanmax(mass):.0f} g within 50 mm of the posture",
        ),
        compared(
            "largest apparent mass elsewhere",
            "800",
            1e3 * float(np.nanmax(mass)),
            "g",
            reason='"can reach"; ours within 50 mm of the natural posture, larger farther away',
        ),
        Row(
            "Figure 8, stiffness at the natural posture",
            "2000 to 5000 N/m",
            f"{natural.stiffness.min():.0f} to {natural.stiffness.max():.0f} N/m",
            "within",
            f"{stiffness.min():.0f} to {stiffness.max():.0f} N/m within 50 mm of it",
        ),
        Row(
            "Figure 9, largest Coulomb force",
            f"{COULOMB_RANGE_N[0]} to {COULOMB_RANGE_N[1]} N",
            f"{natural.coulomb[0]:.2f} N",
            "within",
            f"{np.nanmin(force):.2f} to {np.nanmax(force):.2f} N within 50 mm of it",
        ),
        Row("the same as a weight", "30 to 40 g", f"{weight[0]:.1f} to {weight[1]:.1f} g", "none", ""),
        Row("longest arm that Table 4 allows", NOT_GIVEN, f"{longest_arm():.3f} m", "", "beyond it no mass matrix"),
        Row("(20), F_d", "... - A qdd", "... - A J^-1 dJ/dt qd", "", "misprint: with ours (18) is exact"),
    ]
    for (d3, d4), other in tried.items():
        rows.append(
            Row(
                f"with links of {d3:g} and {d4:g} m",
                "650 g, 0.3 to 0.4 N, 2000 to 5000 N/m",
                f"{1e3 * other.mass[0]:.0f} g, {other.coulomb[0]:.2f} N, {other.stiffness.min():.0f} to "
                f"{other.stiffness.max():.0f} N/m",
                "",
                "at the posture nearest to what is published",
            )
        )
    return Section(
        "VII Performance of the upper branch, Figures 8 and 9",
        f"`examples/cea_figures.py` and {EXAMPLE}",
        tuple(rows),
    )
