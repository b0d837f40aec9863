#!/usr/bin/env python3
"""A move_base carried out by Move Base Flex: the goal topic alone."""
from mbf_relay.ros.node import run_node

if __name__ == "__main__":
    from mbf_relay.ros.relay_node import serve
    run_node("move_base", lambda: serve(action=False, topic=True))
