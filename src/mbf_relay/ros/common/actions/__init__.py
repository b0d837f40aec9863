"""Both ends of an action: goals that survive a clock that stands or is set back, and end with whoever wants them."""
