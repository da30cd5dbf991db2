"""Maps of a workspace: grid, quantities, limits and files."""

from dataclasses import replace
from io import BytesIO

import matplotlib.image
import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import gravity_torque, mass_matrix
from phantom_dyn.dynamics.kinematics import frame_jacobian, frame_pose
from phantom_dyn.errors import ParameterError
from phantom_dyn.maps import inverse
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.inverse import cloud_of, nearest_branch
from phantom_dyn.maps.map_figures import figure
from phantom_dyn.maps.map_model import MapModel, joint_space, map_model, tip_of
from phantom_dyn.maps.operational_map import arrays, dataset, operational_map
from phantom_dyn.model.loading import load_robot
from places import ROBOTS

NAMES = ("manipulability", "apparent_mass_matrix", "stiffness", "coulomb_friction", "gravity_force")


@pytest.fixture(scope="module")
def result():
    model = map_model(load_robot("cea_branch"))
    return operational_map(model, read_grid("x=0.3:0.9:4,z=-0.1:0.1:3", model.joint_names), NAMES)


def pixels(result, name):
    """A figure drawn, shape (height, width, 4)."""
    file = BytesIO()
    figure(result, name).savefig(file, format="png")
    return matplotlib.image.imread(BytesIO(file.getvalue()))


def test_the_arrays_are_the_coordinates_and_the_quantities(result):
    found = arrays(result)
    assert set(found) == {"x", "z", *NAMES}
    assert found["coulomb_friction"].shape == (4, 3, 3, 3)


def test_the_dataset_finds_a_value_by_its_coordinates(result):
    # Oracle: xarray's own selection.
    value = dataset(result)["apparent_mass_matrix"].sel(x=0.5, z=0.0, row="y", column="y", method=None)
    assert float(value) == result.values["apparent_mass_matrix"][1, 1, 1, 1]


def test_coulomb_friction_has_a_column_for_each_joint(result):
    assert dataset(result)["coulomb_friction"].coords["joint"].values.tolist() == ["q1", "q2", "q5"]


def test_the_dataset_says_units_and_counts(result):
    data = dataset(result)
    assert data["x"].attrs["units"] == "m"
    assert data["apparent_mass_matrix"].attrs["units"] == "kg"
    assert (data.attrs["points"], data.attrs["unreachable_points"]) == (12, result.unreachable)


def test_the_unit_reading_of_the_stiffness_goes_with_it(result):
    assert "N m/mrad" in dataset(result)["stiffness"].attrs["comment"]
    assert "N m/mrad" in figure(result, "stiffness").get_suptitle()


def test_joint_coordinates_are_in_radians_or_metres(arm):
    # Known truth: turn is a rotation, slide is linear.
    model = map_model(arm)
    data = dataset(operational_map(model, read_grid("q.turn=0:1:2,q.slide=0:0.1:2", model.joint_names), NAMES[:1]))
    assert (data["q.turn"].attrs["units"], data["q.slide"].attrs["units"]) == ("rad", "m")


@pytest.mark.parametrize(
    "grid",
    [
        "x=0.5:0.5:1",
        "x=0.3:0.6:7",
        "x=0.3:0.9:7,z=-0.1:0.1:5",
        "x=0.3:0.9:5,y=-0.1:0.1:4,z=-0.1:0.1:3",
        "x=5:6:3,z=0:1:3",
        "q.q1=0:1:2,q.q2=-1:0:2,q.q5=0.2:1:2",
    ],
    ids=["point", "curve", "section", "space", "out of reach", "joints"],
)
def test_every_kind_of_grid_is_drawn(grid, recwarn):
    # Oracle: an image that is more than white.
    model = map_model(load_robot("cea_branch"))
    image = pixels(operational_map(model, read_grid(grid, model.joint_names), NAMES[:1]), NAMES[0])
    assert image[..., :3].min() < 0.9
    assert [str(warning.message) for warning in recwarn] == []


@pytest.mark.parametrize("name", NAMES[1:])
def test_every_quantity_is_drawn(result, name):
    # Oracle: an image that is more than white.
    assert pixels(result, name)[..., :3].min() < 0.9


def test_a_matrix_is_drawn_by_its_diagonal(result):
    titles = [ax.get_title() for ax in figure(result, "apparent_mass_matrix").axes if ax.get_title()]
    assert titles == [f"apparent mass, {axis} [kg]" for axis in ("xx", "yy", "zz")]


def test_height_goes_up_in_a_section():
    # The convention of figure 3: y upwards, z to the right.
    model = map_model(load_robot("phantom_1_5"))
    grid = read_grid("x=0:0:1,y=-0.1:0.1:3,z=-0.1:0.1:4", model.joint_names)
    (ax, _) = figure(operational_map(model, grid, NAMES[:1]), "manipulability").axes
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("z [m]", "y [m]")


def test_the_caption_says_where_the_section_is_and_what_is_blank():
    model = map_model(load_robot("phantom_1_5"))
    result = operational_map(model, read_grid("x=0.05:0.05:1,y=0:0.5:4,z=0:0.5:4", model.joint_names), NAMES[:1])
    caption = " ".join(figure(result, "manipulability").get_suptitle().split())
    assert "section at x = 0.05" in caption
    assert f"blank: {result.unreachable} out of reach, of 16 points" in caption


def test_a_field_that_is_the_same_everywhere_is_drawn(phantom, recwarn):
    # The PHANToM's model has no friction.
    model = map_model(phantom)
    result = operational_map(model, read_grid("y=-0.1:0.1:3,z=-0.1:0.1:4", model.joint_names), ["viscous_friction"])
    assert pixels(result, "viscous_friction").shape[2] == 4
    assert np.nanmax(np.abs(result.values["viscous_friction"])) == 0
    assert [str(warning.message) for warning in recwarn] == []


def titles(result, name) -> list[str]:
    return [ax.get_title() for ax in figure(result, name).axes if ax.get_title()]


def test_friction_of_all_joints_is_drawn_along_each_axis(result):
    # Known truth: by its symmetry q1 alone acts along y in the plane y = 0, 0.12 N m over the distance to its axis.
    assert titles(result, "coulomb_friction") == [f"Coulomb friction, along {axis} [N]" for axis in "xyz"]
    along_y = np.linalg.norm(result.values["coulomb_friction"], axis=-1)[..., 1]
    x = np.broadcast_to(result.grid.values[0][:, None], along_y.shape)
    torque = load_robot("cea_branch").coulomb_friction[0]
    reached = np.isfinite(along_y)
    np.testing.assert_allclose(along_y[reached], torque / x[reached], rtol=1e-6)


def test_a_panel_that_holds_rounding_alone_is_left_out(result):
    # Made by hand: along y there is nothing but rounding.
    weight = np.ones((4, 3, 3)) * np.array([1.0, 1e-16, 2.0])
    made = replace(result, values={"gravity_force": weight})
    assert titles(made, "gravity_force") == [f"force that holds the weight, {axis} [N]" for axis in "xz"]


def drawn(result, name, values):
    """Axes, areas and lines' levels of a section whose values were made by hand."""
    made = replace(result, values={name: values})
    (ax, *_) = [ax for ax in figure(made, name).axes if ax.get_title()]
    return ax, ax.collections[0].levels


def test_levels_are_logarithmic_beyond_a_decade(result):
    # Known truth: a map made by hand whose values span two decades, and one whose values span half of one.
    _, levels = drawn(result, "apparent_mass", np.geomspace(1.0, 100.0, 12).reshape(4, 3))
    assert {1.0, 10.0, 100.0} <= set(np.round(levels, 9))
    _, levels = drawn(result, "apparent_mass", np.linspace(1.0, 5.0, 12).reshape(4, 3))
    np.testing.assert_allclose(np.diff(levels), np.diff(levels)[0])


def test_what_lies_between_0_and_1_by_definition_has_even_levels(result):
    _, levels = drawn(result, "manipulability", np.geomspace(0.01, 1.0, 12).reshape(4, 3))
    assert np.diff(levels).max() < 0.2


@pytest.fixture(scope="module")
def wide(result):
    """The same plane with fifty points along both axes."""
    axes = (np.linspace(0.3, 0.9, 50), np.linspace(-0.1, 0.1, 50))
    return replace(result, grid=replace(result.grid, values=axes))


def test_no_colour_holds_more_than_a_third_of_the_points(wide):
    # Made by hand: nearly all values are within a hundredth of 1, few reach 50.
    values = 1.0 + 0.01 * np.random.default_rng(0).uniform(size=(50, 50))
    values[:2] = 50.0
    _, levels = drawn(wide, "apparent_mass", values)
    counts = np.histogram(values, [-np.inf, *levels, np.inf])[0]
    assert counts.max() <= values.size / 3 + 1


def marked(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_extremes_of_either_sign_are_marked_and_none_on_the_rim_of_reach(wide):
    values = np.ones((50, 50))
    values[:10] = np.nan
    values[10, 20], values[30, 30], values[40, 40] = 9.0, -4.0, 3.0
    ax, _ = drawn(wide, "apparent_mass", values)
    assert marked(ax) == ["largest off the rim: 3", "smallest: -4"]


def test_a_value_that_grows_to_the_rim_of_the_section_has_no_mark(wide):
    values = np.repeat(np.linspace(4.0, 1.0, 50)[:, None], 50, axis=1)
    ax, _ = drawn(wide, "apparent_mass", values)
    assert ax.get_legend() is None


def test_a_section_that_is_singular_everywhere_says_so(wide):
    made = replace(wide, values={"coulomb_force": np.full((50, 50), np.nan)}, unreachable=0, singular=2500)
    (ax,) = figure(made, "coulomb_force").axes
    assert ax.texts[0].get_text() == "singular at every point"


def test_zero_everywhere_is_said_and_not_drawn(wide):
    made = replace(wide, values={"coulomb_force": np.zeros((50, 50))})
    (ax,) = figure(made, "coulomb_force").axes
    assert ax.texts[0].get_text() == "zero wherever a point can be reached"


def test_panels_of_one_figure_have_one_kind_of_scale(wide):
    # Made by hand: along x values span two decades, along y a tenth of one.
    matrix = np.zeros((50, 50, 3, 3))
    matrix[..., 0, 0] = np.geomspace(1.0, 100.0, 2500).reshape(50, 50)
    matrix[..., 1, 1] = np.linspace(1.0, 1.3, 2500).reshape(50, 50)
    made = replace(wide, values={"apparent_mass_matrix": matrix})
    first, second = (ax for ax in figure(made, "apparent_mass_matrix").axes if ax.get_title())
    # Levels of a logarithmic scale are 1, 2 and 5 times a power of ten, those between divide what is full.
    assert {1.0, 2.0} <= set(np.round(first.collections[0].levels, 9))
    assert {1.0, 2.0} <= set(np.round(second.collections[0].levels, 9))


def test_numbers_on_lines_keep_apart(wide):
    x, y = np.meshgrid(np.linspace(-1, 1, 50), np.linspace(-1, 1, 50), indexing="ij")
    ax, _ = drawn(wide, "apparent_mass", 1.0 + 0.5 * np.exp(-4 * (x**2 + y**2)))
    size = np.array([np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim())])
    places = np.array([text.get_position() for text in ax.texts]) / size
    apart = np.abs(places[:, None] - places).max(axis=2)[np.triu_indices(len(places), 1)]
    assert len(places) >= 2
    assert apart.min() > 0.08
    # Nor are they cut by the rim of the axes.
    middle = np.array([np.mean(ax.get_xlim()), np.mean(ax.get_ylim())]) / size
    assert np.abs(places - middle).max() < 0.47


def test_the_largest_value_and_the_origin_are_marked():
    model = map_model(load_robot("cea_branch"))
    found = operational_map(model, read_grid("x=-0.5:0.5:5,z=-0.4:0.1:6", model.joint_names), ["apparent_mass"])
    values = np.ones((5, 6))
    values[2, 3] = 2.5
    ax, _ = drawn(found, "apparent_mass", values)
    assert marked(ax) == ["largest: 2.5", "origin"]


def test_equal_largest_values_on_a_line_are_marked_along_it(wide):
    # Made by hand: a ridge of 4 along the whole middle of 50 points.
    values = np.repeat(4.0 - np.abs(np.arange(50) - 25.0)[:, None] / 25.0, 50, axis=1)
    ax, _ = drawn(wide, "apparent_mass", values)
    (crosses,) = [line for line in ax.lines if line.get_marker() == "x"]
    np.testing.assert_allclose(crosses.get_ydata(), np.linspace(*ax.get_ylim(), 6), atol=0.03 * np.ptp(ax.get_ylim()))


def test_the_caption_says_why_points_are_blank():
    model = map_model(load_robot("cea_branch"))
    found = operational_map(model, read_grid("x=-0.2:0.2:3,z=-0.4:0.1:6", model.joint_names), ["apparent_mass"])
    caption = " ".join(figure(found, "apparent_mass").get_suptitle().split())
    assert found.singular
    assert f"{found.singular} singular, where the tip cannot move in some direction" in caption
    assert "of several postures that reach a point the one nearest to q1 = 0, q2 = -0.785, q5 = 0.785" in caption


JOINTS = ("theta1", "theta2", "theta3")


def test_both_ends_of_an_axis_are_included():
    np.testing.assert_array_equal(read_grid("x=-0.1:0.1:5", JOINTS).values[0], np.linspace(-0.1, 0.1, 5))


def test_points_run_fastest_along_the_last_axis():
    # Oracle: numpy's meshgrid.
    grid = read_grid("q.theta3=0:1:3, q.theta1=-1:1:2", JOINTS)
    expected = np.stack(np.meshgrid(*grid.values, indexing="ij"), axis=-1).reshape(-1, 2)
    np.testing.assert_array_equal(grid.points(0, grid.size), expected)


def test_blocks_of_points_follow_each_other():
    grid = read_grid("x=0:1:3,y=0:1:4,z=0:1:5", JOINTS)
    blocks = [grid.points(k, min(k + 7, grid.size)) for k in range(0, grid.size, 7)]
    np.testing.assert_array_equal(np.concatenate(blocks), grid.points(0, 60))


def test_one_point_makes_a_section():
    assert read_grid("x=0.1:0.1:1,y=0:1:4", JOINTS).shape == (1, 4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x", r"has 'x', wanted NAME=START:STOP:COUNT such as x=-0\.1:0\.1:41"),
        ("x=0:1:3,", "has '', wanted NAME=START:STOP:COUNT"),
        ("w=0:1:3", "unknown axis 'w': the axes are x, y, z, q.theta1"),
        ("q.theta=0:1:3", r"unknown axis 'q\.theta'.*did you mean q\.theta"),
        ("x=0:1", "axis x of the grid is '0:1', wanted START:STOP:COUNT"),
        ("x=0:1:3:4", "axis x of the grid is '0:1:3:4', wanted"),
        ("x=a:1:3", "axis x of the grid is 'a:1:3', wanted"),
        ("x=0:1:2.5", r"axis x of the grid is '0:1:2\.5', wanted"),
        ("x=nan:1:3", "axis x of the grid is 'nan:1:3', wanted"),
        ("x=0:inf:3", "axis x of the grid is '0:inf:3', wanted"),
        ("x=0:1e308:3", r"axis x of the grid is '0:1e308:3': give m or rad, up to 1e\+06"),
        ("x=0:1:1", "give START and STOP apart with at least 2 points, or both the same with 1 point"),
        ("x=0:0:5", "give START and STOP apart"),
        ("x=0:1:0", "give START and STOP apart"),
        ("x=0:1:-3", "give START and STOP apart"),
        ("x=0:1:90000000000", "axis x of the grid has 90000000000 points, wanted at most"),
        ("x=0:1:1000,y=0:1:1000,z=0:1:1000", "The grid has 1000000000 points, wanted at most 20000000: take larger"),
        ("x=0:1:3,x=0:1:3", "has the axis x twice: give it once"),
        ("x=0:1:3,q.theta1=0:1:3", r"mixes x, q\.theta1: give a grid over the tip"),
    ],
)
def test_a_grid_that_cannot_be_read_is_refused_in_a_sentence(text, message):
    with pytest.raises(ParameterError, match=message):
        read_grid(text, JOINTS)


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> MapModel:
    """The five-bar with limits of more than a turn, and motors so far apart that its arms may point away."""
    path = tmp_path_factory.mktemp("wide") / "fivebar.urdf"
    text = (ROBOTS / "fivebar.urdf").read_text()
    wide = text.replace('lower="-3" upper="3"', 'lower="-3.3" upper="3.3"')
    wide = wide.replace('xyz="-0.15 0 0"', 'xyz="-0.22 0 0"').replace('xyz="0.15 0 0"', 'xyz="0.22 0 0"')
    assert wide.count("0.22 0 0") == 2
    assert wide.count("3.3") == 8
    path.write_text(wide)
    return map_model(load_robot(path, config=ROBOTS / "fivebar.yaml"))


@pytest.fixture(scope="module")
def cloud(model):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inverse, "_NUMERIC_SAMPLES", 100)
        return cloud_of(model)


def test_only_postures_that_close_are_starts(model, cloud):
    assert 20 < len(cloud.q) < 100
    assert np.isfinite(cloud.tip).all()


def test_a_point_is_reached_by_the_posture_that_it_is_the_tip_of_and_one_out_of_reach_by_none(model, cloud):
    at = np.array([[0.15, -0.1], [-0.2, 0.05]])
    points = np.vstack([tip_of(model, at)[0], [[2.0, 0.0, 2.0]]])
    found = nearest_branch(model, points, cloud, axes=(0, 2))
    np.testing.assert_allclose(found[:2], at, atol=1e-6)
    assert np.isnan(found[2]).all()


BUILT = ["phantom_1_5", "cea_branch", "example:ur10", "example:panda", "example:kinova"]


@pytest.fixture(params=[*BUILT, "arm", "four_bar"])
def robot(request):
    named = request.param
    return request.getfixturevalue(named) if named in ("arm", "four_bar") else load_robot(named)


def test_the_tip_is_where_pinocchio_puts_it(robot, configurations):
    q, model = configurations(robot), map_model(robot)
    np.testing.assert_allclose(tip_of(model, q)[0], frame_pose(robot, q, model.frame)[1], rtol=0, atol=1e-12)


def test_the_jacobian_is_that_of_pinocchio(robot, configurations):
    q, model = configurations(robot), map_model(robot)
    expected = frame_jacobian(robot, q, model.frame, "hybrid")[:, :3]
    np.testing.assert_allclose(joint_space(model, q, inertia=False).J, expected, rtol=0, atol=1e-12)


def test_the_mass_matrix_is_that_of_pinocchio(robot, configurations):
    q = configurations(robot)
    M = joint_space(map_model(robot), q, inertia=True).M
    expected = mass_matrix(robot, q)
    np.testing.assert_allclose(M, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_the_weight_is_that_of_pinocchio(robot, configurations):
    q = configurations(robot)
    weight = joint_space(map_model(robot), q, inertia=True).weight
    np.testing.assert_allclose(weight, gravity_torque(robot, q), rtol=0, atol=1e-11)
