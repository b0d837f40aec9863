#!/usr/bin/env python3
"""See mbf_relay.ros.clients; --help tells the options."""
from mbf_relay.ros.clients import mbf_path_client

if __name__ == "__main__":
    mbf_path_client()
