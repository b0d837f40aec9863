"""The simulated world: the only room that knows the physics engine."""
