"""The node that stands in for move_base."""
