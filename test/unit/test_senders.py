"""Who sends on one topic."""

import itertools

import pytest

from mbf_relay.senders import AT_ONCE, Senders


@pytest.mark.parametrize("heard, present", [
    ("", ""), ("aaa", "a"), ("ab", "b"),
    ("aabbb", "b"),  # replaced
    ("aba", "a"), ("abab", "ab"), ("ababbbbb", "ab"),  # takes turns, or did and is missed
    ("abc", "c"), ("abcabc", "abc"), ("ababccc", "abc"),
])
def test_who_comes_back_after_another_is_one_of_several_and_who_does_not_was_replaced(heard, present):
    senders = Senders()
    for now, name in enumerate(heard):
        senders.hear(name, 1000.0 + 0.1 * now)
    assert senders.present == list(present)


@pytest.mark.parametrize("swaps", [1, 2, 3, 6])
@pytest.mark.parametrize("overlap", [0.0, 0.1])
def test_a_spare_lidar_that_stands_in_again_and_again_leaves_no_robot_waiting_for_the_other(swaps, overlap):
    senders, now = Senders(), 0.0
    for name in itertools.islice(itertools.cycle("ab"), swaps + 1):
        for _ in range(100):
            now += 0.1
            senders.hear(name, now)
        now -= overlap  # the one that goes and the one that comes may send at the same moment
    assert senders.present == [name]


def test_a_pair_is_one_of_two_whatever_the_rates_and_misses_the_one_that_falls_silent():
    senders = Senders()
    for tick in range(400):
        senders.hear("fast", 0.025 * tick)
        if tick % 40 == 0 and tick < 200:
            senders.hear("slow", 0.025 * tick)
    assert senders.present == ["fast", "slow"] and AT_ONCE > 1.0


def test_a_clock_that_is_set_changes_neither_who_is_one_of_two_nor_who_was_replaced():
    senders = Senders()
    for now, name in ((0.0, "a"), (0.1, "b"), (0.2, "a"), (0.3, "b"), (100.0, "c"), (3.0, "a"), (3.1, "b")):
        senders.hear(name, now)
    assert senders.present == ["a", "b"]


@pytest.mark.parametrize("heard, present, counted", [
    ("A", "A", "A"), ("AB", "B", "BA"), ("aA", "a", "aA"), ("aAaA", "a", "aA"), ("Aa", "a", "aA"),
    ("aAbA", "b", "bA"),  # replaced while a guest sends
    ("aAbaAb", "ab", "abA"),
])
def test_a_guest_is_heard_and_is_missed_only_where_there_is_nobody_else(heard, present, counted):
    """Capital letters are guests."""
    senders = Senders()
    for now, name in enumerate(heard):
        senders.hear(name, 1000.0 + 0.1 * now, is_guest=name.isupper())
    assert senders.present == list(present) and senders.heard == list(counted)


def test_a_guest_that_is_gone_is_heard_no_longer_and_replaces_nobody():
    senders = Senders()
    for tick in range(50):
        senders.hear("own", 0.1 * tick)
        if tick < 10:
            senders.hear("guest", 0.1 * tick, is_guest=True)
    assert senders.heard == ["own"]
    for tick in range(50, 100):
        senders.hear("guest", 0.1 * tick, is_guest=True)
    assert senders.present == ["own"], "who fell silent is missed"


def test_a_guest_of_before_time_was_set_back_is_heard_no_longer():
    senders = Senders()
    for name, now in (("own", 100.0), ("guest", 100.1), ("own", 1.0)):
        senders.hear(name, now, is_guest=name == "guest")
    assert senders.heard == ["own"]


def test_who_turns_out_to_be_a_guest_is_missed_no_longer():
    senders = Senders()
    for now, name in enumerate("abab"):
        senders.hear(name, 0.1 * now)
    senders.hear("b", 0.5, is_guest=True)
    assert senders.present == ["a"] and senders.heard == ["a", "b"]
