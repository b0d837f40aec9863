"""A lease on a goal: it ends where its client does not renew it any more.

actionlib's server drives a goal to its end though nobody is left who wants it. A client that was killed, stopped, hangs
or sits behind a cut cable has one thing in common: it renews nothing. So a client that is to answer for its goals, as
the relay is, sends them under ids that end in `MARK` and renews each, on the topic `lease` beside the action's others,
from the loop that does its work, for as long as it wants the goal driven: a cancelled goal is not renewed, so that even
a cancel that gets lost takes effect. The mark travels with the goal, which therefore has its lease from the first
moment. A server that knows nothing of leases offers no such topic, and gets goals without the mark.
"""

MARK = "+lease"
"""The end of a leased goal's id."""
DURATION = 0.5
"""Wall time (s) without a renewal after which a goal is overdue; one that still is at the next look ends.

With a look every 0.1 s, and the way to the wheels, within 1 s.
"""


def is_leased(goal_id: str) -> bool:
    """Return whether a goal with this id ends where it is not renewed."""
    return goal_id.endswith(MARK)
