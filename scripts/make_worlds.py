#!/usr/bin/env python3
import sys

from mbf_relay.simulation.make_worlds import main

sys.exit(main())
