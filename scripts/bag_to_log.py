#!/usr/bin/env python3
import sys

from mbf_relay.ros.tools.bag_to_log import main

sys.exit(main())
