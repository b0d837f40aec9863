#!/usr/bin/env python3
from mbf_relay.ros.drive_report import main

main()
