"""The table of proofs: what was tried is counted, what was lost is not hidden, in trials and beside them."""

import sys

import pytest

pytest.importorskip("psutil")

import tally  # noqa: E402
from benchmark import reliability  # noqa: E402
from benchmark.reliability import PROOFS, Proof  # noqa: E402

TESTS = """
import pytest
from tally import how_many, trial

def test_trials():
    for index in range(how_many(3, 5)):
        with trial("robots sent out") as made:
            made.measure("drove on for", 10.0 * index, "ms")
            assert index != {lost}

@trial("robots called back")
def test_one():
    pass

def test_beside():
    assert not {beside}
"""

SKIPPED = """
import unittest
from tally import trial

@trial("robots sent out")
def test_skipped():
    raise unittest.SkipTest("there is no robot")
"""


@pytest.fixture
def tell(tmp_path):
    def run(quick=True, **values):
        path = tmp_path / "test_some.py"
        path.write_text(TESTS.format(**{"lost": None, "beside": False, **values}), encoding="utf-8")
        told = reliability.told_before(str(tmp_path / "pieces"))
        metrics = reliability.count(Proof("all of it", str(path)), str(tmp_path / "results"), quick, told)
        return {metric.name: metric for metric in metrics}

    return run


def test_what_was_tried_and_what_was_measured_is_told(tell):
    metrics = tell()
    sent = metrics["robots sent out, lost"]
    assert (sent.value, sent.repeats, sent.parameters) == (0.0, 3, {"trials": 3})
    assert metrics["robots called back, lost"].repeats == 1
    assert metrics["robots sent out: drove on for"].value == 10.0
    assert metrics["robots sent out: drove on for, longest"].value == 20.0
    assert "all of it, lost" not in metrics


def test_the_whole_proof_tries_as_often_as_its_claim_asks_for(tell):
    assert tell(quick=False)["robots sent out, lost"].repeats == 5


def test_what_was_run_in_pieces_before_counts_with_it(tell, tmp_path, monkeypatch):
    for piece in ("one", "two"):
        (tmp_path / "pieces" / piece).mkdir(parents=True)
        monkeypatch.setenv("MBF_RELAY_TEST_RESULTS", str(tmp_path / "pieces" / piece))
        with tally.trial("robots sent out") as made:
            made.measure("drove on for", 99.0, "ms")
    monkeypatch.delenv("MBF_RELAY_TEST_RESULTS")
    metrics = tell()
    assert metrics["robots sent out, lost"].repeats == 5
    assert metrics["robots sent out: drove on for, longest"].value == 99.0


def test_what_was_run_in_pieces_can_be_counted_alone(tmp_path, monkeypatch):
    (tmp_path / "piece").mkdir()
    monkeypatch.setenv("MBF_RELAY_TEST_RESULTS", str(tmp_path / "piece"))
    with tally.trial("robots sent out"):
        pass
    monkeypatch.setenv("MBF_RELAY_TOLD", str(tmp_path))
    monkeypatch.setenv("MBF_RELAY_SHARE", "0")
    monkeypatch.setattr(reliability.shutil, "which", lambda name: name)
    assert [(metric.name, metric.repeats) for metric in reliability.metrics(quick=False)] == [
        ("robots sent out, lost", 1)]


def test_a_lost_trial_is_told_once(tell):
    metrics = tell(lost=1)
    lost = metrics["robots sent out, lost"]
    assert (lost.value, lost.repeats) == (1.0, 2)
    assert "all of it, lost" not in metrics


def test_a_test_that_fails_beside_the_trials_is_not_hidden(tell):
    assert tell(beside=True)["all of it, lost"].value == 1.0


def test_a_proof_that_does_not_come_to_tell_of_trials_is_lost(tell):
    assert tell(beside="1 / 0 or (")["all of it, lost"].value == 1.0


def test_a_trial_that_is_broken_off_is_neither_won_nor_lost(tmp_path, monkeypatch):
    monkeypatch.setenv("MBF_RELAY_TEST_RESULTS", str(tmp_path))
    for error in (KeyboardInterrupt, ValueError):
        with pytest.raises(error), tally.trial("robots sent out"):
            raise error
    assert tally.read_trials(tmp_path) == [tally.Trial("robots sent out", True, [])]


def test_what_is_skipped_is_neither_won_nor_lost(tell, monkeypatch):
    """Where no control group can be made, a machine of a tenth of a core was told to have lost its circle."""
    monkeypatch.setattr(sys.modules[__name__], "TESTS", SKIPPED)
    assert tell() == {}


def test_every_proof_is_there():
    for proof in PROOFS:
        assert (reliability.HERE / proof.where).is_file(), proof.where
