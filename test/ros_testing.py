"""What the rostests share: waiting for conditions, bounded by the wall clock, and listening to topics."""

import io
import signal
import threading
import time
from pathlib import Path
from typing import Any, Callable, List, Optional, Union

LOOK_PERIOD = 0.1
"""Wall seconds between two looks of which each costs much, as one at the master, a page or every process does."""
_PAUSE = threading.Event()


def wait_until(
    condition: Callable[[], Any], what: Union[str, Callable[[], str]], timeout: float = 30.0, period: float = 0.02
) -> Any:
    """Return the condition's first true value.

    Args:
        condition: Asked again every `period` wall seconds.
        what: Named in the failure: "waited 30 s for WHAT, in vain"; called then, where that is known only then.
        timeout: Wall seconds to wait at most.
        period: Wall seconds between two looks.

    Raises:
        AssertionError: It did not come true.
    """
    end = time.monotonic() + timeout
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() >= end:
            raise AssertionError(f"waited {timeout:.0f} s for {what() if callable(what) else what}, in vain")
        _PAUSE.wait(period)


def freeze(process: Any) -> None:
    """Stop a process and wait until all of it stands: its threads run on until the one that takes the signal does."""
    process.send_signal(signal.SIGSTOP)

    def stands() -> bool:
        stats = Path(f"/proc/{process.pid}/task").glob("*/stat")
        return {path.read_text(encoding="utf-8").rpartition(")")[2].split()[0] for path in stats} == {"T"}

    wait_until(stands, f"process {process.pid} to stand still")


def as_received(message: Any, kind: Any, sender: Optional[str] = "/driver") -> Any:
    """Return a message as one of a kind that reads the same bytes, as a subscriber of that kind gets it.

    A sender need not name itself.
    """
    sent = io.BytesIO()
    message.serialize(sent)
    received = kind().deserialize(sent.getvalue())
    received._connection_header = {} if sender is None else {"callerid": sender}
    return received


class Listener:
    """Keeps every message of a topic, from any thread.

    With `connected` there is a publisher already by whose connection messages can come.
    """

    def __init__(self, topic: str, message_type: Any, connected: bool = False) -> None:
        import rospy

        self.topic = topic
        self.messages: List[Any] = []
        self._subscriber = rospy.Subscriber(
            topic, message_type, self.messages.append, queue_size=1000, tcp_nodelay=True
        )
        if connected:
            wait_until(lambda: self.publishers, f"a publisher of {topic}")

    @property
    def publishers(self) -> List[str]:
        """The nodes it is connected to; a message that comes once is lost to a connection that rospy only counts."""
        from mbf_relay.ros.common.connected_nodes import connected_nodes

        return list(connected_nodes(self._subscriber))

    @property
    def last(self) -> Optional[Any]:
        """The newest message, None before the first."""
        return self.messages[-1] if self.messages else None

    def wait_for(self, condition: Callable[[Any], bool], what: str, timeout: float = 30.0, since: int = 0) -> Any:
        """Return the first message, from index `since` on, for which the condition holds."""

        def found() -> Any:
            for message in self.messages[since:]:
                if condition(message):
                    return [message]
            return None

        return wait_until(found, f"{what} on {self.topic}", timeout)[0]

    def close(self) -> None:
        """Stop listening."""
        self._subscriber.unregister()


def connected_publisher(topic: str, message_type: Any, timeout: float = 30.0, **options: Any) -> Any:
    """Return a publisher that another node already listens to; this one may, too, and is sooner there."""
    import rospy

    options.setdefault("queue_size", 10)
    publisher = rospy.Publisher(topic, message_type, **options)

    def is_heard() -> bool:
        return any(link.endpoint_id != rospy.get_name() for link in publisher.impl.connections)

    wait_until(is_heard, f"a subscriber of {topic}", timeout)
    return publisher
