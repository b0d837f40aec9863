#!/usr/bin/env python3
from mbf_relay.commands import run

run("mbf_relay.lockstep.compare.main")
