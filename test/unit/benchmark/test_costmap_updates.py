"""The updates of costmaps that a benchmark times are those of a robot that drives."""

from benchmark import costmap as benchmark

from mbf_relay.costmap.costmap import Costmap


def test_each_scan_is_of_its_update_s_time(monkeypatch):
    """After 32 updates they were older and older, and half a minute in the end: nothing was tracked in them."""
    ages, observe = [], Costmap.observe

    def note(costmap, source, observation, now):
        ages.append(now - observation.stamp)
        observe(costmap, source, observation, now)

    monkeypatch.setattr(Costmap, "observe", note)
    benchmark._update("local_costmap", 60)
    assert len(ages) > 60 and set(ages) == {0.0}
