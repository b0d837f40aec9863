#!/usr/bin/env python3
"""A move_base carried out by Move Base Flex: the goal topic alone."""
from mbf_relay.ros.common.node import run_node

if __name__ == "__main__":
    run_node("move_base", "mbf_relay.ros.relay.node.serve", action=False, topic=True)
