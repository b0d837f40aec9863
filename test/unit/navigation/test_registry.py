"""Plugin lists: what is wrong with them is named, and each slot gets a plugin of its own."""

import threading

import pytest
import scripted

from mbf_relay.geometry import STOP
from mbf_relay.navigation.goals import RecoverGoal
from mbf_relay.navigation.registry import Registry
from mbf_relay.navigation.task import Ending
from mbf_relay.navigation.worker import InlineWorker, ThreadWorker
from mbf_relay.outcomes import RecoveryOutcome
from mbf_relay.planning import PLANNERS
from mbf_relay.planning.planner import Planner
from mbf_relay.plugins import PluginError
from mbf_relay.recovery import RECOVERIES
from mbf_relay.recovery.recovery import Recovery

TYPE = "scripted.ScriptedPlanner"
WAIT = 10.0


def registry(entries, **config):
    return Registry("planners", {"planners": entries, **config}, Planner, PLANNERS, InlineWorker(), "global")


@pytest.mark.parametrize("entries, words", [
    ([{"name": "A", "type": TYPE}, {"name": "A", "type": TYPE}], ["planners", "'A' twice"]),
    ([{"name": "A"}], ["entry 0", "name and a type"]),
    ([{"name": 3, "type": TYPE}], ["entry 0"]),
    ([{"name": "", "type": TYPE}], ["empty name"]),
    (["A"], ["entry 0", "'A'"]),
    ("A", ["must be a list"]),
    ([{"name": "A", "type": TYPE, "costmap": "both"}], ["'both'", "global"]),
])
def test_a_wrong_list_is_refused_and_the_text_says_why(entries, words):
    with pytest.raises(PluginError) as caught:
        registry(entries)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("entry, config, words", [
    ({"type": "our_planner/OurPlanner"}, {}, ["our_planner/OurPlanner", "navfn/NavfnROS"]),
    ({"type": "no.such.module.Planner"}, {}, ["no.such.module.Planner", "available"]),
    ({"type": "scripted.ScriptedController"}, {}, ["ScriptedController", "no planner"]),
    ({"type": "navfn/NavfnROS"}, {"A": {"allow_unknown": "perhaps"}}, ["A", "NavfnROS", "allow_unknown"]),
    ({"type": TYPE}, {"A": 3}, ["must be the group"]),
])
def test_a_plugin_that_cannot_be_made_is_refused_by_name_and_the_others_serve(entry, config, words):
    made = registry([{"name": "A", **entry}, {"name": "B", "type": TYPE}], **config)
    assert made.names == ["B"] and list(made.failed) == ["A"] and made.choose("B") == "B"
    for name in ("A", ""):  # the first of the list is what a goal without a name needs
        with pytest.raises(PluginError) as refusal:
            made.choose(name)
        for word in ['"A"', *words]:
            assert word in str(refusal.value)


@pytest.mark.parametrize("config", [
    {"navfn": {"NavfnROS": {"allow_unknown": False}}}, {"navfn/NavfnROS": {"allow_unknown": False}},
])
def test_a_name_with_a_slash_finds_its_parameters_as_in_ros(config):
    made = registry([{"name": "navfn/NavfnROS", "type": "navfn/NavfnROS"}], **config)
    assert made.plugin("navfn/NavfnROS").parameters.allow_unknown is False


def test_each_plugin_gets_its_own_parameters():
    made = registry([{"name": "N1", "type": "navfn/NavfnROS"}, {"name": "N2", "type": "navfn/NavfnROS"}],
                    N2={"allow_unknown": False})
    assert made.plugin("N1").parameters.allow_unknown and not made.plugin("N2").parameters.allow_unknown


@pytest.mark.parametrize("own, beside, fastest, slowest", [
    ({}, {"max_vel_theta": 0.3, "max_vel_x": 0.2}, 0.3, 0.3),
    ({}, {"max_rotational_vel": 0.5, "min_in_place_rotational_vel": 0.2}, 0.5, 0.2),
    ({"max_rotational_vel": 0.8}, {"max_vel_theta": 0.3, "min_in_place_vel_theta": 0.1}, 0.8, 0.1),
    ({}, {}, 1.0, 0.4),
])
def test_a_robot_that_looks_round_turns_no_faster_than_upstream_s_by_the_same_file(own, beside, fastest, slowest):
    """rotate_recovery reads the limits of TrajectoryPlannerROS: a robot of 0.1 rad/s was turned at 1 rad/s."""
    config = {"recovery_behaviors": [{"name": "turn", "type": "rotate_recovery/RotateRecovery"}], "turn": own,
              "TrajectoryPlannerROS": beside}
    made = Registry("recovery_behaviors", config, Recovery, RECOVERIES, InlineWorker(), "local")
    parameters = made.plugin("turn").parameters
    assert (parameters.max_vel_theta, parameters.min_in_place_vel_theta) == (fastest, slowest)
    assert not made.class_of("turn").Parameters.unknown_names(made.values("turn"))


def test_names_are_kept_in_order_and_the_first_is_the_default():
    made = registry([{"name": name, "type": TYPE} for name in ("Z", "A", "M")])
    assert made.names == ["Z", "A", "M"] and made.choose("") == "Z" and made.choose("M") == "M"
    assert made.type_of("A") == TYPE and made.class_of("A") is scripted.ScriptedPlanner


def test_an_empty_list_is_fine_until_somebody_asks():
    with pytest.raises(PluginError, match="No plugins loaded"):
        registry([]).choose("")
    assert registry([]).names == []


def test_slots_have_plugins_of_their_own_and_share_parameters():
    made = registry([{"name": "N", "type": "navfn/NavfnROS"}])
    first, second = made.instance("N", 0), made.instance("N", 1)
    assert first.plugin is made.plugin("N") is not second.plugin
    wanted = first.plugin.parameters.replace(allow_unknown=False)
    made.reconfigure("N", wanted)
    assert first.plugin.parameters == second.plugin.parameters == made.instance("N", 2).plugin.parameters == wanted


class OnlyPlanner(scripted.ScriptedPlanner):
    """A planner that can be made once only, as one that offers a service of its own."""

    made = 0

    def __init__(self, *arguments, **options):
        type(self).made += 1
        if self.made > 1:
            raise RuntimeError("service is registered already")
        super().__init__(*arguments, **options)


def test_a_robot_plans_with_a_planner_that_can_be_made_once_only():
    OnlyPlanner.made = 0
    made = registry([{"name": "P", "type": f"{__name__}.OnlyPlanner"}])
    slots = [made.instance("P", slot) for slot in (0, "move_base", "make_plan")]
    assert OnlyPlanner.made == 3 and all(instance is slots[0] for instance in slots)


def test_callers_of_one_plugin_are_served_one_after_the_other():
    done, inside, go_on, order = threading.Semaphore(0), threading.Event(), threading.Event(), []
    made = Registry(
        "planners", {"planners": [{"name": "N", "type": TYPE}]}, Planner, PLANNERS, ThreadWorker(done.release), "global"
    )

    def long_call(plugin):
        inside.set()
        go_on.wait(WAIT)
        order.append("first")

    made.instance("N", 0).call(long_call)
    assert inside.wait(WAIT)
    made.instance("N", 0).call(lambda plugin: order.append("second"))
    assert made.instance("N", 0).busy and not order
    go_on.set()
    assert done.acquire(timeout=WAIT) and done.acquire(timeout=WAIT)
    assert order == ["first", "second"]


def test_a_busy_plugin_is_reconfigured_before_its_next_call():
    before = registry([{"name": "N", "type": "navfn/NavfnROS"}]).plugin("N").parameters
    wanted = before.replace(allow_unknown=False)

    def meanwhile(plugin):
        made.reconfigure("N", wanted)
        return plugin.parameters

    held = scripted.HeldWorker()
    made = Registry(
        "planners", {"planners": [{"name": name, "type": "navfn/NavfnROS"} for name in "NM"]}, Planner, PLANNERS, held,
        "global")
    instance = made.instance("N", 0)
    call = instance.call(meanwhile)
    held.step()
    assert call.result() == before
    after = instance.call(lambda plugin: plugin.parameters)
    held.step()
    assert after.result() == wanted
    assert made.plugin("M").parameters == before, "new parameters were another's"


def test_a_planner_is_added_while_the_robot_drives_and_one_that_cannot_be_made_changes_nothing():
    made = registry([{"name": "N", "type": "navfn/NavfnROS"}, {"name": "broken", "type": "no/Such"}])
    for name in "broken", "another":
        with pytest.raises(PluginError, match="no/Such"):
            made.add(name, "no/Such")
        with pytest.raises(PluginError, match=name):
            made.choose(name)
    for name in "broken", "another":
        made.add(name, "navfn/NavfnROS")
        assert made.choose(name) == name and made.plugin(name).parameters == made.plugin("N").parameters
    assert made.names == ["N", "broken", "another"]


def test_a_robot_that_is_about_to_ask_its_controller_drives_on_while_somebody_tunes_that():
    held = scripted.HeldWorker()
    made = Registry(
        "planners", {"planners": [{"name": "N", "type": "navfn/NavfnROS"}]}, Planner, PLANNERS, held, "global"
    )
    instance = made.instance("N", 0)
    wanted = instance.plugin.parameters.replace(allow_unknown=False)
    assert not instance.busy
    made.reconfigure("N", wanted)  # by another thread, after that look
    assert not instance.busy, "nobody has called it"
    call = instance.call(lambda plugin: plugin.parameters)
    held.step()
    assert call.result() == wanted


def test_parameters_that_come_in_the_midst_of_a_call_wait_for_its_end():
    made = registry([{"name": "N", "type": "navfn/NavfnROS"}])
    instance = made.instance("N", 0)
    before = instance.plugin.parameters
    first, second = before.replace(allow_unknown=False), before.replace(default_tolerance=0.7)

    def meanwhile(plugin):
        made.reconfigure("N", first)
        made.reconfigure("N", second)
        return plugin.parameters

    assert instance.call(meanwhile).result() == before
    assert instance.call(lambda plugin: plugin.parameters).result() == second


class Wordless(RuntimeError):
    """A user's own, whose words come of what it was never given."""

    def __str__(self):
        return f"motor {self.motor} is off"


@pytest.mark.parametrize("what", ["plan", "velocity", "reached"])
def test_goals_of_other_slots_go_on_where_a_plugin_raises_what_cannot_be_put_in_words(bench, what):
    slow = bench.navigator.recovery(RecoverGoal("R1"))
    bench.script.recovery = lambda context: iter([STOP] * 5)
    setattr(bench.script, what, Wordless())
    task = bench.navigator.move_base(scripted.GOAL)
    message = bench.finish(task).message
    assert task.ending is Ending.ABORTED
    assert "Wordless: and what it says cannot be told for AttributeError" in message
    assert bench.finish(slow).outcome is RecoveryOutcome.SUCCESS
