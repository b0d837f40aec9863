"""`python3 test/benchmark`, which is what scripts/benchmark runs."""

import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).resolve().parents[1])

from benchmark.command import main  # noqa: E402

if __name__ == "__main__":  # worker processes import this file
    sys.exit(main())
