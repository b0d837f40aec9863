"""The node move_base: relay and Move Base Flex server in one process."""
