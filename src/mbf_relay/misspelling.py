"""Suggestions for misspelt names."""

from __future__ import annotations

from typing import Iterable, Optional

WORDS_ALIKE = 0.6
"""Smallest similarity (difflib's ratio, 0 to 1) of two words of which one may be the other misspelt."""
NAMES_ALIKE = 0.75
"""The same for whole names with different numbers of words, such as footprint and robot_footprint."""


def nearest_of(name: str, known: Iterable[str]) -> Optional[str]:
    """Return the known name that `name` most likely misspells, None where there is none.

    Names are words joined by underscores. With equal numbers of words each must be similar to its counterpart, since
    max_vel_rot would otherwise be taken for max_vel_y; with different ones the whole names must be more similar.
    """
    import difflib  # slow to import, and rarely needed

    for match in difflib.get_close_matches(name, list(known), n=5):
        words, others = name.split("_"), match.split("_")
        pairs, least = zip(words, others), WORDS_ALIKE
        if len(words) != len(others):
            pairs, least = zip([name], [match]), NAMES_ALIKE
        if all(difflib.SequenceMatcher(None, *pair).ratio() >= least for pair in pairs):
            return match
    return None


def did_you_mean(nearest: Optional[str]) -> str:
    """Return the end of a message about an unknown name, given the nearest known one; empty where there is none."""
    return f"; did you mean '{nearest}'?" if nearest else ""
