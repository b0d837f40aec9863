#!/usr/bin/env python3
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported: its threads spin between small matrices

from mbf_relay.commands import end_in_silence  # noqa: E402

end_in_silence()
from mbf_relay.localization.command import main  # noqa: E402

sys.exit(main())
