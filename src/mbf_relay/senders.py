"""Who sends on one topic: one, several that take turns, one that another has replaced, or guests."""

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
    one that stands in for another takes no turns with it. A guest is heard while it sends, and never missed where there
    is somebody else.
    """

    def __init__(self) -> None:
        self._takes_turns: Dict[str, bool] = {}
        self._heard_at: Dict[str, float] = {}
        self._newest: Optional[str] = None
        self._guest: Optional[str] = None
        self._now = 0.0

    def hear(self, name: str, now: float, is_guest: bool = False) -> None:
        """Take note that one of them has sent something at `now` (s)."""
        returns = name != self._newest and abs(now - self._heard_at.get(name, math.inf)) <= AT_ONCE
        self._now = self._heard_at[name] = now
        if is_guest:
            self._guest = name
            self._takes_turns.pop(name, None)
        else:
            self._newest = name
            self._takes_turns[name] = returns or self._takes_turns.get(name, False)

    @property
    def present(self) -> List[str]:
        """Those who are missed where they fall silent: all that take turns, and who was heard last; a guest alone."""
        found = [name for name, takes_turns in self._takes_turns.items() if takes_turns or name == self._newest]
        return found or [name for name in (self._guest,) if name is not None]

    @property
    def heard(self) -> List[str]:
        """Those whose word counts: who is present, and the guests that still send."""
        present = self.present
        return present + [
            name for name, heard_at in self._heard_at.items()
            if name not in self._takes_turns and name not in present and abs(self._now - heard_at) <= AT_ONCE]
