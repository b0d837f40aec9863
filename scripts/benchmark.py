#!/usr/bin/env python3
import sys

from mbf_relay.benchmarks.command import main

sys.exit(main())
