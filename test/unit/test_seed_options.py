"""Seeds on command lines: whoever gives an invalid one reads which option, its value, and what it may be."""

import pytest

from mbf_relay.localization import command
from mbf_relay.lockstep import cross_entropy, tune
from mbf_relay.simulation import make_worlds

COMMANDS = [
    (command.main, ("log.npz", "map.yaml")), (make_worlds.main, ("--kind", "barn", "--out", "worlds.json")),
    (tune.main, ("worlds.json", "--param", "DWAPlannerROS.sim_time=1.0:3.0")), (cross_entropy.main, ()),
]


@pytest.mark.parametrize("seed", ["-1", "1.5"])
@pytest.mark.parametrize("main, arguments", COMMANDS, ids=lambda given: getattr(given, "__module__", ""))
def test_who_gives_a_seed_that_is_none_is_told_at_once(main, arguments, seed, capsys, monkeypatch, tmp_path):
    """`expected non-negative integer` named neither option nor value; tune.py had made its folder and its workers."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["command"])
    with pytest.raises(SystemExit) as ended:
        main([*arguments, f"--seed={seed}"])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and f"argument --seed: '{seed}' is no seed" in said and "from 0 to" in said
