#!/usr/bin/env python3
from mbf_relay.commands import run

run("mbf_relay.ros.tools.robot_parameters.main")
