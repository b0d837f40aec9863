"""Which code drives: plugins that are edited between two batches, with workers that stand by, and what they import."""

import pickle
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from odd_work import pace_of  # noqa: E402

from mbf_relay.lockstep.batch import settings_of  # noqa: E402
from mbf_relay.lockstep.cluster import _sources  # noqa: E402
from mbf_relay.lockstep.driver import DONE, REFUSED, Driver, packed  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import make_setup  # noqa: E402


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def asked(driver, call, argument, expected=None):
    kind, content = driver.run(packed(call, argument, expected), 60.0)
    assert kind == DONE, (kind, content)
    return pickle.loads(content)


def as_batch_sees_them(names):
    """Return the sources that a command started now would find."""
    command = Driver()
    try:
        return asked(command, _sources, names)
    finally:
        command.end()


@pytest.fixture
def worker():
    made = Driver()
    yield made
    made.end()


def test_a_worker_that_stands_by_drives_with_an_edited_plugin_as_it_is_now(folder, worker):
    (folder / "edited_plugin.py").write_text("PACE = 0.15\n")
    first = as_batch_sees_them(["edited_plugin.Mine"])
    assert asked(worker, pace_of, "edited_plugin", first) == 0.15
    (folder / "edited_plugin.py").write_text("PACE = 0.0725\n")
    second = as_batch_sees_them(["edited_plugin.Mine"])
    assert second.plugins != first.plugins
    assert asked(worker, _sources, ["edited_plugin.Mine"], second) == second, "it is asked before it gets work"
    assert asked(worker, pace_of, "edited_plugin", second) == 0.0725
    kind, text = worker.run(packed(pace_of, "edited_plugin", first), 60.0)
    assert kind == REFUSED and b"has another edited_plugin.Mine" in text, "what is gone is driven with by nobody"


def test_results_of_a_plugin_are_told_from_those_after_an_edit_of_what_it_imports(folder):
    package = folder / "edited_package"
    package.mkdir()
    (folder / "edited_helper.py").write_text("import edited_second\nimport numpy\n")
    (folder / "edited_second.py").write_text("COST = 253\n")
    (folder / "edited_stranger.py").write_text("COST = 253\n")
    (package / "__init__.py").write_text("")
    (package / "late.py").write_text("")
    (package / "plugins.py").write_text(
        "import edited_helper, json, sys\nfrom . import part\n\n\n"
        "def plan():\n    from edited_package.late import thing\n"
    )
    (package / "part.py").write_text("import edited_package.plugins\n")  # in a circle

    def digest():
        return as_batch_sees_them(["edited_package.plugins.Mine"]).plugins["edited_package.plugins.Mine"]

    before = digest()
    assert len(before) == 16
    (folder / "edited_stranger.py").write_text("COST = 20\n")
    assert digest() == before, "what it does not import is none of its code"
    seen = {before}
    for name in ("edited_helper.py", "edited_second.py", "edited_package/__init__.py", "edited_package/part.py",
                 "edited_package/late.py", "edited_package/plugins.py"):
        with open(folder / name, "a", encoding="utf-8") as file:
            file.write("# edited\n")
        seen.add(digest())
    assert len(seen) == 7


def test_a_plugin_is_the_same_wherever_its_folder_lies(folder, tmp_path, monkeypatch):
    found = []
    for name in ("here", "site-packages"):
        package = folder / name / "moved_package"
        package.mkdir(parents=True)
        (package / "__init__.py").write_text("from moved_package import part\n")
        (package / "part.py").write_text("import numpy, yaml\n")
        with monkeypatch.context() as patch:
            patch.syspath_prepend(folder / name)
            found.append(as_batch_sees_them(["moved_package.part.Mine"]))
    assert found[0] == found[1]


@pytest.fixture
def learnt(folder):
    """Return a function that tells which files are known of a plugin with a parameter given."""
    (folder / "learnt_plugin.py").write_text("""
from dataclasses import dataclass
from mbf_relay.parameters import ParameterSet, parameter
from small_worlds import Throwing

class Mine(Throwing):
    @dataclass(frozen=True)
    class Parameters(ParameterSet):
        weights: str = parameter("", "where they are")
        gain: float = parameter(1.0, "how much of what they say", maximum=2.0)
""")

    def files(change):
        changes = ["controllers=[{name: mine, type: learnt_plugin.Mine}]", f"mine.{change}"]
        return settings_of("worlds.json", [], make_setup(config_folder(), has_map=False, changes=changes))["files"]

    return files


def test_a_policy_that_was_trained_once_more_is_another(folder, learnt):
    """Its weights lay in the same file, and the same command had the drives of before for those of the new one."""
    weights = folder / "policy weights.npz"
    seen = []
    for content in (None, b"one", b"another", b"one"):
        if content:
            weights.write_bytes(content)
        seen.append(learnt(f"weights='{weights}'"))
    assert seen[0] == {} and set(seen[1]) == {"mine.weights"}
    assert seen[1] == seen[3] != seen[2]


@pytest.mark.parametrize("change", ["gain=7.0", f"weights='{'words ' * 60}'"])
def test_a_night_is_driven_with_what_a_server_drives_with(learnt, change):
    """A batch ended in a traceback at a number that is taken to its nearest, and at a text longer than a file's name.
    """
    assert learnt(change) == {}


def test_a_layer_of_ones_own_whose_zones_were_drawn_anew_is_another(folder):
    """A batch went on with the drives of before, in which the robot kept out of other places."""
    (folder / "zones_layer.py").write_text("""
from dataclasses import dataclass
from mbf_relay.costmap.prohibition_layer import ProhibitionLayer
from mbf_relay.parameters import parameter

class Mine(ProhibitionLayer):
    @dataclass(frozen=True)
    class Parameters(ProhibitionLayer.Parameters):
        zones: str = parameter("", "file of the zones")
""")
    zones, own, seen = folder / "zones.yaml", folder / "move_base_flex.yaml", []
    own.write_text(
        f"local_costmap: {{plugins: [{{name: mine, type: zones_layer.Mine}}], mine: {{zones: '{zones}'}}}}")
    for content in ("one", "another"):
        zones.write_text(content)
        setup = make_setup(config_folder(), has_map=False, config=own)
        seen.append(settings_of("worlds.json", [], setup)["files"])
    assert set(seen[0]) == set(seen[1]) == {"local_costmap.mine.zones"} and seen[0] != seen[1]
