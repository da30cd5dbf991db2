"""Examples print and draw what the library computes."""

import importlib
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import phantom_dyn as dyn
from called_example import EXAMPLES, printed
from called_example import printed as printed_by
from identification.cli.main import main
from phantom_dyn.devices.cea import FRICTION_TESTS
from places import CHECKOUT


@pytest.fixture(scope="module")
def out() -> str:
    return printed("identify_cea.py")


@pytest.mark.whole
def test_it_prints_the_known_rank(out):
    assert "cea_branch: 21 of 60 inertial parameters" in out


@pytest.mark.whole
def test_it_prints_the_regrouping_of_joint_5(out):
    # Known: MX5R = MX5 + d6 M6 - (d6 / d3) MX6.
    assert "link5.mxR = link5.mx + 0.08 link6.m - 0.2 link6.mx" in out


@pytest.mark.whole
def test_friction_is_within_three_deviations_of_test_t1(out):
    # Known truth: what Table 3 gives for t1, in all tests, as the passive joints are free.
    rows = re.findall(r"^  ((?:FV|FC)[25])(t\d) +([\d.]+) \+- ([\d.]+)", out, flags=re.MULTILINE)
    assert len(rows) == 8
    for name, _, value, std in rows:
        assert abs(float(value) - FRICTION_TESTS[f"{name}t1"].value) < 3 * float(std) + 1e-4


@pytest.mark.whole
def test_the_stiffness_is_the_published_one(out):
    found = re.search(r"^  K ([\d.]+) \+- ", out, flags=re.MULTILINE)
    assert found
    assert float(found[1]) == pytest.approx(2.0, rel=0.004)


@pytest.mark.whole
def test_all_16_parameters_stand_beside_table_4(out):
    rows = re.findall(r"^\w+ +(-?[\d.]+) \+- ([\d.]+) .* Table 4 +(-?[\d.]+)", out, flags=re.MULTILINE)
    assert len(rows) == 16
    assert all(abs(float(value) - float(truth)) < 3.5 * float(std) for value, std, truth in rows)


@pytest.mark.whole
def test_the_cross_test_error_of_each_axis_is_printed(out):
    assert re.search(r"unseen motion: q1 [\d.]+ %, q2 [\d.]+ %, q5 [\d.]+ %", out)


@pytest.mark.whole
def test_the_spread_over_link_lengths_is_printed(out):
    # Known: only links of 0.35 m and more come to 0.4 N or less.
    forces = re.findall(r"d3 ([\d.]+) m, d4 .*: [\d.]+ kg, ([\d.]+) N", out)
    assert len(forces) == 6
    assert [float(force) <= 0.40 for _, force in forces] == [float(d3) >= 0.35 for d3, _ in forces]


@pytest.fixture(scope="module")
def map_printed(tmp_path_factory):
    """What the example prints, and the folder that it writes to."""
    folder = tmp_path_factory.mktemp("maps")
    return printed_by("phantom_maps.py", folder), folder


@pytest.mark.whole
def test_it_prints_the_largest_manipulability(map_printed):
    assert "largest manipulability 0.7906976744, published lengths say 34/43 = 0.7906976744" in map_printed[0]


@pytest.mark.whole
def test_it_prints_the_apparent_mass_at_the_origin(map_printed):
    # Published parameters.
    assert "apparent mass at the origin: 77.306 g, 52.491 g, 32.245 g" in map_printed[0]


@pytest.mark.whole
def test_the_files_that_it_names_are_there(map_printed):
    named = re.findall(r"^wrote (.*)$", map_printed[0], flags=re.MULTILINE)
    assert len(named) == 6
    assert all(Path(name).is_file() for name in named)


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    return importlib.import_module("own_effect")


@pytest.mark.whole
def test_it_is_at_most_forty_lines():
    assert len((EXAMPLES / "own_effect.py").read_text().splitlines()) <= 40


@pytest.mark.whole
@pytest.mark.nightly
def test_it_finds_nothing_where_nothing_is_and_the_size_that_was_put_in(example, monkeypatch):
    found, diagnose = [], dyn.diagnose

    def kept(*arguments, **options):
        found.append(diagnose(*arguments, **options))
        return found[-1]

    monkeypatch.setattr(dyn, "diagnose", kept)
    example.main()
    none, some = found
    assert (none.verdict, none.findings) == ("no_gap", ())
    (finding,) = some.findings
    size = finding.parameters["coefficient"]
    assert (some.verdict, finding.effect, finding.joint) == ("explained", "bellows", "axis")
    assert abs(size.value - 50.0) < 2.0 * size.std < 1.0


@pytest.fixture(scope="module")
def branches(tmp_path_factory) -> str:
    return printed("cea_two_branches.py", tmp_path_factory.mktemp("two"))


@pytest.mark.nightly
@pytest.mark.whole
def test_it_counts_the_parameters_of_both_branches(branches):
    assert "58 inertial base parameters: 21 of each branch" in branches


@pytest.mark.nightly
@pytest.mark.whole
def test_it_moves_within_the_published_workspace(branches):
    """Published: more than 200 mm in translation in any direction."""
    found = re.search(r"moved within (\d+) x (\d+) x (\d+) mm", branches)
    assert found
    assert min(map(int, found.groups())) > 200


@pytest.mark.nightly
@pytest.mark.whole
def test_its_platform_turns_by_more_than_is_published(branches):
    """Published: over 150 degrees about any axis. A universal joint has half a turn between its singularities."""
    found = re.search(r"the platform turns by (\d+) degrees about x, (\d+) degrees about z", branches)
    assert found
    assert [int(angle) for angle in found.groups()] == [180, 360]


@pytest.mark.nightly
@pytest.mark.whole
def test_each_rod_has_one_parameter(branches):
    """Published: one parameter per rod."""
    assert re.findall(r"^  (?:no|one|both) rods?.*? (\d+)$", branches, flags=re.MULTILINE) == ["22", "23", "24", "22"]


@pytest.mark.nightly
@pytest.mark.whole
def test_the_page_states_the_mass_that_is_printed(branches):
    found = re.search(r"apparent mass ([\d.]+ to [\d.]+ kg)", branches)
    assert found
    assert f"{found[1]} at the handle" in " ".join((CHECKOUT / "docs" / "haptics.md").read_text().split())


@pytest.mark.nightly
@pytest.mark.whole
def test_friction_is_found_proportional_to_the_pretension(branches):
    assert "proportional True" in branches


@pytest.mark.nightly
@pytest.mark.whole
def test_maps_are_written_where_the_output_says(branches):
    assert re.search(r"^wrote .*apparent_mass\.png$", branches, flags=re.MULTILINE)


@pytest.fixture
def large_work(rubbing_pendulum, monkeypatch) -> list[str]:
    """The snippets of the page on large work, in a folder with the files that they name: one log under two names."""
    shutil.copy(rubbing_pendulum / "log.csv", rubbing_pendulum / "one.csv")
    shutil.copy(rubbing_pendulum / "log.csv", rubbing_pendulum / "two.csv")
    monkeypatch.chdir(rubbing_pendulum)
    return re.findall(r"```python\n(.*?)```", (CHECKOUT / "docs" / "large_work.md").read_text(), flags=re.DOTALL)


@pytest.mark.whole
def test_the_page_on_large_work_diagnoses_each_log_on_dask(large_work):
    # Known truth: Coulomb friction on the pin. A scheduler of this process stands for that of the page.
    names = {}
    exec(large_work[0].replace('"scheduler:8786"', "processes=False, dashboard_address=None"), names)
    names["client"].close()
    assert {row.document["findings"][0]["effect"] for row in names["result"].rows} == {"coulomb_friction"}


@pytest.mark.whole
def test_the_page_on_large_work_fits_logs_that_it_reads_one_by_one(large_work):
    # Closed form: a log that is there twice gives the estimate of one, with deviations smaller by the root of two.
    fits = []
    for snippet in (large_work[1], large_work[1].replace(', "two.csv"', "")):
        names = {}
        exec(snippet, names)
        fits.append(names["fit"])
    both, one = fits
    assert both.names == ("rod.mx", "rod.mz", "rod.Iyy")
    np.testing.assert_allclose(both.theta, one.theta)
    np.testing.assert_allclose(both.std() * np.sqrt(2), one.std(), rtol=1e-3)  # a degree of freedom less in one


PAGE = (CHECKOUT / "docs" / "tutorials" / "so101_lerobot.md").read_text()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the first command of the page was given."""
    here = tmp_path_factory.mktemp("lesson")
    printed("so101_dataset.py", here / "so101")
    return here


@pytest.mark.whole
def test_the_page_shows_the_answer_that_its_command_prints(folder, monkeypatch, capsys):
    # Oracle: the run itself.
    (command,) = re.findall(r"```\nphantom-dyn (diagnose .*?) --out report/\n```", PAGE)
    (answer,) = re.findall(r"```\n(The gap between robot and model .*?)```", PAGE, flags=re.DOTALL)
    monkeypatch.chdir(folder)
    assert main([*command.split(), "--quick"]) == 0
    assert capsys.readouterr().out.startswith(answer)


@pytest.mark.whole
def test_without_a_column_map_the_unit_is_asked_for(folder, monkeypatch, capsys):
    (command,) = re.findall(r"```\nphantom-dyn (check .*)\n```", PAGE)
    monkeypatch.chdir(folder)
    assert main(command.split()) != 0
    said = "".join(capsys.readouterr())
    assert "does not say the unit of its joints" in said
    assert 'q.elbow_flex: {from: "observation.state.elbow_flex.pos", unit: deg}' in said


@pytest.mark.whole
@pytest.mark.parametrize("name", ["columns.yaml", "robot.yaml"])
def test_the_page_shows_the_files_that_the_script_writes(folder, name):
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)
    assert (folder / "so101" / name).read_text() in blocks


@pytest.mark.whole
def test_frames_are_counted_within_and_across_episodes(folder):
    # Oracle: LeRobot's layout v3.0, in which timestamp is frame_index / fps and index runs through all episodes.
    (path,) = (folder / "so101").glob("data/chunk-000/file-*.parquet")
    rows = pq.read_table(path).to_pydict()
    info = json.loads((folder / "so101" / "meta" / "info.json").read_text())
    assert set(rows) == set(info["features"])
    assert rows["index"] == list(range(info["total_frames"]))
    np.testing.assert_allclose(rows["timestamp"], np.array(rows["frame_index"]) / info["fps"], rtol=1e-6)
