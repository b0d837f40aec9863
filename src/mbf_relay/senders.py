"""Who sends on one topic: one, several that take turns, or one that another has replaced."""

from __future__ import annotations

from typing import Dict, List, Optional

HOW_TO_GO_ON = "if it was taken away for good, start this node again"
"""What to say of one of several that has fallen silent: nothing tells whether it died or was removed."""


class Senders:
    """Tells apart, by their names, who sends what comes in one stream.

    Who is heard again after another one is one of several that send at the same time, and is missed where it falls
    silent. Who is not was replaced: a driver that was started again with another frame is no second lidar.
    """

    def __init__(self) -> None:
        self._takes_turns: Dict[str, bool] = {}
        self._newest: Optional[str] = None

    def hear(self, name: str) -> bool:
        """Take note that one of them has sent something; return whether it was heard again after another one."""
        returns = name in self._takes_turns and name != self._newest
        self._takes_turns[name] = returns or self._takes_turns.get(name, False)
        self._newest = name
        return returns

    @property
    def present(self) -> List[str]:
        """Those who send: all that take turns, and who was heard last."""
        return [name for name, takes_turns in self._takes_turns.items() if takes_turns or name == self._newest]
