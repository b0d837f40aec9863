#!/usr/bin/env python3
from mbf_relay.ros.tools.drive_report import main

main()
