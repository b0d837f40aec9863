"""Leases on goals, an extension of actionlib's protocol: a goal is cancelled when its client stops renewing it.

actionlib's server pursues a goal to its end even when its client was killed, hangs or is cut off. A client with leases,
as the relay is, gives its goals ids that end in `MARK` and renews each on the topic `lease` beside the action's others.
It does so from its main loop, so that renewals stop when that hangs. A cancelled goal is no longer renewed, so that
even a cancel that gets lost takes effect. Since the mark is part of the id, a goal is leased from the start. A server
without leases does not subscribe to `lease`, and gets goals without the mark.
"""

MARK = "+lease"
"""The end of a leased goal's id."""
DURATION = 0.5
"""Wall time (s) without a renewal after which a goal is overdue; where it is at two checks in a row, it is cancelled.

With a check every 0.1 s the robot stops within 1 s.
"""


def is_leased(goal_id: str) -> bool:
    """Return whether a goal with this id is leased."""
    return goal_id.endswith(MARK)
