import numpy as np
import pytest

from phantom_dyn.errors import RobotError

PINS = "kind: point, frame_a: coupler_pin, frame_b: rocker_pin"
IDLE = "joints: {coupler: {actuated: false}, rocker: {actuated: false}}\n"


def linear(passive: str, active: str = "crank") -> str:
    return f"loops: [{{kind: linear, active: [{active}], passive: {{{passive}}}}}]"


def test_joints_with_an_expression_are_passive(load):
    robot = load("parallelogram.urdf", linear("coupler: -crank, rocker: crank"))
    assert (robot.joint_names, robot.passive_names, robot.nv) == (("crank",), ("coupler", "rocker"), 1)


def test_joints_of_a_loop_without_a_drive_are_passive(load):
    robot = load("fourbar.urdf", IDLE + f"loops: [{{{PINS}}}]")
    assert (robot.joint_names, robot.passive_names) == (("crank",), ("coupler", "rocker"))


def test_joints_of_a_loop_that_its_active_list_leaves_out_are_passive(load):
    robot = load("fourbar.urdf", f"loops: [{{{PINS}, active: [rocker], start: {{crank: 0.1}}}}]")
    assert (robot.joint_names, robot.passive_names) == (("rocker",), ("crank", "coupler"))


def test_a_joint_off_every_loop_stays_active_without_a_drive(load):
    robot = load("parallelogram.urdf", "joints: {crank: {actuated: false}}\n" + linear("coupler: -crank"))
    assert robot.joint_names == ("crank", "rocker")


def test_an_expression_may_use_a_joint_that_another_loop_gives(load):
    first = "{kind: linear, active: [crank], passive: {coupler: 0.5 - crank}}"
    second = "{kind: linear, active: [coupler], passive: {rocker: 1 - 2*coupler}}"
    robot = load("parallelogram.urdf", f"loops: [{second}, {first}]")
    positions = robot.chain.linear_map @ [0.3] + robot.chain.offset
    np.testing.assert_allclose(positions, [0.3, 0.2, 0.6])


def test_drives_and_friction_are_those_of_the_active_joints(load):
    rotors = "joints: {crank: {rotor_inertia: 0.1}, rocker: {rotor_inertia: 0.2}}\n"
    robot = load("parallelogram.urdf", rotors + linear("coupler: -crank, rocker: crank"))
    assert [a.rotor_inertia for a in robot.actuators] == [0.1] == robot.rotor_inertia.tolist()
    assert (robot.viscous_friction.tolist(), robot.coulomb_friction.tolist()) == ([0.01], [0.02])
    assert (robot.chain.viscous_friction.tolist(), robot.chain.coulomb_friction.tolist()) == ([0, 0.03], [0, 0.05])


def test_a_drive_on_a_passive_joint_is_reported(load):
    robot = load("parallelogram.urdf", "joints: {rocker: {gear_ratio: 3}}\n" + linear("coupler: -crank, rocker: crank"))
    assert "Of the drives of rocker only the rotors count, as these joints are passive." in robot.warnings


def test_a_mimic_joint_that_a_loop_moves_is_not_held(load):
    mimic = ('<child link="rocker_link"/>', '<child link="rocker_link"/><mimic joint="crank"/>')
    robot = load("parallelogram.urdf", linear("coupler: -crank, rocker: crank"), mimic)
    assert (robot.locked, robot.passive_names) == ((), ("coupler", "rocker"))


def test_the_start_says_which_way_the_loop_is_assembled(load):
    up = load("fourbar.urdf", f"loops: [{{{PINS}, active: [crank]}}]").chain.start
    down = load("fourbar.urdf", f"loops: [{{{PINS}, active: [crank], start: {{coupler: 1, rocker: 2.5}}}}]").chain.start
    # Closed form: mirrored in the line from the crank's pin to the rocker's, which lies along x at crank 0.
    assert down[2] == pytest.approx(np.pi - up[2], abs=1e-9)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (
            linear("coupler: sin(crank)"),
            r"loops\[0\]\.passive\.coupler is 'sin\(crank\)', and it is more than a sum",
        ),
        (linear("coupler: -rocker"), "and 'rocker' in it is none of crank, nor pi"),
        (linear("crank: -crank"), r"loops\[0\]\.passive\.crank is active in the same loop"),
        (linear(""), r"loops\[0\]\.passive is empty: give each passive joint its expression"),
        (linear("couple: crank"), r"loops\[0\]\.passive names the unknown joint 'couple', .*did you mean coupler\?"),
        (
            "lock: [coupler]\n" + linear("coupler: crank"),
            r"names 'coupler', which lock holds fixed: take it out of one",
        ),
        (
            "loops: [{kind: linear, active: [crank], passive: {rocker: crank}},"
            " {kind: linear, active: [crank], passive: {rocker: -crank}}]",
            r"loops\[1\]\.passive\.rocker is in another loop already",
        ),
        (
            "loops: [{kind: linear, active: [crank], passive: {rocker: crank}},"
            " {kind: linear, active: [rocker], passive: {crank: rocker}}]",
            r"the loops lead in a circle \(rocker follows crank follows rocker\): give one of these joints as active",
        ),
        (linear("crank: '0', coupler: '0', rocker: '0'", ""), "the loops leave no active joint"),
        (f"loops: [{{{PINS}}}]", r"has no passive joint: of crank, coupler, rocker, list the driven ones under active"),
        (
            "joints: {rocker: {actuated: false}}\n" + f"loops: [{{{PINS}}}]",
            "determine 2 joints and rocker is passive: make 1 more passive",
        ),
        (f"loops: [{{{PINS}, active: []}}]", "the loops leave no active joint"),
        (f"loops: [{{{PINS}, active: [cranc]}}]", r"loops\[0\]\.active names the unknown joint 'cranc'"),
        (f"loops: [{{{PINS}, active: [crank], start: {{cranc: 0}}}}]", r"loops\[0\]\.start names the unknown joint"),
        (
            f"loops: [{{{PINS}, active: [crank], start: {{crank: far}}}}]",
            r"loops\[0\]\.start is .*each with a position",
        ),
        (
            "loops: [{kind: point, frame_a: coupler_pin, frame_b: coupler_link}]",
            r"no joint moves one of the frames of loops\[0\] \(coupler_pin to coupler_link\) and not the other",
        ),
        ("loops: [{kind: frame, frame_a: coupler_pin}]", r"loops\[0\]\.frame_b is missing"),
    ],
)
def test_loops_that_contradict_or_say_too_little_are_refused(load, config, message):
    with pytest.raises(RobotError, match=message):
        load("fourbar.urdf", config)


def test_a_loop_that_cannot_be_closed_is_refused_with_its_distance(load):
    far = ('<origin xyz="0.3 0 0"/>', '<origin xyz="3 0 0"/>')
    # Closed form: crank, coupler and rocker in one line reach 0.1 + hypot(0.25, 0.05) + 0.2 of 3 m.
    with pytest.raises(RobotError, match=r"\(coupler_pin to rocker_pin\) cannot be closed, .*2\.45 m apart"):
        load("fourbar.urdf", f"loops: [{{{PINS}, active: [crank]}}]", far)


def test_a_start_in_which_a_parallelogram_is_flat_is_refused(load):
    flat = "start: {crank: 1.5707963267948966, coupler: -1.5707963267948966, rocker: 1.5707963267948966}"
    with pytest.raises(RobotError, match="is singular at its start, so the way of assembly is open: give start"):
        load("parallelogram.urdf", f"loops: [{{{PINS}, active: [crank], {flat}}}]")


def test_more_passive_joints_than_the_loops_determine_are_refused(load):
    ends = '<parent link="coupler_link"/><child link="tail"/><axis xyz="0 1 0"/>'
    spin = f'<joint name="spin" type="continuous">{ends}</joint>'
    config = f"loops: [{{{PINS}, active: [crank]}}]"
    changes = (
        ("</robot>", f'<link name="tail"/>{spin}</robot>'),
        ('"coupler_link"/>\n    <child link="coupler_pin"/>', '"tail"/><child link="coupler_pin"/>'),
    )
    with pytest.raises(RobotError, match=r"determine 2 passive joints of 3, .* is not determined: make it active"):
        load("fourbar.urdf", config, *changes)
