"""A queue in which sensor messages wait until tf knows their time, like tf2_ros::MessageFilter."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any, Callable, Deque, Dict, List, Optional

import rospy

from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.checks import InvalidMessage, check_stamp
from mbf_relay.ros.common.conversions import dated
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings

_ONE_SECOND = rospy.Duration(1.0)


class MessageQueue:
    """Messages with a header, or what was made of them, in the order of their arrival, given out once they are ready.

    Callbacks put, one worker takes. Of several of one frame that are ready together only the newest is given, so that a
    slow worker does not fall behind.

    Args:
        length: Messages it holds; of more, the oldest is dropped.
        warnings: Where refused messages are reported.
    """

    def __init__(self, length: int = 100, warnings: Optional[ThrottledWarnings] = None) -> None:
        self._changed = threading.Condition()  # guards all below; nothing else is locked while it is held
        self._has_news = False
        self._waiting: Deque[Any] = deque(maxlen=length)
        self._warnings = warnings or ThrottledWarnings()

    def offer(self, message: Any, now: float, make: Callable[[Any], Any] = lambda message: message) -> None:
        """Add a sensor's message, or warn that it is refused, where that lasts.

        Args:
            message: A message with a header.
            now: ROS time (s); 0 before the first /clock.
            make: Converts it to the object that is queued, which has a header, too.
        """
        try:
            check_stamp(message.header.stamp.to_sec(), now)
            self.put(make(dated(message)))
        except (InvalidMessage, TransformError) as error:
            self._warnings.say(f"a message of {message._type} refused: {error}")
        else:
            self._warnings.worked()

    def put(self, message: Any) -> None:
        """Add a message; drop the oldest where the queue is full."""
        with self._changed:
            if self._waiting and message.header.stamp + _ONE_SECOND < self._waiting[-1].header.stamp:
                self._waiting.clear()  # time was set back, as by a simulation's reset
            self._waiting.append(message)
            self._has_news = True
            self._changed.notify()

    def look_again(self) -> None:
        """Wake `take` to test the waiting messages again; call when transforms have arrived."""
        with self._changed:
            if self._waiting:
                self._has_news = True
                self._changed.notify()

    def take(self, is_ready: Callable[[Any], bool], timeout: float) -> List[Any]:
        """Wait for news, `timeout` wall seconds at most, and return the newest ready message of each frame, by stamp.

        Older ones of the same frame are dropped. Empty where none is ready.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._has_news, timeout)
            self._has_news = False
            waiting = list(self._waiting)
        ready: Dict[str, Any] = {
            message.header.frame_id: message for message in waiting if is_ready(message)
        }
        with self._changed:
            newest = {frame: message.header.stamp for frame, message in ready.items()}
            left = [
                m
                for m in self._waiting
                if m.header.frame_id not in newest or m.header.stamp > newest[m.header.frame_id]
            ]
            self._waiting.clear()
            self._waiting.extend(left)
        return sorted(ready.values(), key=lambda message: message.header.stamp)

    def oldest(self) -> Optional[Any]:
        """Return the message that has waited longest, None where the queue is empty."""
        with self._changed:
            return self._waiting[0] if self._waiting else None
