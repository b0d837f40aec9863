"""The benchmarks of whole drives, on made-up results: what they say and when they cannot say anything."""

import importlib
import inspect

import pytest

pytest.importorskip("pybullet")

from benchmark import NAMES, circle, command, control, public_data  # noqa: E402
from benchmark.metric import Metric, NotMeasurable  # noqa: E402

from mbf_relay.lockstep.result import EpisodeResult  # noqa: E402


def driven(seed, success=True, **values):
    outcome = "SUCCEEDED" if success else "CONTACT"
    machine = {"wall": 2.0, "stages": {"simulation": 1.0, "control": 0.5}, "memory_mib": 200.0}
    return EpisodeResult(
        "circle", seed, success, outcome, contacts=int(not success), time=60.0 + seed, machine=machine, **values
    )


@pytest.mark.parametrize("name", NAMES)
def test_every_benchmark_yields_metrics_when_asked(name):
    metrics = importlib.import_module(f"benchmark.{name}").metrics
    assert list(inspect.signature(metrics).parameters) == ["quick"]


def test_the_benchmark_of_controllers_drives_by_a_costmap_that_looks_for_what_moves(recwarn):
    """It printed a warning of foresight, as if the controllers measured were not those that are driven by."""
    list(control._drive("DWAPlannerROS", "straight", control._line((0.0, 0.0), (0.3, 0.0))))
    control._cycle(2, 4, 0.2, 0.0, "MPPI")[0]()
    assert not [each for each in recwarn if "foresight" in str(each.message)]


def test_failures_count_and_do_not_enter_the_times():
    results = [
        driven(1, goal_waits=(0.1, 0.3)),
        driven(2, success=False, goal_waits=(9.0,)),
        driven(3, goal_waits=(0.2,)),
    ]
    metrics = {metric.name: metric for metric in circle.driving(results)}
    assert metrics["circles with all goals reached and no contact"].value == 2
    assert metrics["contacts"].value == 1
    assert metrics["time"].value == 62.0 and metrics["time"].repeats == 2
    waits = metrics["within a goal's tolerance before reached"]
    assert waits.value == pytest.approx(0.2) and waits.repeats == 3


def test_of_drives_that_reached_no_goal_no_waiting_is_told():
    names = [metric.name for metric in circle.driving([driven(1, success=False)])]
    assert "time" in names and "within a goal's tolerance before reached" not in names


def test_shares_of_time_add_up(monkeypatch):
    class Driven:
        def __init__(self, *arguments, **keywords):
            pass

        def run(self):
            return driven(1)

    monkeypatch.setattr(circle, "Episode", Driven)
    metrics = list(circle.speed(circle.make_setup(circle.config_folder()), 3))
    shares = [metric.value for metric in metrics if metric.name.startswith("share of time")]
    assert sum(shares) == pytest.approx(100.0)
    assert metrics[0] == Metric("real-time factor on one core", 30.5, "", 30.5, 30.5, 3, metrics[0].parameters)


def test_worlds_need_the_sample_and_its_absence_is_no_failure(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("MBF_RELAY_SHARED", str(tmp_path))
    monkeypatch.setattr(public_data, "__file__", str(tmp_path / "test" / "benchmark" / "public_data.py"))
    with pytest.raises(NotMeasurable, match="set MBF_RELAY_SHARED"):
        public_data.public_data("barn_sample.json")
    assert command.run(["worlds"], quick=True, take_one=command.take) == ([], [])
    assert "benchmark worlds is left out: barn_sample.json was not found" in capsys.readouterr().err


def test_the_sample_is_found_where_the_variable_says(monkeypatch, tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "barn_sample.json").write_text("{}")
    monkeypatch.setenv("MBF_RELAY_SHARED", str(tmp_path))
    assert public_data.public_data("barn_sample.json") == tmp_path / "data" / "barn_sample.json"


def test_a_broken_benchmark_does_not_cost_the_others(monkeypatch, capsys):
    class Broken:
        @staticmethod
        def metrics(quick):
            yield Metric("first", 1.0)
            raise RuntimeError("a benchmark's mistake")

    monkeypatch.setattr(command.importlib, "import_module", lambda name: Broken)
    results, failed = command.run(["relay", "circle"], quick=False, take_one=command.take)
    assert [name for name, _ in results] == failed == ["relay", "circle"]
    assert "a benchmark's mistake" in capsys.readouterr().err
