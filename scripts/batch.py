#!/usr/bin/env python3
import sys

from mbf_relay.importing import import_or_exit

if __name__ == "__main__":  # worker processes import this file
    sys.exit(import_or_exit("mbf_relay.lockstep.batch").main())
