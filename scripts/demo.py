#!/usr/bin/env python3
import signal
import sys

signal.signal(signal.SIGINT, signal.SIG_DFL)  # nothing to put in order before main() takes over
from mbf_relay.ros.tools.demo import main  # noqa: E402

sys.exit(main())
