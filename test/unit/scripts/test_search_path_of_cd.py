"""Which checkout the scripts take for theirs where the shell's CDPATH is exported, as many a .bashrc has it."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[3] / "scripts"


@pytest.fixture
def checkout(tmp_path):
    """A folder with our scripts, and one beside that holds a folder of the same name."""
    (tmp_path / "other" / "scripts").mkdir(parents=True)
    (tmp_path / "mine" / "scripts").mkdir(parents=True)
    for name in ("demo", "test", "benchmark", "package"):
        shutil.copy(SCRIPTS / name, tmp_path / "mine" / "scripts" / name)
    shutil.copy(SCRIPTS.parent / "package.xml", tmp_path / "mine")
    return tmp_path / "mine"


def told(command, checkout, place, **environment):
    """Return what a script says, called in a checkout where CDPATH names a place."""
    return subprocess.run(
        command, cwd=str(checkout), env={**os.environ, "CDPATH": place, **environment}, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, timeout=60.0).stdout


@pytest.mark.parametrize("place", [".", "../other"])
@pytest.mark.parametrize("name", ["demo", "test", "benchmark", "package"])
def test_who_exports_cdpath_runs_the_checkout_he_called(checkout, name, place):
    """`cd` went to another checkout, which was built and driven, or said where it went in the middle of the path."""
    run = checkout / "scripts" / "run"
    run.write_text('#!/bin/sh\necho "$0"\n')
    run.chmod(0o755)
    assert told([f"scripts/{name}"], checkout, place) == f"{run}\n"


@pytest.mark.parametrize("place", [".", "../other"])
def test_who_exports_cdpath_builds_the_checkout_he_called(checkout, place):
    shutil.copy(SCRIPTS / "run", checkout / "scripts" / "run")
    cache = {"XDG_CACHE_HOME": str(checkout.parent / "cache")}
    where = ["scripts/run", "--where"]
    assert told(where, checkout, place, **cache) == told(where, checkout, "", **cache)
    assert told(["scripts/package", "--version"], checkout, place).count("\n") == 1
