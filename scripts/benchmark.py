#!/usr/bin/env python3
import sys

from mbf_relay.benchmarks.command import main

if __name__ == "__main__":  # worker processes import this file
    sys.exit(main())
