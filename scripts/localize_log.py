#!/usr/bin/env python3
import sys

from mbf_relay.localization.command import main

sys.exit(main())
