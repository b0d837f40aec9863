"""Figures: medians, tables, JSON and the README's section."""

import json

import pytest

from mbf_relay.benchmarks import command, figure, readme
from mbf_relay.benchmarks.figure import Figure


def test_value_is_the_median_and_p95_the_percentile():
    taken = figure.figure_of("plan", [1.0, 2.0, 3.0, 4.0, 100.0], "ms", cells=9)
    assert taken.value == taken.median == 3.0
    assert taken.p95 == pytest.approx(80.8)
    assert (taken.repeats, taken.parameters) == (5, {"cells": 9})


def test_single_sample_has_no_spread():
    assert figure.figure_of("plan", [7.0], "ms").p95 is None


def test_time_call_calls_as_often_as_told():
    calls = []
    taken = figure.time_call("call", lambda: calls.append(1), repeats=5, warm_up=2)
    assert len(calls) == 7
    assert taken.repeats == 5 and taken.value >= 0.0


def test_no_repeats_is_an_error():
    with pytest.raises(ValueError, match="taken 0 times"):
        Figure("plan", 1.0, repeats=0)


@pytest.mark.parametrize(
    "value, text", [(None, "-"), (float("nan"), "-"), (0.0, "0"), (0.01234, "0.0123"), (1.5, "1.50"), (123.4, "123"), (98765.4, "98765"), (3, "3")]
)
def test_numbers_for_people(value, text):
    assert figure.round_for_people(value) == text


def test_table_has_one_row_per_figure_and_equal_widths():
    lines = figure.table([Figure("a", 1.5, "ms"), Figure("longer", 2.0)]).splitlines()
    assert len(lines) == 4
    assert len({len(line) for line in lines}) == 1


def test_json_carries_every_field():
    text = command.as_json({"cores": 2}, [("planning", Figure("a", 1.5, "ms", parameters={"n": 1}))])
    parsed = json.loads(text)
    assert parsed["machine"] == {"cores": 2}
    assert parsed["figures"] == [
        {"benchmark": "planning", "name": "a", "value": 1.5, "unit": "ms", "median": 1.5, "p95": None, "repeats": 1,
         "parameters": {"n": 1}}
    ]


SECTION = f"top\n{readme.MARKER_BEGIN}\nold\n{readme.MARKER_END}\nbottom\n"


def test_readme_section_is_replaced_and_the_rest_kept():
    made = readme.rewrite_section(SECTION, figure.describe_machine(), [])
    assert made.startswith("top\n") and made.endswith("\nbottom\n") and "old" not in made
    with pytest.raises(ValueError, match="no section"):
        readme.rewrite_section("nothing", figure.describe_machine(), [])


def test_headlines_come_first_and_the_rest_is_folded():
    relay = [
        Figure("goal through the relay", 0.7071, "ms"), Figure("cancel through the relay", 0.2, "ms"),
        Figure("idle relay, share of one core", 0.4, "%"), Figure("something else", 3.0),
    ]
    made = readme.rewrite_section(SECTION, figure.describe_machine(), [("relay", each) for each in relay])
    short, folded = made.split("<details>")
    assert "| goal handed on by the relay | 0.707 ms |" in short and "something else" not in short
    assert "something else" in folded and folded.rstrip().endswith("bottom")


@pytest.mark.parametrize("figures", [[], ["one cycle of DWA", "one cycle of DWA"]])
def test_a_headline_without_its_one_figure_is_named(figures):
    results = [("control", Figure(name, 1.0, "ms", parameters={"sampled": "20 x 40", "turn": 0.0})) for name in figures]
    with pytest.raises(ValueError, match=f"{len(figures)} figures of control are 'one cycle of DWA'"):
        readme.headline_table([*results, ("control", Figure("another", 1.0))])


def test_a_count_says_out_of_how_many():
    parameters = {"controller": "DWAPlannerROS", "worlds": 18}
    figures = [("worlds", Figure(name, 16.0, parameters=parameters)) for name in ("worlds driven to the goal", "contacts")]
    assert "driven through | 16 of 18 |" in readme.headline_table(figures)


def test_unknown_benchmark_names_the_nearest(capsys):
    with pytest.raises(SystemExit):
        command.main(["plannning"])
    assert "did you mean 'planning'" in capsys.readouterr().err


def test_figures_taken_one_after_the_other_make_one_table(tmp_path, capsys):
    for name, benchmark in (("late", "worlds"), ("early", "planning")):
        text = command.as_json({"cores": 2}, [(benchmark, Figure(name, 1.5, "ms", parameters={"n": 1}))])
        (tmp_path / f"{name}.json").write_text(text, encoding="utf-8")
    machine, results = command.read_taken([str(tmp_path / "late.json"), str(tmp_path / "early.json")])
    assert machine == {"cores": 2}
    assert [(benchmark, taken.name) for benchmark, taken in results] == [("planning", "early"), ("worlds", "late")]


def test_figures_of_two_machines_are_not_mixed(tmp_path):
    for cores in (2, 4):
        text = command.as_json({"cores": cores}, [("planning", Figure("a", 1.0))])
        (tmp_path / f"{cores}.json").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match="another machine"):
        command.read_taken([str(tmp_path / "2.json"), str(tmp_path / "4.json")])


def test_a_file_without_figures_is_named(tmp_path):
    (tmp_path / "odd.json").write_text("{}", encoding="utf-8")
    with pytest.raises(SystemExit, match="odd.json"):
        command.main(["--taken", str(tmp_path / "odd.json")])
