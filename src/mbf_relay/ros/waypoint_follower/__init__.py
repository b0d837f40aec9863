"""The node that drives to waypoints one after the other."""
