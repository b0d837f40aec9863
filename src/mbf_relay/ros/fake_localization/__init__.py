"""The node that tells what a simulator knows as if it had been localized."""
