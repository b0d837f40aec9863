"""Tables of results: what a spreadsheet, pandas or NumPy finds in them."""

import csv
import dataclasses
import math

import numpy as np
import pytest

from mbf_relay.lockstep.result import EpisodeResult, failed
from mbf_relay.lockstep.smoothness import smoothness
from mbf_relay.lockstep.tables import COLUMNS, spl, write

DRIVEN = EpisodeResult(
    "a, quoted", 3, True, "SUCCEEDED", time=20.0, path_length=5.0, reference_path_length=4.0, score=0.4,
    trajectory=np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.1, 0.02, 0.0, 0.0, -0.2, 0.1]]),
    believed=np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]]),
)


def test_a_row_an_episode_and_nothing_that_was_not_measured(tmp_path):
    write(tmp_path, [DRIVEN, failed("b", 1, "died", 4.0)], trajectories=True)
    with open(tmp_path / "results.csv", newline="") as file:
        first, second = csv.DictReader(file)
    assert list(first) == [column.name for column in COLUMNS]
    assert (first["world"], first["success"], first["spl"], first["path_length_ratio"]) == (
        "a, quoted", "1", "0.8", "1.25"
    )
    assert (first["velocity_average"], first["velocity_peak"], first["closest_approach"]) == ("0.25", "0.2", "")
    assert (second["barn_score"], second["success"], second["time"], second["message"]) == ("0.0", "0", "", "died")
    assert second["spl"] == "0.0", "a crash would count in the mean of one metric and be left out of the other's"
    with np.load(tmp_path / "trajectories" / "a, quoted-3.npz") as file:
        assert file["truth"].shape == file["believed"].shape == (2, 3) and file["velocity"][1, 0] == -0.2
    text = (tmp_path / "README.md").read_text()
    assert all(f"| `{column.name}` | {column.unit} |" in text for column in COLUMNS)


def test_worlds_named_like_places_have_their_files_in_the_folder_and_each_one_of_its_own(tmp_path):
    """After a night of driving, neither picture nor trajectory was left, or one lay three folders higher."""
    names = ["set1/world 3", "set1_world 3", "set1%2Fworld 3", "../../../up", "..", "x" * 300, "x" * 301, "a\0b",
             "w\u00f6rld"]
    out = tmp_path / "a" / "b" / "out"
    out.mkdir(parents=True)
    write(out, [dataclasses.replace(DRIVEN, world=name) for name in names], trajectories=True)
    files = [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.npz")]
    assert len(files) == len(names) and all(file.startswith("a/b/out/trajectories/") for file in files)
    assert "a/b/out/trajectories/w\u00f6rld-3.npz" in files and "a/b/out/trajectories/set1_world 3-3.npz" in files


def test_whoever_cites_a_figure_finds_who_defined_it():
    unsourced = {column.name for column in COLUMNS if not column.source}
    assert unsourced == {"world", "seed", "outcome", "goals", "wall_time", "message", "digest"}, "these measure nothing"


def test_parquet_is_written_where_it_can_be(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    write(tmp_path, [DRIVEN])
    assert parquet.read_table(tmp_path / "results.parquet").to_pydict()["spl"] == [0.8]


def test_spl_is_that_of_anderson():
    assert spl(EpisodeResult("w", 1, True, "SUCCEEDED", path_length=3.0, reference_path_length=4.0)) == 1.0
    assert spl(EpisodeResult("w", 1, False, "CONTACT", path_length=3.0, reference_path_length=4.0)) == 0.0
    assert spl(EpisodeResult("w", 1, True, "SUCCEEDED", path_length=3.0)) is None


def test_angular_jerk_of_a_turn_that_quickens_evenly_is_none():
    times = np.arange(0.0, 2.0, 0.1)
    even = smoothness(times, np.zeros_like(times), 0.5 * times, 1.0)
    assert even.mean_angular_jerk == pytest.approx(0.0, abs=1e-9)
    waved = smoothness(times, np.zeros_like(times), np.sin(3.0 * times), 1.0)
    assert waved.mean_angular_jerk == pytest.approx(9.0 * 2.0 / math.pi, rel=0.25)
