# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The safety mux as a process: topics, services, lifecycle, clocks, and what it refuses."""

from collections.abc import Callable, Iterator
import contextlib
from functools import partial
import math
from signal import SIGCONT, SIGSTOP, SIGTERM
from threading import Event
import time
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.srv import ChangeState
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter as Setting
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from bridge_core import clock, input_guard, lane
from bridge_core.cdr import bool_message
from bridge_core.lane import _settle
from bridge_core.watchdog import FreezeWatch
from safety_mux import services
from safety_mux.listening import ESTOP_QOS
from safety_mux.node import SafetyMux
from safety_mux.protocol import Decision, State
from stage.endings import each_ending
from stage.fed_mux import LIMIT, StepMux, TICK
from stage.mux_talkers import (
    MuxBench,
    NewMux,
    SILENCE_STOPS_WITHIN,
    sticks,
)
from stage.rig import latched, NodeProcess, Observer, wait_for
from stage.talkers import namespace, values_of

pytestmark = pytest.mark.waits(240)


@pytest.fixture(scope='module')
def shared() -> Iterator[MuxBench]:
    with Observer() as observer:
        result = MuxBench(observer)
        yield result
        result.close()


@pytest.fixture
def mux(shared: MuxBench) -> MuxBench:
    """Give a mux that is STOPPED by a stop that is over, with all inputs fresh and clear."""
    shared.joy.message = sticks()
    for talker in (shared.fort_estop, shared.fort_own_estop, shared.drive_estop):
        talker.message = Bool(data=False)
        talker.resume()
    shared.drive_enabled.message = Bool(data=True)
    shared.joy.resume()
    states = ('STOPPED', 'READY', 'ACTIVE')
    shared.wait(lambda: any(shared.says(state) for state in states), 'a state')
    if not shared.says('STOPPED'):
        shared.fort_estop.publisher.publish(Bool(data=True))
        shared.wait(lambda: shared.says('STOPPED'), 'STOPPED')
    return shared


def test_status_from_the_start_says_what_is_missing(new_mux: NewMux) -> None:
    mux = new_mux()
    for talker in (mux.fort_estop, mux.drive_estop, mux.drive_enabled, mux.joy):
        talker.pause()
    mux.wait(
        lambda: mux.explains("e-stop source 'fort'", "e-stop source 'drive'", 'call ~/reset'),
        'the reasons',
    )
    assert mux.status.last.level == DiagnosticStatus.WARN
    mux.wait(lambda: mux.estop.data and mux.enable.data, 'stop and enable')
    assert mux.estop.data[0] is True
    assert not any(mux.enable.data)
    values = values_of(mux.status.last)
    assert values['state'] == 'STOPPED'
    assert values['owner'] == 'none'
    assert values['stopped by'] == 'none'
    assert values['stops clear'] == values['trip active'] == 'false'
    assert values['operators at rest'] == 'true'  # none is heard
    assert values['drive enabled'] == 'false'
    assert values["condition of e-stop source 'fort'"] == 'silent'
    assert values["condition of operator 'fort'"] == 'silent'
    assert "age of e-stop source 'fort' (s)" in values
    assert 'the mux has started' in values['last transition']


def test_command_topics_are_never_transient_local(mux: MuxBench) -> None:
    for topic in ('command', 'enable'):
        (endpoint,) = mux.observer.node.get_publishers_info_by_topic(f'{mux.name}/{topic}')
        assert endpoint.qos_profile.durability == DurabilityPolicy.VOLATILE


def test_stop_that_was_lost_in_a_flood_of_messages_stops(mux: MuxBench) -> None:
    """
    More messages than the subscription keeps arrive while the mux is held up for an instant.

    Whether the stop is dropped, or taken before the rest pushes it out, is up to the middleware.
    """
    mux.active()
    mux.node.signal(SIGSTOP)
    mux.fort_estop.publisher.publish(Bool(data=True))
    for _ in range(3 * ESTOP_QOS.depth):
        mux.fort_estop.publisher.publish(Bool(data=False))
    mux.node.signal(SIGCONT)
    mux.wait(lambda: mux.says('STOPPED'), 'STOPPED')


def test_diagnostics_carry_another_level_at_once(
    monkeypatch: pytest.MonkeyPatch, step_mux: StepMux
) -> None:
    stepped = step_mux()
    mux = stepped.mux
    mux._publish_diagnostics(stepped.now)
    levels: list[Any] = []
    monkeypatch.setattr(mux, '_diagnostics', Publisher(levels, read=lambda m: m.status[0].level))
    assert stepped.reset().ok
    assert stepped.run(0.3) is State.READY
    stepped.stop = True
    assert stepped.run(0.3) is State.STOPPED
    mux._publish_diagnostics(stepped.now)
    mux._publish_status(stepped.now)
    good, bad = DiagnosticStatus.OK, DiagnosticStatus.WARN
    assert [level for _, level in levels] == [good, bad, bad]


def test_publisher_of_another_type_on_an_estop_topic_is_named(mux: MuxBench) -> None:
    with NodeProcess(source=_STRINGS.format(topic=f'{mux.space}/fort_vsc_bridge/estop')):
        mux.wait(lambda: mux.explains('publishes std_msgs/msg/String', 'not Bool'), 'it')
    mux.wait(lambda: mux.is_past('std_msgs/msg/String'), 'it is gone', 30.0)


_STRINGS = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import String
rclpy.init()
node = Node('stranger')
node.create_publisher(String, '{topic}', 10)
rclpy.spin(node)
"""


# Autonomy.


def test_autonomy_moves_after_it_was_selected(observer: Observer, new_mux: NewMux) -> None:
    mux = new_mux(autonomy__topic='cmd', autonomy__type='JointState')
    rest, motion = (
        JointState(name=['right', 'left'], velocity=speeds) for speeds in ([0.0, 0.0], [3.0, 1.0])
    )
    autonomy = mux.talker(JointState, 'cmd', rest)
    mux.ready()
    autonomy.message = motion
    observer.holds_for(lambda: not any(mux.command.last.velocity), 0.3)
    refused = mux.select_autonomy()
    assert not refused.success  # it has to have asked for zero
    autonomy.message = rest
    mux.wait(lambda: mux.explains('~/select_autonomy'), 'rested autonomy')
    assert mux.select_autonomy().success
    mux.wait(lambda: mux.says('ACTIVE'), 'ACTIVE')
    autonomy.message = motion
    mux.wait(lambda: list(mux.command.last.velocity) == [1.0, 3.0], 'left and right')
    assert mux.select_autonomy(False).success
    mux.wait(lambda: mux.says('READY') and not any(mux.command.last.velocity), 'READY')


# Lifecycle, signals, names.


def test_inactive_mux_says_stop_all_the_time_and_activation_is_stopped(
    observer: Observer, new_mux: NewMux
) -> None:
    mux = new_mux(autostart=False)
    mux.wait(lambda: len(mux.estop.messages) > 20 and mux.command.messages, 'outputs')
    assert mux.is_stopped()
    mux.wait(lambda: mux.explains('the mux is not active'), 'why')
    assert observer.state(mux.name) == 'unconfigured'
    assert observer.change_state(mux.name, 'configure')
    assert observer.change_state(mux.name, 'activate')
    mux.active()
    moment = time.monotonic()
    assert observer.change_state(mux.name, 'deactivate')
    mux.stopped_since(moment)
    assert not mux.reset().success
    since = time.monotonic()

    def repeated() -> bool:
        assert mux.is_stopped()
        return all(
            len(list(record.since(since))) > 10 for record in (mux.estop, mux.enable, mux.command)
        )

    mux.wait(repeated, 'outputs')
    assert observer.change_state(mux.name, 'activate')  # deadman and stick are still held
    observer.holds_for(mux.is_stopped, 0.5)
    mux.joy.message = sticks()
    mux.active()


def test_requests_that_cannot_be_are_refused_and_end_nothing(
    observer: Observer, new_mux: NewMux
) -> None:
    """Of whatever lifecycle manager or tool: rclpy would end the process by them."""
    mux = new_mux()
    mux.active()
    moment = time.monotonic()
    for number in (1, 3, 99):  # configure, activate, none
        change = ChangeState.Request()
        change.transition.id = number
        reply = observer.call(ChangeState, f'{mux.name}/change_state', change, tries=5)
        assert not reply.success
    strange = [Parameter(name='rate', value=ParameterValue(type=77))]
    for kind, service in (
        (SetParameters, 'set_parameters'),
        (SetParametersAtomically, 'set_parameters_atomically'),
    ):
        request = kind.Request(parameters=strange)
        observer.call(kind, f'{mux.name}/{service}', request, tries=5)
    assert observer.state(mux.name) == 'active'
    mux.wait(lambda: mux.says('ACTIVE'), 'the same as before')
    assert not any(message.data for _, message in mux.estop.since(moment))


@each_ending
def test_signal_mid_motion_puts_out_a_last_stop(new_mux: NewMux, number: int) -> None:
    mux = new_mux()
    mux.active()
    cause = time.monotonic()
    mux.node.signal(number)
    mux.wait(lambda: mux.node.process.poll() is not None, 'its end')
    assert mux.node.process.returncode == 0
    mux.wait(mux.is_stopped, 'a last stop')
    assert [e for _, e in mux.estop.since(cause)][-1].data


def test_restarted_mux_is_stopped_whatever_is_held(observer: Observer, new_mux: NewMux) -> None:
    mux = new_mux()
    mux.active()
    assert mux.node.end(SIGTERM) == 0
    mux.wait(mux.is_stopped, 'the last words of the first')  # later than all that it said
    moment = time.monotonic()
    mux.start()
    mux.wait(
        lambda: list(mux.enable.since(moment + 0.1)) and list(mux.command.since(moment + 0.1)),
        'its outputs',
    )
    observer.holds_for(lambda: mux.is_stopped() and mux.state.last.data == 'STOPPED', 0.5)
    mux.joy.message = sticks()
    mux.active()


# ROS time decides nothing.


def test_simulated_time_that_stands_or_jumps_changes_no_stop(
    observer: Observer, new_mux: NewMux
) -> None:
    mux = new_mux(use_sim_time=True)
    clock = observer.publisher(Clock, '/clock')
    mux.active()  # before there is any clock
    for seconds in (10_000, 10_000, 6_400, 13_600, 0, -1):  # on, stands, by an hour, no time
        clock.publish(Clock(clock=Time(sec=seconds)))
        observer.holds_for(lambda: mux.state.last.data == 'ACTIVE' or mux.held_up(), 0.1)
    assert any(mux.command.last.velocity) or mux.held_up()
    mux.node.wait_output('/clock: Traceback')  # rclpy's own callback knows no such time
    mux.joy.pause()
    clock.publish(Clock(clock=Time(sec=1)))
    mux.stopped_since(time.monotonic(), SILENCE_STOPS_WITHIN)


# What goes out, and who decides: in this process.


class Publisher:
    """Records what is published, in a story that several share."""

    def __init__(
        self,
        story: list[Any],
        name: str = '',
        read: Callable[[Any], Any] = lambda message: message == bool_message(True),
    ) -> None:
        self._story, self._name, self._read = story, name, read

    def publish(self, message: Any) -> None:
        self._story.append((self._name, self._read(message)))

    def get_subscription_count(self) -> int:
        return 1


@pytest.fixture
def own_mux(context: Any) -> Iterator[SafetyMux]:
    gated = Setting('operator.fort.gated_joy', value=True)
    mux = SafetyMux(context=context, namespace=namespace(), parameter_overrides=[gated])
    mux.asked.freeze = FreezeWatch(math.inf, 0.0)  # no executor looks
    mux.autostart()
    yield mux
    mux.destroy_node()


def test_stop_goes_out_before_all_else(own_mux: SafetyMux) -> None:
    story: list[Any] = []

    def decide(state: State) -> None:
        moves = state is State.ACTIVE
        owner = 'fort' if moves else None
        zero = (0.0, 0.0)
        decision = Decision(state, owner, moves, zero, not moves, {'fort': not moves}, owner)
        own_mux._arbiter.tick = lambda now: decision  # type: ignore[method-assign]
        own_mux._tick(clock.now())

    def play() -> None:
        gate = own_mux._gated_joys['fort']
        gate.hear_joy(sticks(deadman=True))
        decide(State.ACTIVE)
        for name in ('_estop', '_enable', '_state'):
            getattr(own_mux, name).publisher = Publisher(story, name)
        own_mux._stop_demands['fort'].publisher = Publisher(story, 'stop_demand')
        gate.publisher = Publisher(story, 'joy')
        for name in ('_command', '_status'):
            setattr(own_mux, name, Publisher(story, name))
        decide(State.STOPPED)

    own_mux.lane.call(play)
    names = [name for name, _ in story][:6]
    assert names == ['_estop', '_enable', '_command', 'stop_demand', 'joy', '_state']
    assert story[:2] == [('_estop', True), ('_enable', False)]


@pytest.mark.parametrize('moments', [(0.003, 0.005), (0.008, 0.012)])  # s; a tick is at 0.01
def test_stop_that_is_gone_before_the_next_tick_is_demanded_of_the_other_devices(
    step_mux: StepMux, moments: tuple[float, float]
) -> None:
    stepped = step_mux()
    mux = stepped.mux
    assert stepped.reset().ok
    assert stepped.run(0.1) is State.READY
    began = stepped.now
    story: list[Any] = []
    mux._stop_demands['fort'].publisher = Publisher(story, 'fort')
    drive = stepped.topic('estop.drive.topic')
    for at, value in sorted([(moments[0], True), (moments[1], False), (0.01, None), (0.02, None)]):
        stepped.now = began + at
        if value is None:
            mux._tick(stepped.now)
        elif drive.take(Bool(data=value), stepped.now):
            stepped.decide()
    assert mux._last_state is State.STOPPED
    assert ('fort', True) in story
    assert story[-1] == ('fort', False)


@pytest.mark.parametrize('silence', [LIMIT - 0.1, LIMIT + 0.1])
def test_lost_sticks_stop_once_they_are_missing_for_the_timeout(
    step_mux: StepMux, silence: float
) -> None:
    stepped = step_mux()
    assert stepped.reset().ok
    assert stepped.run(LIMIT + 0.1) is State.READY
    hear = next(
        each.callback
        for each in stepped.mux.lane._topics
        if each.subscription.topic_name.endswith('/joy')
    )
    stepped.joy = sticks(0.5, deadman=True)
    assert stepped.run(0.1) is State.ACTIVE
    hear(serialize_message(stepped.joy), {'publication_sequence_number': 1})
    stepped.joy = None
    stepped.run(silence)
    hear(serialize_message(sticks(0.5, deadman=True)), {'publication_sequence_number': 12})
    state = stepped.run(0.02)
    assert state is (State.ACTIVE if silence < LIMIT else State.STOPPED)


def test_stamp_that_stays_the_same_is_a_warning_where_it_need_not_move(step_mux: StepMux) -> None:
    mux = step_mux()
    for second in (1, 2):
        mux.joy.header.stamp = Time(sec=second)
        mux.run(0.1)
    assert 'warning 1' not in mux.values()
    assert mux.reset().ok
    assert mux.run(LIMIT + 0.1) is State.READY
    warning = mux.values()['warning 1']
    assert warning.startswith("operator 'fort' may be gone")
    assert 'its stamp has been the same for' in warning
    assert warning in mux.message()
    assert mux.mux._status_message(mux.now).level == DiagnosticStatus.WARN
    mux.joy.header.stamp = Time(sec=3)
    mux.run(0.1)
    assert 'warning 1' not in mux.values()


@contextlib.contextmanager
def hanging(mux: SafetyMux) -> Iterator[None]:
    """Have its lane hang meanwhile; who asks it for something is answered soon."""
    gate = Event()
    mux.lane.post(gate.wait)
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(lane, '_CALL_LIMIT', 0.1)
            yield
    finally:
        gate.set()


def test_mux_that_hangs_answers_that_nothing_was_done_and_does_what_stops_when_it_goes_on(
    own_mux: SafetyMux,
) -> None:
    """Whatever diagnostics say meanwhile."""
    asked = own_mux.asked
    with hanging(own_mux):
        trip = asked.on_trip(Trigger.Request(), Trigger.Response())
        deselection = asked.on_select_autonomy(SetBool.Request(), SetBool.Response())
        asked.on_select_autonomy(SetBool.Request(data=True), SetBool.Response())
        for response in (trip, deselection):
            assert not response.success
            assert 'it stops as soon as it goes on: nothing was done' in response.message
        trip_, select = [function for function, _ in own_mux.lane._calls if function != _settle]
        assert trip_ == own_mux._trip
        assert isinstance(select, partial)
        assert select.args == (False,)
        for service in (asked.on_reset, asked.on_end_trip):
            response = service(Trigger.Request(), Trigger.Response())
            assert not response.success
            assert 'nothing was done' in response.message
        waits = len(own_mux.lane._calls)
        name = f'{own_mux.get_namespace().lstrip("/")}/fort_vsc_bridge: device'
        level = DiagnosticStatus.ERROR
        status = [DiagnosticStatus(level=level, name=name, message=str(n)) for n in range(100)]
        for _ in range(100):
            own_mux._on_diagnostics(DiagnosticArray(status=status))
        assert len(own_mux.lane._calls) == waits + 1
        own_mux.shut_down()
        assert len(own_mux.lane._calls) > waits + 1  # the stop, for when it goes on

    def explained() -> bool:
        tripped = own_mux._arbiter.status(clock.now()).tripped
        return tripped and own_mux._arbiter.sources['fort'].device_words == '99'

    wait_for(lambda: own_mux.lane.call(explained), what='the trip, and the newest text')
    assert own_mux.lane.call(lambda: own_mux._last_state) is State.STOPPED


def reset_of(mux: SafetyMux) -> str:
    return str(mux.asked.on_reset(Trigger.Request(), Trigger.Response()).message)


def test_what_is_asked_right_after_a_hang_of_the_services_is_not_done_but_a_stop(
    step_mux: StepMux,
) -> None:
    stepped = step_mux(**{'autonomy.topic': 'plan', 'autonomy.type': 'JointState'})
    mux = stepped.mux
    mux.asked.look()
    stepped.run(5.0)
    assert 'frozen' in reset_of(mux)
    stepped.run(0.24)
    assert 'frozen' in reset_of(mux)
    assert 'frozen' in mux.asked.on_end_trip(Trigger.Request(), Trigger.Response()).message
    selection = mux.asked.on_select_autonomy(SetBool.Request(data=True), SetBool.Response())
    assert 'frozen' in selection.message
    stepped.run(0.02)
    assert reset_of(mux).startswith('reset: READY')
    mux.asked.look()
    stepped.run(5.0)
    assert mux.asked.on_select_autonomy(SetBool.Request(), SetBool.Response()).success
    assert mux.asked.on_trip(Trigger.Request(), Trigger.Response()).success
    assert stepped.run(0.02) is State.STOPPED


def test_reset_that_was_asked_for_before_the_services_run_is_not_done(step_mux: StepMux) -> None:
    assert 'frozen' in reset_of(step_mux().mux)


@pytest.mark.parametrize('hang', [4.5, 6.5])
def test_script_that_resets_for_ever_does_not_rearm_after_a_hang_of_the_services(
    step_mux: StepMux, hang: float
) -> None:
    stepped = step_mux()
    mux = stepped.mux

    def go_on(seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            mux.asked.look()
            stepped.run(0.1)

    go_on(1.0)
    assert reset_of(mux).startswith('reset')
    for _ in range(3):  # a script, from here on
        go_on(1.0)
        assert 'nothing to reset' in reset_of(mux)
    stepped.run(1.5)
    stepped.stop = True
    stepped.run(0.2)
    stepped.stop = False
    assert stepped.run(hang - 1.7) is State.STOPPED
    for _ in range(4):  # those that have waited
        assert not reset_of(mux).startswith('reset')
    for _ in range(8):
        go_on(0.5)
        assert 'resets have been called since before the stop' in reset_of(mux)


def test_hang_of_the_services_that_no_bridge_would_notice_refuses_nothing(
    step_mux: StepMux,
) -> None:
    stepped = step_mux()
    stepped.mux.asked.look()
    stepped.run(services.LOOK_PERIOD + input_guard._FREEZE - TICK)
    assert reset_of(stepped.mux).startswith('reset: READY')


def test_mux_that_hangs_says_nothing(own_mux: SafetyMux, observer: Observer) -> None:
    """Not even that all is well: a drive stops for silence. Afterwards it is stopped."""
    name = own_mux.get_fully_qualified_name()
    records = [
        observer.record(Bool, f'{name}/estop', latched()),
        observer.record(JointState, f'{name}/command'),
    ]
    observer.wait_for(lambda: all(len(each.times) > 3 for each in records), 15.0, 'both')
    gate, hangs = Event(), Event()
    own_mux.lane.post(hangs.set)
    own_mux.lane.post(gate.wait)
    try:
        observer.wait_for(hangs.is_set, what='it hangs')
        observer.holds_for(lambda: True, 0.1)  # what was on its way
        for each in records:
            each.clear()
        observer.holds_for(lambda: not any(each.times for each in records), 0.3)
    finally:
        gate.set()
    observer.wait_for(lambda: all(each.times for each in records), what='both again')
    assert all(records[0].data)
