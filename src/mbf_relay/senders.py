"""Tracking of the publishers of one topic, e.g. several lidars on one: present ones, replaced ones, and guests."""

from __future__ import annotations

import math
from typing import Dict, List, Optional

HOW_TO_GO_ON = "if it was taken away for good, start this node again"
"""Advice where one of several senders is silent: it cannot be known whether it failed or was removed."""
AT_ONCE = 2.0
"""Time (s) within which a sender must be heard again to count as sending at the same time as others."""


class Senders:
    """Tracks by name which senders of one stream must be heard.

    A sender heard again within AT_ONCE, with another one in between, sends at the same time as others, and its silence
    is a failure. A sender not heard again was replaced by the next one, as by a driver restarted with another frame or
    by a spare lidar. A guest counts while it sends; its silence is no failure unless it is the only sender.
    """

    def __init__(self) -> None:
        self._takes_turns: Dict[str, bool] = {}
        self._heard_at: Dict[str, float] = {}
        self._newest: Optional[str] = None
        self._guest: Optional[str] = None
        self._now = 0.0

    def hear(self, name: str, now: float, is_guest: bool = False) -> None:
        """Record that a sender was heard at `now` (s)."""
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
        """Senders whose silence is a failure: those that send at the same time and the last one; else the guest."""
        found = [name for name, takes_turns in self._takes_turns.items() if takes_turns or name == self._newest]
        return found or [name for name in (self._guest,) if name is not None]

    @property
    def heard(self) -> List[str]:
        """Senders whose data are used: those present, and guests heard within AT_ONCE."""
        present = self.present
        return present + [
            name for name, heard_at in self._heard_at.items()
            if name not in self._takes_turns and name not in present and abs(self._now - heard_at) <= AT_ONCE]
