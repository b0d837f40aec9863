#!/usr/bin/env python3
import sys

from mbf_relay.lockstep.compare import main

sys.exit(main())
