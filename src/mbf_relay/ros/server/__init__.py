"""The Move Base Flex server."""
