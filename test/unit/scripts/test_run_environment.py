"""What scripts/run gives to the programs it runs."""

import subprocess
from pathlib import Path

import pytest

pytest.importorskip("roslaunch")

RUN = Path(__file__).resolve().parents[3] / "scripts" / "run"


def test_a_robot_does_not_wait_for_roslaunch_to_import_what_it_does_not_use():
    code = "import sys, roslaunch; print(*{'setuptools', 'pkg_resources'} & set(sys.modules))"
    done = subprocess.run([str(RUN), "python3", "-c", code], stdout=subprocess.PIPE, check=True, timeout=600.0)
    assert done.stdout.decode().split() == []
