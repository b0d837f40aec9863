#!/usr/bin/env python3
from mbf_relay.ros.parameter_tables import main

main()
