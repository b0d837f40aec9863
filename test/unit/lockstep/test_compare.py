"""The compare command on folders of results."""

import json

import pytest

from mbf_relay.lockstep import compare, compare_many
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.results_file import ResultsFile


def batch(folder, times, settings):
    file = ResultsFile(folder, settings)
    for index, time in enumerate(times):
        success = time is not None
        file.append(
            EpisodeResult(f"barn_{index:03d}", 1, success, "SUCCEEDED" if success else "TIMEOUT", time=time or 99.0)
        )
    file.close()
    return folder


def test_differences_and_worlds_that_changed_sides_are_shown(tmp_path, capsys):
    first = batch(tmp_path / "a", [10.0, 20.0, None, 12.0], {"controller": "DWA"})
    second = batch(tmp_path / "b", [9.0, 18.5, 30.0, None], {"controller": "RPP"})
    assert compare.main([str(first), str(second), "--json", str(tmp_path / "c.json")]) == 0
    shown = capsys.readouterr().out
    assert "controller: A 'DWA', B 'RPP'" in shown
    assert "brought to success by B alone: barn_002 (seed 1)" in shown
    assert "brought to success by A alone: barn_003 (seed 1)" in shown
    made = json.loads((tmp_path / "c.json").read_text())
    assert made["measures"]["time of successes"]["difference"][0] == pytest.approx(-1.25)
    assert made["measures"]["score"]["difference"] == [None, None, None]


def test_a_broken_line_is_told_and_left_out(tmp_path, capsys):
    folder = batch(tmp_path / "a", [10.0, 11.0], {})
    with open(folder / "episodes.jsonl", "a") as lines:
        lines.write("{broken\n")
    assert compare.main([str(folder), str(folder)]) == 0
    told = capsys.readouterr()
    assert "line 3, is left out" in told.err
    assert "2 pairs" in told.out and "settings: the same" in told.out


def test_a_file_that_holds_no_results_is_told_of_in_a_line_and_not_in_thousands(tmp_path, capsys):
    folder = batch(tmp_path / "a", [10.0], {})
    with open(folder / "episodes.jsonl", "a") as lines:
        lines.write("{broken\n" * 1500)
    assert compare.main([str(folder), str(folder)]) == 0
    told = capsys.readouterr().err
    assert "line 2, is left out" in told and "so are 1499 more" in told and len(told.splitlines()) <= 2


def test_who_gives_the_tables_is_told_what_to_give(tmp_path, capsys):
    """Of a JSON parser's "line 1 column 1 (char 0)" nobody learnt that the folder is what is asked for."""
    folder = batch(tmp_path / "a", [10.0, 11.0], {})
    (folder / "results.csv").write_text("world,seed,outcome\nbarn_003,1,SUCCEEDED\n")
    assert compare.main([str(folder / "results.csv"), str(folder)]) == 1
    told = capsys.readouterr().err
    assert "results.csv holds no results; give a batch's folder, or the episodes.jsonl in it" in told
    assert "char 0" not in told


def test_who_gives_a_batch_that_ended_in_its_first_line_is_told_of_that_line(tmp_path, capsys):
    """He had given the folder, and was told to give the folder."""
    folder, other = batch(tmp_path / "a", [10.0], {}), batch(tmp_path / "b", [10.0], {})
    lines = folder / "episodes.jsonl"
    lines.write_text(lines.read_text()[:40])
    for given in folder, lines:
        assert compare.main([str(given), str(other)]) == 1
        told = capsys.readouterr().err
        assert "line 1, is left out" in told and "give a batch's folder" not in told


def test_nothing_in_common_and_nothing_there_are_errors(tmp_path, capsys):
    first = batch(tmp_path / "a", [10.0], {})
    second = tmp_path / "b"
    file = ResultsFile(second, {})
    file.append(EpisodeResult("other", 1, True, "SUCCEEDED"))
    file.close()
    assert compare.main([str(first), str(second)]) == 1
    assert "share no world and seed" in capsys.readouterr().err
    assert compare.main([str(first), str(tmp_path / "none")]) == 1
    assert "does not exist" in capsys.readouterr().err


def test_several_batches_stand_in_one_table_each_against_the_first(tmp_path, capsys):
    names = []
    for name, time in (("base", None), ("better", 10.0), ("same", None)):
        names.append(str(batch(tmp_path / name, [time if index < 14 else 12.0 for index in range(20)], {})))
    assert compare.main(names) == 0
    shown = capsys.readouterr().out
    better, same = (next(line for line in shown.splitlines() if line.startswith(name)) for name in names[1:])
    assert "1.000" in better and "+0.700" in better and better.endswith("better")
    assert same.endswith("chance 1.000: no difference")


def test_worlds_too_few_to_tell_are_not_called_no_difference(tmp_path, capsys):
    for worlds, told in ((6, "too few worlds to tell (6; it takes 7)"), (7, "better")):
        slow, fast = (
            str(batch(tmp_path / f"{name}{worlds}", [time] * worlds, {})) for name, time in (("s", None), ("f", 10.0))
        )  # two batches against the first: the rarer has to be twice as rare
        assert compare.main([slow, slow, fast]) == 0
        (line,) = [line for line in capsys.readouterr().out.splitlines() if "+1.000" in line]
        assert line.endswith(told)


def seeds_of_one_world(folder, successes):
    file = ResultsFile(folder, {})
    for seed in range(1, 101):
        file.append(EpisodeResult("circle", seed, successes, "SUCCEEDED" if successes else "TIMEOUT", time=60.0))
    file.close()
    return str(folder)


def test_a_hundred_seeds_of_one_world_are_not_told_to_differ_by_chance_alone(tmp_path, capsys):
    never, always = seeds_of_one_world(tmp_path / "a", False), seeds_of_one_world(tmp_path / "b", True)
    assert compare.main([never, always]) == 0
    shown = capsys.readouterr().out
    assert "+1.000" in shown and "too few worlds to tell (1; it takes 6)" in shown
    assert "intervals tell of other seeds in that world, and of no other world" in shown
    enough = [str(batch(tmp_path / name, [time] * 6, {})) for name, time in (("slow", None), ("fast", 10.0))]
    assert compare.main(enough) == 0
    shown = capsys.readouterr().out
    assert "too few" not in shown and "no other world" not in shown and "equally good: 0.031" in shown


def test_other_worlds_under_the_same_names_are_told_of(tmp_path, capsys):
    names = [f"barn_{index:03d}" for index in range(8)]
    before = {name: f"hash of {name}" for name in names}
    for folder, digests in (("a", before), ("b", {**before, "barn_002": "edited", "barn_005": "edited", "more": "x"}),
                            ("c", before), ("old", None)):
        batch(tmp_path / folder, [10.0] * 8, {} if digests is None else {"world_digests": digests})
    a, b, c, old = (str(tmp_path / folder) for folder in ("a", "b", "c", "old"))
    for arguments in ([a, b], [a, c, b]):
        assert compare.main(arguments) == 0
        told = capsys.readouterr()
        assert f"{b}: 2 worlds are not those of {a}, for all their names: barn_002, barn_005" in told.out
        assert "hash of" not in told.out, "of a thousand worlds nobody wants to read that"
    for arguments in ([a, c], [a, c, c], [a, old]):
        assert compare.main(arguments) == 0
        assert "for all their names" not in capsys.readouterr().out


def test_success_is_drawn_against_difficulty(tmp_path, capsys):
    folder = batch(tmp_path / "a", [None if index > 9 else 9.0 for index in range(20)], {})
    worlds = tmp_path / "worlds.json"
    stated = [{"name": f"barn_{index:03d}", "difficulty": {"path_length_ratio": 1.0 + 0.1 * index}}
              for index in range(20)]
    worlds.write_text(json.dumps({"worlds": stated}))
    picture = tmp_path / "success.png"
    arguments = [str(folder), str(folder), "--plot", str(picture), "--worlds", str(worlds)]
    assert compare.main(arguments) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    results, _ = compare.read_lines(folder / "episodes.jsonl")
    points = compare_many.by_difficulty(results, compare.load_difficulties(worlds), "path_length_ratio")
    assert [share.value for _, share in points] == [1.0, 1.0, 0.5, 0.0, 0.0]
    assert compare.main([*arguments, "--by", "colour"]) == 1
    assert "no world driven states 'colour'; worlds state path_length_ratio" in capsys.readouterr().err
