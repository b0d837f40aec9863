#!/usr/bin/env python3
import sys

from mbf_relay.ros.tools.check_config import main

sys.exit(main())
