"""What a batch tells while it runs."""

import io

import pytest

from mbf_relay.lockstep.command import Progress


@pytest.mark.parametrize("done, elapsed, said", [
    (1, 351.0, "1/1000 in 5:51 min, 0.2 a minute, 97 h 24 min left: all well"),
    (300, 100.0, "300/1000 in 1:40 min, 180 a minute, 3:53 min left: all well"),
    (1000, 7290.0, "1000/1000 in 2 h 01 min, 8.2 a minute: all well"),
])
def test_a_slow_batch_tells_of_its_pace_and_of_hours(done, elapsed, said):
    stream = io.StringIO()
    Progress(1000, stream).show(done, elapsed, "all well")
    assert stream.getvalue() == said + "\n"
