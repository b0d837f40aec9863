#!/usr/bin/env python3
import sys

from mbf_relay.commands import end_in_silence

end_in_silence()
from mbf_relay.lockstep.cross_entropy import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
