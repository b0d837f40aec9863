"""The amcl node's command line."""

from __future__ import annotations

import argparse
from typing import Sequence

USAGE = """usage: amcl [--run-from-bag BAG [--global-localization]]

Localize a robot on a map by a particle filter, with amcl's topics, services and parameters.

  --run-from-bag BAG      read scans and /tf from a bag instead of from topics
  --global-localization   start with particles all over the map; needs --run-from-bag"""


def check_arguments(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options; end the program with its usage where they cannot be understood."""
    parser = argparse.ArgumentParser(prog="amcl", description="Without options: run on topics.")
    parser.add_argument("--run-from-bag", dest="bag", metavar="BAG", help="bag with /tf and one topic of scans")
    parser.add_argument("--global-localization", action="store_true", help="start with particles all over the map")
    options = parser.parse_args(arguments)
    if options.global_localization and options.bag is None:
        parser.error("--global-localization needs --run-from-bag; on topics, call the service global_localization")
    return options
