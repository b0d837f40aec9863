"""Trouble that lasts is warned of; hiccups and a graph that comes up are not."""



from mbf_relay.ros.common.throttled_warnings import PERIOD, START_PATIENCE, ThrottledWarnings


class Bench:
    def __init__(self):
        self.now = 100.0
        self.said = []
        self.warnings = ThrottledWarnings(lambda: self.now, lambda form, text: self.said.append(form % text))

    def trouble(self, seconds):
        end = self.now + seconds
        while self.now < end:
            self.warnings.say("no pose")
            self.now += 0.1


def test_nothing_is_said_while_the_graph_comes_up():
    bench = Bench()
    bench.trouble(START_PATIENCE - 0.5)
    assert bench.said == []


def test_what_never_comes_up_is_told_in_the_end():
    bench = Bench()
    bench.trouble(START_PATIENCE + 0.5)
    assert bench.said == ["no pose"]


def test_a_hiccup_is_not_told_and_does_not_add_up():
    bench = Bench()
    for _ in range(10):
        bench.warnings.worked()
        bench.trouble(0.5)
    assert bench.said == []


def test_lasting_trouble_is_told_now_and_then():
    bench = Bench()
    bench.warnings.worked()
    bench.trouble(1.5)
    assert bench.said == ["no pose"]
    bench.trouble(2.0 * PERIOD)
    assert len(bench.said) == 3
