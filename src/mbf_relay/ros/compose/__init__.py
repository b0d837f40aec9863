"""Several nodes forked from one parent, which has imported what they all need."""
