"""The README's parameter tables are those of the declarations."""

from pathlib import Path

import pytest

pytest.importorskip("mbf_msgs", reason="needs the built package")

from mbf_relay.ros import parameter_tables

README = Path(__file__).resolve().parents[3] / "README.md"


def test_the_readme_shows_the_parameters_as_they_are_declared():
    text = README.read_text(encoding="utf-8")
    assert parameter_tables.replaced(text) == text, (
        "the parameters have changed: run `rosrun mbf_relay parameter_tables.py --write README.md`"
    )


def test_every_parameter_says_what_it_does():
    for parameter_set in parameter_tables.parameter_sets():
        for name, field in parameter_set.__dataclass_fields__.items():
            assert field.metadata.get("description"), f"{parameter_set.__qualname__}.{name} has no description"


def test_a_document_without_a_place_for_the_tables_is_refused():
    with pytest.raises(ValueError, match="no place"):
        parameter_tables.replaced("# nothing here\n")
