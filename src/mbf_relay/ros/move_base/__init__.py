"""The node that takes move_base's place by itself: the relay and the server it needs, in one process."""
