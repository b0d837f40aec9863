#!/usr/bin/env python3
from mbf_relay.ros.tools.parameter_tables import main

main()
