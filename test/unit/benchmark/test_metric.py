"""Metrics: medians, tables, JSON and the README's section."""

import json

import pytest
from benchmark import command, metric, report
from benchmark.metric import Metric


def test_value_is_the_median_and_p95_the_percentile():
    taken = metric.metric_of("plan", [1.0, 2.0, 3.0, 4.0, 100.0], "ms", cells=9)
    assert taken.value == taken.median == 3.0
    assert taken.p95 == pytest.approx(80.8)
    assert (taken.repeats, taken.parameters) == (5, {"cells": 9})


def test_single_sample_has_no_spread():
    assert metric.metric_of("plan", [7.0], "ms").p95 is None


def test_time_call_calls_as_often_as_told():
    calls = []
    taken = metric.time_call("call", lambda: calls.append(1), repeats=5, warm_up=2)
    assert len(calls) == 7
    assert taken.repeats == 5 and taken.value >= 0.0


def test_no_repeats_is_an_error():
    with pytest.raises(ValueError, match="taken 0 times"):
        Metric("plan", 1.0, repeats=0)


@pytest.mark.parametrize(
    "value, text",
    [
        (None, "-"),
        (float("nan"), "-"),
        (0.0, "0"),
        (0.01234, "0.0123"),
        (1.5, "1.50"),
        (123.4, "123"),
        (98765.4, "98765"),
        (3, "3"),
    ],
)
def test_numbers_for_people(value, text):
    assert metric.round_for_people(value) == text


def test_table_has_one_row_per_metric_and_equal_widths():
    lines = metric.table([Metric("a", 1.5, "ms"), Metric("longer", 2.0)]).splitlines()
    assert len(lines) == 4
    assert len({len(line) for line in lines}) == 1


def test_json_carries_every_field():
    text = command.as_json({"cores": 2}, [("planning", Metric("a", 1.5, "ms", parameters={"n": 1}))])
    parsed = json.loads(text)
    assert parsed["machine"] == {"cores": 2}
    assert parsed["metrics"] == [
        {"benchmark": "planning", "name": "a", "value": 1.5, "unit": "ms", "median": 1.5, "p95": None, "repeats": 1,
         "parameters": {"n": 1}}
    ]


SECTION = f"top\n{report.FIGURES[0]}\nold\n{report.FIGURES[1]}\nbottom\n"


def test_a_section_is_replaced_and_the_rest_kept():
    assert report.rewrite_section(SECTION, report.FIGURES, "new") == SECTION.replace("old", "new")
    with pytest.raises(ValueError, match="no section"):
        report.rewrite_section("nothing", report.FIGURES, "new")


@pytest.mark.parametrize("markers", [report.FIGURES, report.PROOFS])
def test_both_readmes_have_the_section(markers):
    for readme in (report.HERE / "README.md", report.HERE.parents[1] / "README.md"):
        assert report.rewrite_section(readme.read_text(encoding="utf-8"), markers, "new")


@pytest.mark.parametrize("names", [("yardstick", "reliability"), ("yardstick", "relay"), ("relay", "reliability")])
def test_a_section_of_which_nothing_was_measured_stays_as_it_is(names, tmp_path, monkeypatch):
    here = tmp_path / "test" / "benchmark"
    here.mkdir(parents=True)
    monkeypatch.setattr(report, "HERE", here)
    for path in (tmp_path / "README.md", here / "README.md"):
        path.write_text(SECTION + SECTION.replace(report.FIGURES[0], report.PROOFS[0]).replace(
            report.FIGURES[1], report.PROOFS[1]).replace("old", "as old"), encoding="utf-8")
    made = {"reliability": [Metric("goals cancelled, lost", 1.0, repeats=5000)], "yardstick": [Metric("loop", 3.0)],
            "relay": [Metric(name, 1.0, "ms") for name in (
                "goal through the relay", "cancel through the relay", "idle relay, share of one core")]}
    machine = {"cores": 2, **dict.fromkeys(
        ("processor", "memory_gib", "system", "python", "numpy", "numba", "pybullet"), "")}
    report.write_sections(machine, [(name, metric) for name in names for metric in made[name]])
    for path in (tmp_path / "README.md", here / "README.md"):
        text = path.read_text(encoding="utf-8")
        assert ("\nold\n" in text) == ("relay" not in names)
        assert ("\nas old\n" in text) == ("reliability" not in names)
    if "reliability" in names:
        assert "| goals cancelled | 5000 | 1 |" in (tmp_path / "README.md").read_text(encoding="utf-8")


def test_few_trials_are_told_in_short_only_where_one_was_lost():
    made = [Metric("master killed, lost", lost, repeats=4) for lost in (0.0, 1.0)]
    assert [report.proof_table([("reliability", metric)]).count("master") for metric in made] == [0, 1]


def test_a_robot_has_a_row_with_a_cell_for_each_thing_told_of_it():
    told = {"wheels": "car", "loads": "yes", "ignored": 2}
    table = report.robot_table([("zoo", Metric("limo", 20.04, "s", parameters=told))])
    assert table.splitlines() == [
        "| robot | wheels | loads | ignored | time [s] |", "|---|---|---|---|---|", "| limo | car | yes | 2 | 20.0 |"]


def test_headlines_are_few_and_the_whole_table_has_all():
    relay = [
        Metric("goal through the relay", 0.7071, "ms"), Metric("cancel through the relay", 0.2, "ms"),
        Metric("idle relay, share of one core", 0.4, "%"), Metric("something else", 3.0),
    ]
    results = [("relay", each) for each in relay]
    short, whole = report.headline_table(results), report.whole_tables(results)
    assert "| goal handed on by the relay | 0.707 ms |" in short and "something else" not in short
    assert "something else" in whole and "goal through the relay" in whole


@pytest.mark.parametrize("metrics", [[], ["one cycle of DWA", "one cycle of DWA"]])
def test_a_headline_without_its_one_metric_is_named(metrics):
    results = [("control", Metric(name, 1.0, "ms", parameters={"sampled": "20 x 40", "turn": 0.0})) for name in metrics]
    with pytest.raises(ValueError, match=f"{len(metrics)} metrics of control are 'one cycle of DWA'"):
        report.headline_table([*results, ("control", Metric("another", 1.0))])


def test_a_count_says_out_of_how_many():
    parameters = {"controller": "DWAPlannerROS", "worlds": 18}
    metrics = [
        ("worlds", Metric(name, 16.0, parameters=parameters)) for name in ("worlds driven to the goal", "contacts")
    ]
    assert "driven through | 16 of 18 |" in report.headline_table(metrics)


def test_unknown_benchmark_names_the_nearest(capsys):
    with pytest.raises(SystemExit):
        command.main(["plannning"])
    assert "did you mean 'planning'" in capsys.readouterr().err


@pytest.mark.parametrize("names", [[], ["planning"], ["reliability", "control"]])
def test_who_asks_for_figures_of_a_first_look_in_the_readme_waits_for_nothing(names, capsys, monkeypatch):
    monkeypatch.setattr(command, "run", lambda names, quick: pytest.fail(f"{names} measured in vain"))
    with pytest.raises(SystemExit):
        command.main([*names, "--quick", "--write"])
    assert "leave out --quick or --write" in capsys.readouterr().err


@pytest.mark.parametrize("place", ["nowhere/figures.json", ""])
def test_who_asks_for_figures_where_none_can_be_written_waits_for_nothing(place, tmp_path, capsys, monkeypatch):
    """After half an hour of measuring came FileNotFoundError."""
    monkeypatch.setattr(command, "run", lambda names, quick: pytest.fail(f"{names} measured in vain"))
    with pytest.raises(SystemExit):
        command.main(["planning", "--json", str(tmp_path / place)])
    assert f"--json {tmp_path / place} cannot be written" in capsys.readouterr().err


def test_a_benchmark_that_failed_half_way_leaves_the_readme_as_it_was_and_is_named(capsys, monkeypatch):
    """A traceback about a headline came instead, and not which benchmark had failed."""
    monkeypatch.setattr(command, "run", lambda names, quick: ([("server", Metric("a plan", 1.0, "ms"))], ["server"]))
    monkeypatch.setattr(report, "rewrite_section", lambda *_: pytest.fail("written with figures missing"))
    assert command.main(["server", "--write"]) == 1
    said = capsys.readouterr().err
    assert "READMEs are left as they are: 0 metrics of server" in said and "benchmark server failed" in said


def test_the_short_form_of_the_proofs_may_stand_in_the_readme(monkeypatch):
    monkeypatch.setattr(command, "run", lambda names, quick: ([], []))
    monkeypatch.setattr(command, "write_sections", lambda machine, results: [])
    assert command.main(["reliability", "--quick", "--write"]) == 0


def test_metrics_taken_one_after_the_other_make_one_table(tmp_path, capsys):
    for name, benchmark in (("late", "worlds"), ("early", "planning")):
        text = command.as_json({"cores": 2}, [(benchmark, Metric(name, 1.5, "ms", parameters={"n": 1}))])
        (tmp_path / f"{name}.json").write_text(text, encoding="utf-8")
    machine, results = command.read_taken([str(tmp_path / "late.json"), str(tmp_path / "early.json")])
    assert machine == {"cores": 2}
    assert [(benchmark, taken.name) for benchmark, taken in results] == [("planning", "early"), ("worlds", "late")]


def test_metrics_of_two_machines_are_not_mixed(tmp_path):
    for cores in (2, 4):
        text = command.as_json({"cores": cores}, [("planning", Metric("a", 1.0))])
        (tmp_path / f"{cores}.json").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match="another machine"):
        command.read_taken([str(tmp_path / "2.json"), str(tmp_path / "4.json")])


def test_a_file_without_metrics_is_named(tmp_path):
    (tmp_path / "odd.json").write_text("{}", encoding="utf-8")
    with pytest.raises(SystemExit, match="odd.json"):
        command.main(["--taken", str(tmp_path / "odd.json")])
