"""A client whose connection for results stands late still hears how its goal ended."""



from mbf_relay.ros.common.actions import action_server


def heard_by(late_comers):
    heard = []
    late_comers.peer_subscribe("result", None, heard.append)
    return heard


def test_a_result_sent_just_before_a_client_was_connected_reaches_it():
    late_comers = action_server._LateComers()
    late_comers.note("first")
    late_comers.note("second")
    assert heard_by(late_comers) == ["first", "second"]


def test_results_of_a_crowd_that_has_left_are_not_held_for_ever(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(action_server.time, "monotonic", lambda: now[0])
    late_comers = action_server._LateComers()
    for number in range(1000):
        late_comers.note(f"result {number}")
    now[0] += action_server.LATE + 0.1
    late_comers.forget()
    assert not late_comers._sent


def test_a_client_that_comes_later_hears_nothing_of_old_goals(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(action_server.time, "monotonic", lambda: now[0])
    late_comers = action_server._LateComers()
    late_comers.note("old")
    now[0] += action_server.LATE + 0.1
    assert heard_by(late_comers) == []
    late_comers.note("new")
    assert heard_by(late_comers) == ["new"]


def test_memory_is_given_back_when_the_last_goal_is_told_of_no_more_and_not_while_the_robot_drives(monkeypatch):
    class Server:
        is_stopped = tells_of_goals = False

        def update(self):
            told.append(self.tells_of_goals)
            if not rounds:
                self.is_stopped = True
                return
            self.tells_of_goals = rounds.pop(0)

    told, given_back, rounds = [], [], [False, True, True, False, False, True, False, False]
    monkeypatch.setattr(action_server.rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(action_server.time, "sleep", lambda _seconds: None)
    monkeypatch.setattr(action_server, "give_back_free", lambda: given_back.append(len(told)))
    action_server._keep_telling([Server()])
    assert given_back == [4, 7]
