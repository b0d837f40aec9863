"""A measurement in a process of its own does not end for want of the benchmark's modules."""

from benchmark.processes import told_by


def test_a_process_of_its_own_finds_the_benchmark_though_no_variable_says_where(monkeypatch):
    monkeypatch.delenv("PYTHONPATH", raising=False)
    assert told_by("from benchmark.metric import Metric; print(Metric.__name__)") == "Metric\n"
