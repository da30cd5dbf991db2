"""Sealed cases of real recordings: sizes, parts, context and files. Oracle: closed forms, and what was recorded."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.makes.real import case as real_case
from benchmarks.blind.makes.real import laws
from benchmarks.blind.makes.real.body import torques, with_link
from benchmarks.blind.makes.real.case import trimmed
from benchmarks.blind.makes.real.context import context_of, entry_without_context, places, without_context
from benchmarks.blind.makes.real.given import PartOne, log_text
from benchmarks.blind.makes.real.motion import at_rows
from benchmarks.blind.makes.real.recordings import SOURCES, Run, Source, parts
from benchmarks.blind.makes.real.rivals import alike
from benchmarks.blind.makes.real.sizing import beyond_tolerance, change, gap, ruler, sized
from benchmarks.blind.processes import run_case
from benchmarks.gapbench.cases import robot_and_log
from benchmarks.gapbench.scoring.judged import judged
from rods import FAR, MASS, ROD, G, rod_scene


def rod_ruler(floor=0.05):
    scene = rod_scene()
    return ruler(scene, np.array([floor]))


def test_a_gap_is_the_root_mean_square_in_noise_floors():
    by = rod_ruler(0.05)
    more = change(by, by.scene.runs, laws.torque_offset(by.scene, 0, np.random.default_rng(0)).put(0.1))
    assert gap(by, more) == pytest.approx(0.1 * by.scene.torque[0] / 0.05, rel=1e-6)


def test_an_offset_of_the_encoder_changes_the_weight_by_its_slope():
    by = rod_ruler()
    effect = laws.encoder_offset(by.scene, 0, np.random.default_rng(0))
    more = change(by, by.scene.runs, effect.put(0.01))[:, 0]
    offset = effect.parameters(0.01)["offset"]
    np.testing.assert_allclose(more, -MASS * G * FAR * np.cos(by.q[:, 0]) * offset, rtol=2e-2)


def test_a_mass_within_its_tolerance_leaves_nothing():
    by = rod_ruler(0.01)
    run, model = by.scene.runs[0], by.scene.robot.model
    grid = by.scene.grids[0]
    heavier = torques(with_link(model, 0, 1.05, np.zeros(3)), grid.q, grid.v, grid.a)
    more = at_rows(run, grid, heavier - torques(model, grid.q, grid.v, grid.a))
    changed = change(by, (run,), (replace(run, tau=run.tau + more),))
    assert gap(by, changed) > 5.0
    assert beyond_tolerance(by, changed) < 0.03 * gap(by, changed)  # the filters' swing at both ends


def test_an_effect_is_made_as_large_as_asked_for():
    by = rod_ruler()
    found = sized(by, laws.coulomb(by.scene, 0, np.random.default_rng(0)), 7.0)
    assert found.gap == pytest.approx(7.0, rel=0.1)


def test_a_payload_on_a_pendulum_cannot_be_separated_from_the_inertias_of_its_link():
    by = rod_ruler()
    found = sized(by, laws.payload(by.scene, 0, np.random.default_rng(0)), 20.0)
    assert {"effect": "inertial_parameters", "joint": "pin"} in alike(by, found)


def test_friction_has_no_twin_on_a_pendulum():
    by = rod_ruler()
    found = sized(by, laws.coulomb(by.scene, 0, np.random.default_rng(0)), 20.0)
    assert alike(by, found) == []


def long_source():
    t = np.arange(0.0, 24.0, 0.01)
    return Source("long", ("pin",), ROD, "", (Run(t, t[:, None], t[:, None]),))


@pytest.mark.parametrize("which", range(6))
def test_the_parts_of_a_recording_share_no_sample(which):
    one, two = parts(long_source(), which)
    first, second = (set(np.concatenate([run.q[:, 0] for run in part])) for part in (one, two))
    assert not first & second
    assert len(first | second) == 2400


def test_logs_are_written_without_their_ends():
    """Ten samples of 0.1 s, without 0.25 s at both ends: 0.3 to 0.6 s, from zero on."""
    t = np.arange(10) * 0.1
    (run,) = trimmed((Run(t, t[:, None], t[:, None]),), 0.25)
    np.testing.assert_allclose(run.q[:, 0], [0.3, 0.4, 0.5, 0.6])
    np.testing.assert_allclose(run.t, [0.0, 0.1, 0.2, 0.3], atol=1e-12)


def test_every_other_number_exchanges_the_parts():
    (a, b), (c, d) = parts(long_source(), 2), parts(long_source(), 3)
    np.testing.assert_array_equal(a[0].q, d[0].q)
    np.testing.assert_array_equal(b[0].q, c[0].q)


def said(verdict, *findings):
    """A diagnosis with findings as pairs of effect and joint."""
    entries = [
        {"effect": e, "joint": j, "rivals": [], "probability": 1.0, "gap_closed": 0.9, "parameters": {}}
        for e, j in findings
    ]
    joint = {
        "joint": "pin",
        "rms_before": 2.0,
        "rms_within_tolerance": 2.0,
        "rms_after": 0.5,
        "noise_floor": 0.1,
    }
    unexplained = {"structured": False}
    return {"verdict": verdict, "findings": entries, "joints": [joint], "unexplained": unexplained}


def answer_with(null, **more):
    truth = [{"effect": "base_tilt", "joint": None, "parameters": {}, "gap_in_floors": 5.0}]
    context = context_of(null, said("explained"))
    return {
        "id": "x",
        "kind": "single",
        "robot": "real_x",
        "joints": ["pin"],
        "effects": truth,
        "outside": None,
        "paired_gap": 5.0,
        "noise_floor": [0.5],
        "context": context,
        **more,
    }


def test_a_coupling_stands_at_both_of_its_joints():
    assert places("joint_coupling", "a+b") == {("friction", "a"), ("friction", "b")}


def test_what_was_named_before_is_no_finding_of_the_effect():
    answer = answer_with(said("unknown", ("coulomb_friction", "pin")))
    left = without_context(answer, said("unknown", ("presliding_friction", "pin"), ("base_tilt", None)))
    assert [f["effect"] for f in left["findings"]] == ["base_tilt"]


def test_unknown_counts_if_nothing_new_is_found_or_it_was_not_unknown_before():
    before, new = said("unknown"), ("base_tilt", None)
    assert without_context(answer_with(before), said("unknown", new))["verdict"] == "partly_explained"
    assert without_context(answer_with(before), said("unknown"))["verdict"] == "unknown"
    assert without_context(answer_with(said("no_gap")), said("unknown", new))["verdict"] == "unknown"


def test_the_gap_that_is_closed_ends_at_what_was_left_before():
    answer = answer_with(said("no_gap"))
    entry = {"diagnosis": said("explained", ("base_tilt", None)), "seconds": 1.0}
    assert judged(answer, entry_without_context(answer, entry)).gap_closed == pytest.approx(1.0)


def test_a_null_is_judged_with_all_that_is_claimed():
    null = said("unknown", ("coulomb_friction", "pin"))
    answer = answer_with(null, kind="null", effects=[], truth=[], paired_gap=0.0)
    entry = entry_without_context(answer, {"diagnosis": null, "seconds": 1.0})
    assert judged(answer, entry).false_claim


def test_a_log_is_written_to_the_precision_of_its_recording():
    run = Run(np.array([0.0, 0.002]), np.array([[1.0 / 3.0], [2.0]]), np.array([[1e-7], [300.123456789]]))
    lines = log_text(run, ("pin",)).splitlines()
    assert lines[0] == "t,q.pin,tau.pin"
    np.testing.assert_allclose([float(x) for x in lines[1].split(",")], [0.0, 1.0 / 3.0, 1e-7], rtol=1e-11)


@pytest.fixture
def sentence(monkeypatch, data_folder):
    """Part one without its diagnosis: a band of 10 Hz, a floor of 1 at every joint, nothing found."""

    def diagnosis(source):
        left = {"rms_within_tolerance": 1.0, "rms_after": 1.0, "noise_floor": 1.0}
        joints = [{"joint": x, **left} for x in source.joints]
        said = {"verdict": "no_gap", "findings": [], "joints": joints, "band_hz": [0.0, 10.0]}
        return {**said, "unexplained": {"structured": False}}

    model = "schema: phantom-dyn-model/1\n"
    monkeypatch.setenv("PHANTOM_DYN_DATA", str(data_folder))
    monkeypatch.setattr(real_case, "corrected_by", lambda source, one: PartOne(model, "", diagnosis(source)))
    monkeypatch.setattr(real_case, "null_diagnosis", lambda source, first, two: diagnosis(source))
    real_case.part.cache_clear()
    yield
    real_case.part.cache_clear()


def test_a_null_holds_the_recording_as_it_is(sentence, tmp_path):
    case = real_case.draw_case(0, "null")
    folder = real_case.write_case(case, tmp_path)
    _, two = parts(SOURCES[0](), 0)
    rows = np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1)
    (run,) = trimmed(two, 0.1)  # two periods of twice the band
    np.testing.assert_allclose(rows[:, 2], run.tau[:, 0], rtol=1e-10)
    assert sorted(path.name for path in folder.iterdir()) == ["corrected.yaml", "log.csv", "robot.urdf", "robot.yaml"]


def test_a_single_differs_from_the_recording_by_the_effect_of_its_answer(sentence):
    case = real_case.draw_case(0, "single")
    (truth,) = case.answer["effects"]
    _, two = parts(SOURCES[0](), 0)
    assert truth["effect"] == "viscous_friction"
    (run,) = trimmed(two, 0.1)
    v = np.gradient(run.q[:, 0], 0.001)
    slope = np.polyfit(v, (case.runs[0].tau - run.tau)[:, 0], 1)[0]
    assert slope == pytest.approx(truth["parameters"]["coefficient"], rel=0.05)


def test_the_same_seed_gives_the_same_case(sentence):
    first, second = (real_case.draw_case(6, "single") for _ in range(2))
    assert json.dumps(first.answer) == json.dumps(second.answer)
    np.testing.assert_array_equal(first.runs[0].tau, second.runs[0].tau)


def test_the_diagnosing_process_gets_all_logs_and_the_corrected_model(tmp_path):
    """A program in the place of the diagnosis writes down how it was called."""
    case = tmp_path / "case"
    case.mkdir()
    for name in ("robot.urdf", "robot.yaml", "corrected.yaml", "log_01.csv", "log_02.csv", "answer.json"):
        (case / name).write_text("{}")
    spy = tmp_path / "spy.py"
    spy.write_text(
        "import json, os, sys\n"
        "json.dump({'words': sys.argv[1:], 'files': sorted(os.listdir())}, open('diagnosis.json', 'w'))\n"
    )
    assert robot_and_log(case) == ("robot.urdf", "log_01.csv")
    entry = json.loads(run_case([sys.executable, str(spy)], case, tmp_path).read_text())
    words = ["robot.urdf", "log_01.csv", "log_02.csv", "--with", "corrected.yaml", "--json", "diagnosis.json"]
    assert entry["diagnosis"]["words"] == words
    assert entry["diagnosis"]["files"] == ["corrected.yaml", "log_01.csv", "log_02.csv", "robot.urdf", "robot.yaml"]
