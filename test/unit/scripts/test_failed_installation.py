"""What a user reads when scripts/run cannot install: the reason, in a few lines."""

import re
import subprocess
from pathlib import Path

import pytest
from ros_testing import wait_until

RUN = Path(__file__).resolve().parents[3] / "scripts" / "run"
PACKAGES = [f"package{number}" for number in range(60)]
NO_NETWORK = """
apt-get() {
  case " $* " in
    *" update "*)
      echo "E: Failed to fetch http://deb.debian.org/  Temporary failure resolving 'deb.debian.org'"
      case "$*" in *Error-Mode=any*) return 100 ;; esac ;;
    *) printf 'E: Unable to locate package %s\\n' $MISSING; return 100 ;;
  esac
}
"""
FULL = """
apt-get() {
  case " $* " in *" update "*) return 0 ;; esac
  echo "dpkg: error processing archive /var/cache/apt/archives/gcc.deb (--unpack):"
  echo " cannot copy extracted data for './usr/bin/gcc': failed to write (No space left on device)"
  printf 'Errors were encountered while processing:\\n /var/cache/apt/archives/gcc.deb\\n'
  echo "E: Sub-process /usr/bin/dpkg returned an error code (1)"
  return 100
}
"""
UPDATES_ITSELF = """
apt-get() {
  case " $* " in *" update "*|*" DPkg::Lock::Timeout="[1-9]*) return 0 ;; esac
  echo "E: Could not get lock /var/lib/dpkg/lock-frontend. It is held by process 6894 (unattended-upgr)"
  return 100
}
"""
UPDATES_ITS_LISTS = """
sleep() { rm -f "$cache/held"; }
apt-get() {
  case " $* " in *" install "*) [ ! -e "$cache/updated" ] || return 0 ;; esac
  case " $* " in *" update "*) [ -e "$cache/held" ] || { touch "$cache/updated"; return 0; } ;; esac
  echo "E: Could not get lock /var/lib/apt/lists/lock. It is held by process 412 (apt-get)"
  return 100
}
"""


def told(tmp_path, program, call, status=1):
    """Return what the script's own functions say with others in the place of what they call."""
    text = RUN.read_text(encoding="utf-8")
    functions = [re.search(rf"^{name}\(\) \{{.*?\}}$", text, re.MULTILINE | re.DOTALL).group()
                 for name in ("say", "fail", "install_packages", "apt_install", "compile_kernels_meanwhile")]
    stand_ins = "sudo() { \"$@\"; }\nenv() { shift; \"$@\"; }\nmissing_packages() { printf '%s\\n' $MISSING | sort; }"
    stand_ins += "\nis_built() { true; }"
    done = subprocess.run(
        ["bash", "-uc", "\n".join([*functions, stand_ins, program, call])], stderr=subprocess.PIPE, text=True,
        env={"PATH": "/usr/bin:/bin", "cache": str(tmp_path), "MISSING": " ".join(PACKAGES), "for_package": "no",
             "checkout": "", "workspace": str(tmp_path), "compiler_packages": PACKAGES[7]}, timeout=60.0)
    assert done.returncode == status, done.stderr
    return done.stderr


def test_who_has_no_network_reads_that_and_not_each_package_that_is_missing(tmp_path):
    """apt called the update a success, and sixty lines said that packages cannot be located."""
    said = told(tmp_path, NO_NETWORK, "install_packages")
    assert "Temporary failure resolving" in said and said.count("Unable to locate") < 10, said


def test_who_has_just_started_the_machine_waits_until_it_has_updated_itself(tmp_path):
    """The first minutes belong to unattended-upgrades; whoever tried in these had nothing installed."""
    told(tmp_path, UPDATES_ITSELF, "install_packages", status=0)


def test_who_has_just_started_the_machine_waits_until_it_knows_what_packages_there_are(tmp_path):
    """apt waits for nobody who holds its lists: none of the packages was located on a machine without any."""
    (tmp_path / "held").touch()
    assert "update failed" not in told(tmp_path, UPDATES_ITS_LISTS, "install_packages", status=0)


@pytest.mark.parametrize("reason, waits", [
    ("Could not get lock /var/lib/apt/lists/lock. It is held by process 412 (apt-get)", 60),
    ("Could not open lock file /var/lib/apt/lists/lock - open (30: Read-only file system)", 0),
])
def test_who_waits_for_lists_of_packages_in_vain_is_told_why(tmp_path, reason, waits):
    fails = f"sleep() {{ say slept; }}\napt-get() {{ echo 'E: {reason}'; return 100; }}"
    said = told(tmp_path, fails, "install_packages")
    assert reason in said and "going on without" in said and said.count("slept") == waits


def test_who_has_no_room_for_packages_reads_that(tmp_path):
    """All that was shown is that a sub-process of apt returned an error code."""
    assert "No space left on device" in told(tmp_path, FULL, "install_packages")


def test_who_has_no_room_for_the_build_reads_that_although_no_log_can_be_written(tmp_path):
    for left, is_full in (("   0", True), (" 999", True), ("1000", False)):
        said = told(tmp_path, f"df() {{ printf 'Avail\\n{left}\\n'; }}", "fail 'the build failed'")
        assert ("lies is full" in said) == is_full, said


COMPILES = """
is_built() { false; }
exec() { say "$BASHPID compiles"; trap 'echo; say stopped; exit' INT; while :; do sleep 0.05; done; }
apt-get() {
  case " $* " in *" update "*) return 0 ;; esac
  local all="$*"
  say "installs ${all##*--no-install-recommends }"
  case "$*" in *package8*) while ! grep -q compiles "$workspace/kernels.log"; do sleep 0.05; done; return 100 ;; esac
}
"""


def test_kernels_are_compiled_while_packages_are_installed_and_no_longer(tmp_path):
    """One core was idle for the minute that apt takes, and then both compiled for half a minute."""
    said = told(tmp_path, COMPILES, "install_packages")
    assert said.index(f"installs {PACKAGES[7]}\n") < said.index("installs package0 ")
    wait_until(lambda: "stopped" in (tmp_path / "kernels.log").read_text(encoding="utf-8"), "the compilation to end")
