#!/usr/bin/env python3
import sys

from mbf_relay.lockstep.cross_entropy import main

if __name__ == "__main__":
    sys.exit(main())
