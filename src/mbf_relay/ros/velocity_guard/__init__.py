"""The guard between whoever drives and the wheels."""
