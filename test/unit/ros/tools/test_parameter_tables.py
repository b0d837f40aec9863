"""The READMEs' tables are those of the declarations."""

import dataclasses
import sys
from pathlib import Path

import pytest

from mbf_relay.ros.tools import parameter_tables

ROOT = Path(__file__).resolve().parents[4]


@pytest.mark.parametrize("folder", ["config", "launch"])
def test_the_readme_shows_what_is_declared(folder):
    text = (ROOT / folder / "README.md").read_text(encoding="utf-8")
    assert parameter_tables.replaced(text, ROOT / folder) == text, (
        f"the declarations have changed: run `rosrun mbf_relay parameter_tables.py --write {folder}/README.md`"
    )


def test_the_tables_are_the_same_on_a_machine_without_gymnasium(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "mbf_relay.lockstep.environment", raising=False)
    test_the_readme_shows_what_is_declared("config")


def test_every_parameter_says_what_it_does():
    for parameter_set in parameter_tables.parameter_sets():
        for field in dataclasses.fields(parameter_set):
            assert field.metadata.get("description"), f"{parameter_set.__qualname__}.{field.name} has no description"


def test_a_document_without_a_place_for_the_tables_is_refused():
    with pytest.raises(ValueError, match="no place"):
        parameter_tables.replaced("# nothing here\n", ROOT)
