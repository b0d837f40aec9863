"""Which code drives: plugins that are edited between two batches, with workers that stand by, and what they import."""

import pickle
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from odd_work import pace_of  # noqa: E402

from mbf_relay.lockstep.cluster import _sources  # noqa: E402
from mbf_relay.lockstep.driver import DONE, REFUSED, Driver, packed  # noqa: E402


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def asked(driver, call, argument, expected=None):
    kind, content = driver.run(packed(call, argument, expected), 60.0)
    assert kind == DONE, (kind, content)
    return pickle.loads(content)


def as_batch_sees_them(names):
    """Return the sources that a command started now would find."""
    command = Driver()
    try:
        return asked(command, _sources, names)
    finally:
        command.end()


@pytest.fixture
def worker():
    made = Driver()
    yield made
    made.end()


def test_a_worker_that_stands_by_drives_with_an_edited_plugin_as_it_is_now(folder, worker):
    (folder / "edited_plugin.py").write_text("PACE = 0.15\n")
    first = as_batch_sees_them(["edited_plugin.Mine"])
    assert asked(worker, pace_of, "edited_plugin", first) == 0.15
    (folder / "edited_plugin.py").write_text("PACE = 0.0725\n")
    second = as_batch_sees_them(["edited_plugin.Mine"])
    assert second.plugins != first.plugins
    assert asked(worker, _sources, ["edited_plugin.Mine"], second) == second, "it is asked before it gets work"
    assert asked(worker, pace_of, "edited_plugin", second) == 0.0725
    kind, text = worker.run(packed(pace_of, "edited_plugin", first), 60.0)
    assert kind == REFUSED and b"has another edited_plugin.Mine" in text, "what is gone is driven with by nobody"
