"""Which known name somebody meant who wrote one that is not known."""

from __future__ import annotations

from typing import Iterable, Optional

WORDS_ALIKE = 0.6
"""Share of letters (difflib's ratio) two words must have in common to be one word misspelt."""
NAMES_ALIKE = 0.75
"""The same of two names of unlike numbers of words, such as footprint and robot_footprint."""


def nearest_of(name: str, known: Iterable[str]) -> Optional[str]:
    """Return the known name that `name` is most likely a slip for, None where none is.

    Names are words joined by underscores; where as many stand in both, each must look like its counterpart, or
    max_vel_rot would be taken for max_vel_y; else the whole must look much alike.
    """
    import difflib  # for the few files that have a slip

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
