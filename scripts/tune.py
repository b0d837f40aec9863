#!/usr/bin/env python3
import sys

from mbf_relay.lockstep.tune import main

if __name__ == "__main__":
    sys.exit(main())
