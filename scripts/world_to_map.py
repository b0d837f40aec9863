#!/usr/bin/env python3
import sys

from mbf_relay.simulation.world_map_command import main

sys.exit(main())
