"""Several nodes forked from one process, to share the memory of imported modules."""
