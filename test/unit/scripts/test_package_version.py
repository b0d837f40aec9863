"""Which version apt is told that a package of this checkout has, and how scripts/package is called."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def checkout(tmp_path):
    (tmp_path / "scripts").mkdir()
    (tmp_path / ".git").mkdir()
    for name in ("scripts/package", "package.xml", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path / name)
    for path in (tmp_path, *tmp_path.rglob("*")):
        os.utime(path, (1.0e9, 1.0e9))
    return tmp_path


def version(checkout):
    program = [str(checkout / "scripts" / "package"), "--version"]
    return subprocess.run(program, stdout=subprocess.PIPE, check=True, timeout=60.0).stdout.decode().strip()


def test_a_robot_gets_the_package_that_was_built_last(checkout):
    """All had the version of the release: apt said that it had the newest, and the robot drove on with older code."""
    before = version(checkout)
    assert before == version(checkout) == before.partition("+")[0] + "+20010909014640"
    os.utime(checkout / "LICENSE", (1.0e9 + 1.5, 1.0e9 + 1.5))
    changed = version(checkout)
    (checkout / "LICENSE").unlink()  # which leaves nothing newer but its folder
    removed = version(checkout)
    assert before < changed < removed, (before, changed, removed)
    os.utime(checkout / ".git", None)
    os.utime(checkout, (1.0e9, 1.0e9))
    assert version(checkout) == before


def test_who_mistypes_an_option_is_told_so_before_anything_is_installed_for_it(checkout):
    """It made a folder of that name, installed the compilers of Debian packages, and could not enter the folder."""
    run = checkout / "scripts" / "run"
    run.write_text("#!/bin/sh\ntouch installed\n")
    run.chmod(0o755)
    before = sorted(checkout.rglob("*"))
    done = subprocess.run(
        ["scripts/package", "--verison"], cwd=str(checkout), stderr=subprocess.PIPE, text=True, timeout=60.0)
    assert done.returncode == 1 and "unknown option --verison" in done.stderr and "--help" in done.stderr
    assert sorted(checkout.rglob("*")) == before


def test_a_package_is_built_from_where_its_script_lies(checkout):
    """`bash package` installed all that is needed, then did not find the script again."""
    run = checkout / "scripts" / "run"
    run.write_text('#!/bin/sh\necho "$2"\n')
    run.chmod(0o755)
    done = subprocess.run(
        ["bash", "package"], cwd=str(run.parent), stdout=subprocess.PIPE, check=True, text=True, timeout=60.0)
    assert done.stdout == f"{run.parent / 'package'}\n"
