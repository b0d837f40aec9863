"""The benchmarks of whole drives, on made-up results: what they say and when they cannot say anything."""

import importlib
import inspect

import pytest

pytest.importorskip("pybullet")

from mbf_relay.benchmarks import circle, command, public_data  # noqa: E402
from mbf_relay.benchmarks.figure import Figure, NotMeasurable  # noqa: E402
from mbf_relay.lockstep.result import EpisodeResult  # noqa: E402


def driven(seed, success=True, **values):
    outcome = "SUCCEEDED" if success else "CONTACT"
    machine = {"wall": 2.0, "stages": {"simulation": 1.0, "control": 0.5}, "memory_mib": 200.0}
    return EpisodeResult("circle", seed, success, outcome, contacts=int(not success), time=60.0 + seed, machine=machine, **values)


@pytest.mark.parametrize("name", command.available())
def test_every_benchmark_yields_figures_when_asked(name):
    figures = importlib.import_module(f"mbf_relay.benchmarks.{name}").figures
    assert list(inspect.signature(figures).parameters) == ["quick"]


def test_failures_count_and_do_not_enter_the_times():
    results = [driven(1, goal_waits=(0.1, 0.3)), driven(2, success=False, goal_waits=(9.0,)), driven(3, goal_waits=(0.2,))]
    figures = {figure.name: figure for figure in circle.driving(results)}
    assert figures["circles with all goals reached and no contact"].value == 2
    assert figures["contacts"].value == 1
    assert figures["time"].value == 62.0 and figures["time"].repeats == 2
    waits = figures["within a goal's tolerance before reached"]
    assert waits.value == pytest.approx(0.2) and waits.repeats == 3


def test_of_drives_that_reached_no_goal_no_waiting_is_told():
    names = [figure.name for figure in circle.driving([driven(1, success=False)])]
    assert "time" in names and "within a goal's tolerance before reached" not in names


def test_shares_of_time_add_up(monkeypatch):
    class Driven:
        def __init__(self, *arguments, **keywords):
            pass

        def run(self):
            return driven(1)

    monkeypatch.setattr(circle, "Episode", Driven)
    figures = list(circle.speed(circle.make_setup(circle.config_folder()), 3))
    shares = [figure.value for figure in figures if figure.name.startswith("share of time")]
    assert sum(shares) == pytest.approx(100.0)
    assert figures[0] == Figure("real-time factor on one core", 30.5, "", 30.5, 30.5, 3, figures[0].parameters)


def test_worlds_need_the_sample_and_its_absence_is_no_failure(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("MBF_RELAY_SHARED", str(tmp_path))
    monkeypatch.setattr(public_data, "__file__", str(tmp_path / "src" / "mbf_relay" / "benchmarks" / "public_data.py"))
    with pytest.raises(NotMeasurable, match="set MBF_RELAY_SHARED"):
        public_data.public_data("barn_sample.json")
    assert command.run(["worlds"], quick=True) == ([], [])
    assert "benchmark worlds is left out: barn_sample.json was not found" in capsys.readouterr().err


def test_the_sample_is_found_where_the_variable_says(monkeypatch, tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "barn_sample.json").write_text("{}")
    monkeypatch.setenv("MBF_RELAY_SHARED", str(tmp_path))
    assert public_data.public_data("barn_sample.json") == tmp_path / "data" / "barn_sample.json"


def test_a_broken_benchmark_does_not_cost_the_others(monkeypatch, capsys):
    class Broken:
        @staticmethod
        def figures(quick):
            yield Figure("first", 1.0)
            raise RuntimeError("a benchmark's mistake")

    monkeypatch.setattr(command.importlib, "import_module", lambda name: Broken)
    results, failed = command.run(["relay", "circle"], quick=False)
    assert [name for name, _ in results] == failed == ["relay", "circle"]
    assert "a benchmark's mistake" in capsys.readouterr().err
