"""Several nodes forked from one process, which has imported what they all need."""
