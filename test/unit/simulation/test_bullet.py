"""Loading PyBullet: quiet where it works, clear where it does not."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SOURCE = Path(__file__).resolve().parents[3] / "src"


def load(folder, module):
    """Import the simulation's PyBullet in a process that finds `module` under that name; return how the process ended.
    """
    (folder / "pybullet.py").write_text(module, encoding="utf-8")
    code = f"import sys; sys.path[:0] = [{str(folder)!r}, {str(SOURCE)!r}]; import mbf_relay.simulation.bullet"
    return subprocess.run([sys.executable, "-c", code], capture_output=True)


def test_its_own_line_is_not_shown(tmp_path):
    done = load(tmp_path, "import os; os.write(2, b'pybullet build time: today')")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


@pytest.mark.parametrize("reason, words", [
    ("numpy.core.multiarray failed to import", f"made for a newer NumPy than {np.__version__}"),
    ("libGL.so.1: cannot open shared object file", "libGL.so.1"),
])
def test_what_hinders_it_is_told(tmp_path, reason, words):
    done = load(tmp_path, f"raise ImportError({reason!r})")
    last = done.stderr.decode().splitlines()[-1]
    assert done.returncode == 1 and words in last
    assert ("pybullet==3.2.5" in last) == reason.startswith("numpy")
