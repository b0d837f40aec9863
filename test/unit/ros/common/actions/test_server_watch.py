"""Whether an action server is there: what is asked, and of whom, when it falls silent."""

from types import SimpleNamespace

import pytest
import rospy

from mbf_relay.ros.common.actions import server_watch
from mbf_relay.ros.common.actions.server_watch import GONE, MUTE, THERE, ServerWatch, ask_node, check_alone

NODE = "/move_base_flex"


class Link(SimpleNamespace):
    """A connection to a node that publishes the status."""

    def __init__(self, address, node=NODE):
        super().__init__(callerid_pub=node, endpoint_id=address)


class Subscriber:
    """Has the connections it is given."""

    def __init__(self, topic, kind, callback, **_):
        self.impl = SimpleNamespace(connections=[])
        self.callback = callback

    def get_num_connections(self):
        return len(self.impl.connections)

    def hear(self):
        """Deliver a status message."""
        self.callback(SimpleNamespace(_connection_header={"callerid": NODE}))


@pytest.fixture
def world(monkeypatch):
    """A watch whose clock is `world.now`, that of ROS `world.ros_now`, and whose nodes are `world.alive` or `mute`."""
    world = SimpleNamespace(now=100.0, ros_now=7.0, alive=set(), mute=set(), asked=[])

    def ask(node, address="", timeout=0.0):
        world.asked.append(address)
        return THERE if address in world.alive else MUTE if address in world.mute else GONE

    monkeypatch.setattr(server_watch.rospy, "Subscriber", Subscriber)
    monkeypatch.setattr(server_watch.rospy, "get_rostime", lambda: SimpleNamespace(to_sec=lambda: world.ros_now))
    monkeypatch.setattr(server_watch, "time", SimpleNamespace(monotonic=lambda: world.now))
    monkeypatch.setattr(server_watch, "ask_node", ask)
    world.watch = ServerWatch("move_base_flex/move_base", lambda node: True, 5.0, lambda message: None)
    world.links = world.watch._subscriber.impl.connections
    return world


def looks(world, seconds, clock_runs=True):
    """Let time pass, looking ten times a second, and return what came of it."""
    for _ in range(round(10 * seconds)):
        world.now += 0.1
        world.ros_now += 0.1 * clock_runs
        loss = world.watch.why_lost(world.now)
        if loss is not None:
            return loss
    return None


def connect(world):
    world.alive.add("http://here:1")
    world.links.append(Link("http://here:1"))
    world.watch._subscriber.hear()


def test_a_server_that_was_started_again_is_not_lost_for_the_death_of_the_one_before(world):
    connect(world)
    world.alive = {"http://here:2"}
    world.links[:] = [Link("http://here:2")]
    world.now += 10.0  # nobody looked meanwhile, and the new one has not said anything yet
    assert world.watch.why_lost(world.now) is None
    assert looks(world, 0.8) is None
    assert world.asked == ["http://here:2"]


def test_a_server_that_speaks_while_its_client_is_being_made_is_heard(monkeypatch):
    """Its first word ended in an AttributeError in the log."""
    class Eager(Subscriber):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            self.hear()

    monkeypatch.setattr(server_watch.rospy, "Subscriber", Eager)
    monkeypatch.setattr(server_watch.rospy, "get_rostime", lambda: SimpleNamespace(to_sec=lambda: 0.0))
    heard = []
    watch = ServerWatch("move_base_flex/move_base", lambda node: True, 5.0, heard.append)
    assert len(heard) == 1 and watch.is_up and watch.silence < 60.0


def test_a_server_that_died_is_lost_though_its_connection_seems_to_stand(world):
    connect(world)
    world.alive.clear()
    assert "does not exist any more" in looks(world, 0.6)
    assert not world.watch.is_up


def test_a_server_started_anew_that_freezes_as_it_is_connected_is_not_said_to_have_died(world):
    """It was asked for where the one before had been, since it had not told its name yet: nobody is there any more."""
    connect(world)
    half_open = Link("http://here:2")
    half_open.callerid_pub = ""
    world.links[:], world.alive, world.mute = [half_open], set(), {"", "http://here:2"}
    assert "hangs" in looks(world, 10.0)
    assert "http://here:1" not in world.asked


@pytest.mark.parametrize("answers", [True, False], ids=["answers", "mute"])
@pytest.mark.parametrize("clock_runs", [True, False], ids=["time passes", "time stands"])
def test_a_server_that_falls_silent_is_lost_after_a_while_unless_it_waits_for_the_clock(world, answers, clock_runs):
    (world.alive if answers else world.mute).add("http://here:1")
    world.links.append(Link("http://here:1"))
    world.watch._subscriber.hear()
    losses = []
    for _ in range(100):
        world.now += 0.1
        world.ros_now += 0.1 * clock_runs
        losses.append(world.watch.why_lost(world.now))
    assert len(world.asked) <= 40, "a node that hangs is not asked at each look"
    if answers and not clock_runs:
        assert set(losses) == {None} and world.watch.is_up
    else:
        first = next(index for index, loss in enumerate(losses) if loss)
        assert "hangs: its node /move_base_flex has been silent for 5." in losses[first] and 50 <= first + 1 <= 54
        assert not any(losses[first + 1:]), "it is told once"


def test_a_goal_is_not_lost_where_a_paused_simulation_goes_on_elsewhere_in_time(world):
    """The clock reaches the relay before it reaches the server, and before the server's status reaches the relay."""
    connect(world)
    assert looks(world, 20.0, clock_runs=False) is None
    world.ros_now += 1000.0
    assert looks(world, 0.5) is None
    world.watch._subscriber.hear()
    assert looks(world, 0.5) is None and world.watch.is_up


def test_a_goal_is_not_lost_for_one_answer_that_comes_late_while_time_stands(world):
    connect(world)
    assert looks(world, 20.0, clock_runs=False) is None
    asked = len(world.asked)
    world.alive, world.mute = world.mute, world.alive
    while len(world.asked) == asked:
        assert looks(world, 0.1, clock_runs=False) is None
    world.alive, world.mute = world.mute, world.alive
    assert looks(world, 20.0, clock_runs=False) is None and world.watch.is_up


@pytest.mark.parametrize("answers", [True, False], ids=["answers", "answers late"])
def test_a_relay_that_got_no_core_for_a_while_does_not_take_that_for_the_servers_silence(world, answers):
    connect(world)
    world.now, world.ros_now = world.now + 30.0, world.ros_now + 30.0
    if not answers:
        world.alive, world.mute = world.mute, world.alive
    assert world.watch.why_lost(world.now) is None
    world.watch._subscriber.hear()
    assert looks(world, 0.5) is None and world.watch.is_up


def test_a_server_that_closes_its_connection_is_lost_at_once_and_one_that_blinks_is_not(world):
    world.alive.add("http://here:1")
    for gone_for, is_lost in (0.2, False), (0.4, True):
        world.links[:] = [Link("http://here:1")]
        world.watch._subscriber.hear()
        assert world.watch.why_lost(world.now) is None and world.watch.is_connected
        world.links.clear()
        world.now += gone_for
        loss = world.watch.why_lost(world.now)
        assert not world.watch.is_connected and bool(loss) is is_lost
    assert "closed the connection" in loss


def test_a_server_in_whose_simulation_time_stands_is_found_without_a_word_of_it(world, monkeypatch):
    world.links.append(Link("http://here:1"))
    assert world.watch.why_lost(world.now) is None and not world.watch.is_up, "it does not answer yet"
    world.alive.add("http://here:1")
    assert world.watch.why_lost(world.now) is None and not world.watch.is_up, "it was asked just now"
    world.now += 0.3
    monkeypatch.setattr(world.watch, "_takes_goals", lambda node: False)
    assert world.watch.why_lost(world.now) is None and not world.watch.is_up, "a bag's player"
    monkeypatch.setattr(world.watch, "_takes_goals", lambda node: True)
    assert world.watch.why_lost(world.now) is None and world.watch.is_up
    assert world.asked == ["http://here:1"] * 2


def asked_of(monkeypatch, others, listening, ask):
    """Have the master tell of nodes that say what came of goals, and of those that take some; `ask` one, as /here."""
    state = 1, "", [
        [["/move_base/result", others], ["/move_base/status", ["/other"]]], [["/move_base/goal", listening]], []]
    monkeypatch.setattr(server_watch, "impatient_proxy", lambda *_: SimpleNamespace(getSystemState=lambda _: state))
    monkeypatch.setattr(server_watch, "ask_node", ask)
    monkeypatch.setattr(rospy, "get_name", lambda: "/here")
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name.lstrip('/')}")


@pytest.mark.parametrize("others, listening, alive, refused", [
    ([], [], [], False), (["/here"], ["/here"], ["/here"], False), (["/here", "/other"], ["/other"], ["/other"], True),
    (["/other"], ["/other"], [], False), (["/bag"], ["/recorder"], ["/bag", "/recorder"], False),
    (["/other", "/here"], ["/here", "/other"], ["/here", "/other"], False),
    (["/here", "/other"], ["/other", "/here"], ["/here", "/other"], True),
])
def test_two_nodes_do_not_take_the_same_goals_from_each_other(monkeypatch, others, listening, alive, refused):
    """Who plays a bag of an older drive says what came of goals, too, and takes none; of two, the first stays."""
    asked_of(monkeypatch, others, listening, lambda node: THERE if node in alive else GONE)
    if refused:
        with pytest.raises(ValueError, match="/other serves the action /move_base already"):
            check_alone("move_base")
    else:
        check_alone("move_base")


def test_a_node_that_answers_late_is_not_taken_for_one_that_is_gone(monkeypatch):
    """Two relays on a busy machine both served the clients, and each replaced the other's goals."""
    answers = iter([MUTE, THERE])
    asked_of(monkeypatch, ["/other"], ["/other"], lambda _: next(answers))
    with pytest.raises(ValueError, match="/other serves the action /move_base already"):
        check_alone("move_base")


def test_a_relay_outlives_a_server_by_a_name_that_is_none():
    assert ask_node("/move_base_flex", "http://robot..local:1234/") == MUTE


def test_a_node_does_not_wait_for_a_master_that_is_gone_to_learn_whether_it_is_alone(monkeypatch):
    def refuse(_):
        raise ConnectionRefusedError

    monkeypatch.setattr(server_watch, "impatient_proxy", lambda *_: SimpleNamespace(getSystemState=refuse))
    monkeypatch.setattr(rospy, "get_name", lambda: "/here")
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name.lstrip('/')}")
    check_alone("move_base")


def test_only_who_takes_goals_and_tells_of_them_speaks_for_the_server_and_one_that_ends_has_its_last_word(
    world, monkeypatch
):
    """A stranger's result answered the relay's client that the robot had arrived; it was on its way."""
    takes_goals = {NODE, "/recorder"}
    monkeypatch.setattr(world.watch, "_takes_goals", takes_goals.__contains__)
    server, *strangers = (
        SimpleNamespace(_connection_header={"callerid": name}) for name in (NODE, "/recorder", "/player", "/stranger"))
    world.links += [Link("http://here:1"), Link("http://here:2", "/player")]  # of a bag, which tells a status, too
    assert world.watch.is_from_server(server) and not any(map(world.watch.is_from_server, strangers))
    world.watch._subscriber.hear()
    takes_goals.clear()
    world.links.clear()
    assert world.watch.is_from_server(server), "its result came after it had closed the connection for goals"
    assert not any(map(world.watch.is_from_server, strangers))


def test_a_robot_drives_on_for_hours_by_a_server_whose_status_comes_and_whose_node_answers_late(world):
    """What it is silent between two of its words must not be summed up until it counts as hung."""
    world.mute.add("http://here:1")
    world.links.append(Link("http://here:1"))
    for _ in range(40):
        world.watch._subscriber.hear()
        assert looks(world, 0.4) is None
    assert world.asked == []


def test_a_server_whose_connection_is_cut_and_made_again_while_the_clock_stands_is_not_lost(world):
    connect(world)
    assert looks(world, 20.0, clock_runs=False) is None
    link = world.links.pop()
    assert looks(world, 0.2, clock_runs=False) is None
    world.links.append(link)
    assert looks(world, 1.0, clock_runs=False) is None
    world.links.clear()
    assert "closed the connection" in looks(world, 0.5, clock_runs=False)


def test_no_goal_is_sent_for_the_status_of_a_node_that_takes_none(monkeypatch):
    monkeypatch.setattr(server_watch.rospy, "Subscriber", Subscriber)
    monkeypatch.setattr(server_watch.rospy, "get_rostime", lambda: SimpleNamespace(to_sec=lambda: 0.0))
    heard = []
    watch = ServerWatch("move_base_flex/move_base", lambda node: node != NODE, 5.0, heard.append)
    watch._subscriber.hear()
    assert not heard and not watch.is_up and watch.silence == float("inf")


def test_a_server_that_was_started_again_at_another_address_has_all_its_time_to_speak(world):
    connect(world)
    world.alive, world.mute = set(), {"http://here:1", "http://here:2"}
    assert looks(world, 4.5) is None
    world.links[:] = [Link("http://here:2")]
    assert looks(world, 4.5) is None
    assert "hangs" in looks(world, 2.0)
