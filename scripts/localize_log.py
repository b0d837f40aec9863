#!/usr/bin/env python3
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported: its threads spin between small matrices

from mbf_relay.commands import run  # noqa: E402

run("mbf_relay.localization.command.main")
