"""What scripts/run gives to the programs it runs."""

import os
import subprocess
import sysconfig
from pathlib import Path

import pytest

pytest.importorskip("roslaunch")

RUN = Path(__file__).resolve().parents[3] / "scripts" / "run"


def test_a_robot_does_not_wait_for_roslaunch_to_import_what_it_does_not_use():
    code = "import sys, roslaunch; print(*{'setuptools', 'pkg_resources'} & set(sys.modules))"
    done = subprocess.run([str(RUN), "python3", "-c", code], stdout=subprocess.PIPE, check=True, timeout=600.0)
    assert done.stdout.decode().split() == []


def test_another_numpy_in_the_users_home_does_not_keep_the_robot_from_starting(tmp_path):
    """`pip install --user` brings it along with many a library: every node ended, and so did the build."""
    numpy = Path(sysconfig.get_path("purelib", "posix_user", {"userbase": str(tmp_path)})) / "numpy.py"
    numpy.parent.mkdir(parents=True)
    numpy.write_text("raise ImportError('another NumPy')\n")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONNOUSERSITE"}
    subprocess.run(
        [str(RUN), "python3", "-c", "import numpy"], check=True, timeout=600.0,
        env=dict(environment, PYTHONUSERBASE=str(tmp_path)))


@pytest.mark.parametrize("model", ["diff", "omni"])
def test_a_robot_that_includes_amcl_s_own_examples_is_localized_with_shims(tmp_path, model):
    """As the navigation tutorial's first launch file does; roslaunch found no such file, and started nothing."""
    path = tmp_path / "move_base.launch"
    path.write_text(f'<launch><include file="$(find amcl)/examples/amcl_{model}.launch"/></launch>')
    code = ("import sys; from roslaunch.config import load_config_default;"
            "loaded = load_config_default([(sys.argv[1], [])], 11311, verbose=False);"
            "print(loaded.nodes[0].type, *(p.key + '=' + str(p.value) for p in loaded.params.values()))")
    done = subprocess.run(
        [str(RUN), "--shims", "python3", "-c", code, str(path)], stdout=subprocess.PIPE, check=True, timeout=600.0)
    told = done.stdout.decode().split()
    assert told[0] == "amcl" and f"/amcl/odom_model_type={model}" in told and "/amcl/min_particles=500" in told
