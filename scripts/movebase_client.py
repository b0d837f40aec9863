#!/usr/bin/env python3
"""See mbf_relay.ros.tools.clients; --help tells the options."""
from mbf_relay.ros.common.node import run_program

run_program("mbf_relay.ros.tools.clients.movebase_client")
