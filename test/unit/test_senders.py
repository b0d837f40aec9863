"""Who sends on one topic."""

import pytest

from mbf_relay.senders import Senders


@pytest.mark.parametrize("heard, present", [
    ("", ""), ("aaa", "a"), ("ab", "b"),
    ("aabbb", "b"),  # replaced
    ("aba", "a"), ("abab", "ab"), ("ababbbbb", "ab"),  # takes turns, or did and is missed
    ("abc", "c"), ("abcabc", "abc"), ("ababccc", "abc"),
])
def test_who_comes_back_after_another_is_one_of_several_and_who_does_not_was_replaced(heard, present):
    senders = Senders()
    for name in heard:
        senders.hear(name)
    assert senders.present == list(present)
