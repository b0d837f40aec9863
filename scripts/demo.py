#!/usr/bin/env python3
import sys

from mbf_relay.ros.demo import main

sys.exit(main())
