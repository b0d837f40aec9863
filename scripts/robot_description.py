#!/usr/bin/env python3
import sys

from mbf_relay.ros.tools.robot_description import main

sys.exit(main())
