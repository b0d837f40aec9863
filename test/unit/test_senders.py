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
        senders.hear(name, 0.1 * now)
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
