"""Who sends on one topic: one, several that take turns, or one that another has replaced."""

from __future__ import annotations

import math
from typing import Dict, List, Optional

HOW_TO_GO_ON = "if it was taken away for good, start this node again"
"""What to say of one of several that has fallen silent: nothing tells whether it died or was removed."""
AT_ONCE = 2.0
"""Seconds within which who sends at the same time as others is heard again; what is slower is too old to drive by."""


class Senders:
    """Tells apart, by their names, who sends what comes in one stream.

    Who is soon heard again after another one is one of several that send at the same time, and is missed where it falls
    silent. Who is not was replaced: a driver that was started again with another frame is no second lidar, and a spare
    one that stands in for another takes no turns with it.
    """

    def __init__(self) -> None:
        self._takes_turns: Dict[str, bool] = {}
        self._heard_at: Dict[str, float] = {}
        self._newest: Optional[str] = None

    def hear(self, name: str, now: float) -> bool:
        """Take note that one of them has sent something at `now` (s); return whether it took turns with another one."""
        returns = name != self._newest and abs(now - self._heard_at.get(name, math.inf)) <= AT_ONCE
        self._takes_turns[name] = returns or self._takes_turns.get(name, False)
        self._newest, self._heard_at[name] = name, now
        return returns

    @property
    def present(self) -> List[str]:
        """Those who send: all that take turns, and who was heard last."""
        return [name for name, takes_turns in self._takes_turns.items() if takes_turns or name == self._newest]
