# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The SSC bridge as a process of its own, on a pty with a simulated SSC."""

from collections.abc import Iterator
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from stage.node_bench import DEVICE, LINK
from stage.rig import Observer
from stage.ssc_bench import Bench, bench_of, new_simulator, position, SERVOS
from stage.talkers import Talker, values_of

pytestmark = pytest.mark.waits(45)


@pytest.fixture(scope='module')
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    patient = {'link_timeout': 1.0, 'command_timeout': 2.0, **SERVOS}
    with (
        Observer() as observer,
        bench_of(tmp_path_factory.mktemp('ssc'), observer, **patient) as bench,
    ):
        yield bench


@pytest.fixture
def bench(shared: Bench) -> Bench:
    """Return the shared bench with device and mux as at the beginning."""
    for line in ('clear', 'mute off', 'receiver on', 'link on', 'channel 1 1000'):
        shared.port.apply(line)
    for channel in range(2, 9):
        shared.port.apply(f'channel {channel} 1500')
    shared.estop_in.message = Bool(data=False)
    shared.estop_in.resume()
    shared.connect()
    shared.wait(lambda: shared.inputs.last.data[3] == 1500, 'the deadman let go of')
    return shared


@pytest.fixture
def servo(bench: Bench) -> Iterator[Talker]:
    """Command both servos, and see them obey."""
    talker = bench.talker(JointState, 'servo_command', position(pan=0.5, tilt=-1.0))
    bench.wait(lambda: bench.seen()['outputs_us'][:2] == [1700, 1000], 'the servos')
    yield talker
    talker.leave()


def silence(bench: Bench, talker: Talker) -> None:
    """Pause a talker, and see that the node has read the last that it said."""
    talker.pause()
    mark = f'mark {time.monotonic_ns()}'
    # Of all that it listens to, the node reads this last; such a refusal ends no command.
    bench.observer.publisher(KeyValue, f'{bench.name}/aux_outputs').publish(KeyValue(key=mark))
    bench.wait(lambda: mark in bench.value('last refusal', LINK), 'the mark')


# -- what comes -----------------------------------------------------------------------------------


def test_receiver_becomes_joy_and_raw_pulses(bench: Bench) -> None:
    for line in ('channel 2 2000', 'channel 3 1750', 'channel 4 1900', 'channel 5 off'):
        bench.port.apply(line)
    bench.wait(lambda: list(bench.joy.last.buttons) == [1], 'the deadman')
    turn, forward = bench.joy.last.axes
    assert turn == -1.0  # right is negative
    assert forward == pytest.approx((0.5 - 0.05) / 0.95)
    bench.wait(lambda: bench.inputs.last.data[4] >= 32768, 'the invalid pulse')
    assert list(bench.inputs.last.data[:4]) == [1000, 2000, 1750, 1900]


LOSSES = [  # what happens, what the diagnostic says, the command state, and whether it is a stop
    ('channel 3 off', 'forward invalid', '1 ms', False),
    ('receiver off', 'no signal', 'no signal', True),
    ('link off', '1.5 ms', '1.5 ms', True),  # the receiver holds all other channels
]


@pytest.mark.parametrize(('line', 'words', 'state', 'stop'), LOSSES)
def test_lost_control_is_no_joy(
    bench: Bench, line: str, words: str, state: str, stop: bool
) -> None:
    for each in ('channel 3 2000', 'channel 4 1900'):
        bench.port.apply(each)
    bench.wait(lambda: list(bench.joy.last.buttons) == [1], 'the deadman')
    bench.port.apply(line)
    bench.wait(lambda: list(bench.joy.last.buttons) == [0], 'neutral')
    assert not any(bench.joy.last.axes)
    bench.wait_stop(stop)
    bench.wait(lambda: bench.own_estop.last == Bool(data=stop), 'own_estop')
    bench.wait(lambda: bench.state.last == String(data=state), 'the state')
    bench.wait(lambda: words in bench.told(), 'the diagnostic')
    level = DiagnosticStatus.WARN if stop else DiagnosticStatus.ERROR
    assert bench.diagnostics.status(DEVICE).level == level
    for each in ('receiver on', 'link on', 'channel 1 1000'):
        bench.port.apply(each)
    bench.wait_stop(False)


def test_configuration_and_sources_are_shown(bench: Bench) -> None:
    bench.wait(lambda: bench.value('source of output 1') == 'SERIAL', 'the sources')
    assert bench.value('configuration ID') == '1'
    assert bench.value('pulse inputs') == '8'
    assert bench.value('aux 2') == 'Timer In (8us,+,+)'
    bench.port.apply('channel 1 2000')
    bench.wait(lambda: bench.value('source of output 2') == 'PIN 2 (nibble 1)', 'the sources')
    bench.wait(lambda: values_of(bench.sources.last)['output 2'] == 'PIN 2 (nibble 1)', 'them')
    bench.wait(lambda: bench.state.last == String(data='2 ms'), 'the state')


def test_auxiliary_inputs_in_si_units(bench: Bench) -> None:
    bench.wait(lambda: bench.aux.messages, 'any auxiliary inputs')
    bench.port.apply('signal 2 12000 4000')
    bench.port.apply('pulses 3 42')
    bench.wait(lambda: values_of(bench.aux.last).get('aux 3 pulses in total') == '42', 'pulses')
    bench.wait(lambda: values_of(bench.aux.last)['aux 2 frequency (Hz)'] == '62.500', 'the timer')
    values = values_of(bench.aux.last)
    assert values['aux 2 period (s)'] == '0.016000'
    assert values['aux 2 speed (rpm)'] == '3750.000'
    assert values['aux 1 level'] == 'high'


# -- what goes ------------------------------------------------------------------------------------


def test_servos_obey_within_their_limits(bench: Bench, servo: Talker) -> None:
    servo.message = position(pan=1.0)
    bench.wait(lambda: bench.seen()['outputs_us'][0] == 1900, 'the limit')
    bench.wait(lambda: bench.seen()['outputs_us'][1] == 0, 'tilt is released')
    bench.wait(lambda: bench.outputs.last.data[0] == 1900, 'message 12')


def test_request_of_any_size_is_refused_and_keeps_its_wire(bench: Bench, servo: Talker) -> None:
    def refused(text: str) -> None:
        bench.wait(lambda: text in bench.value('last refusal', LINK), f'{text}: the refusal')

    out = bench.observer.publisher(KeyValue, f'{bench.name}/aux_outputs')
    out.publish(KeyValue(key=','.join(['4.level'] * 9000), value=','.join(['high'] * 9000)))
    refused('bytes; 65536 are allowed')
    out.publish(KeyValue(key='x' * 50_000))
    refused('a key such as')
    assert bench.value('last refusal', LINK).count('x') < 100
    servo.message = position(**{f'{n:01000}': 1.0 for n in range(50)})
    refused('no servo')
    bench.wait(lambda: bench.seen()['outputs_us'][:2] == [1200, 0], 'the failsafe')
    assert bench.value('wire restarts', LINK) == '0'


def test_estop_in_brings_the_failsafe_and_forgets_commands(bench: Bench, servo: Talker) -> None:
    bench.estop_in.message = Bool(data=True)
    bench.estop_in.say()
    bench.wait(lambda: bench.seen()['outputs_us'][:2] == [1200, 0], 'the failsafe')
    bench.wait(
        lambda: bench.estop.last == Bool(data=False), 'estop false'
    )  # it is the mux's stop, not ours
    silence(bench, servo)
    bench.estop_in.message = Bool(data=False)
    bench.observer.holds_for(lambda: bench.seen()['outputs_us'][:2] == [1200, 0], 0.4, 'failsafe')
    servo.resume()
    bench.wait(lambda: bench.seen()['outputs_us'][0] == 1700, 'a new command')


def test_auxiliary_outputs_are_set_in_si_units_and_triggered(bench: Bench) -> None:
    out = bench.observer.publisher(KeyValue, f'{bench.name}/aux_outputs')
    for key, value in (('4.level', 'high'), ('5.pulse', '0.0015'), ('5.period', '0.02')):
        out.publish(KeyValue(key=key, value=value))
    shots = bench.seen()['aux'][5]['shots']
    out.publish(KeyValue(key='6.pulse', value='0.001'))
    out.publish(KeyValue(key='6.pulse,4.level', value='0.001,high'))

    def done() -> bool:
        aux = bench.seen()['aux']
        pulses = aux[4]['pulse_us'], aux[4]['period_us'], aux[5]['shots'] - shots
        return bool(aux[3]['pin']) and pulses == (1500, 20000, 2)

    bench.wait(done, 'the outputs')
    bench.estop_in.message = Bool(data=True)
    bench.wait(lambda: not bench.seen()['aux'][3]['pin'], 'undone by a stop')
    assert bench.seen()['aux'][4]['pulse_us'] == 0
    out.publish(KeyValue(key='4.level', value='high'))
    bench.wait(lambda: 'stopped' in bench.value('last refusal', LINK), 'the refusal')
    assert bench.seen()['aux'][5]['shots'] - shots == 2


# -- the lockout ----------------------------------------------------------------------------------


def test_lockout_on_start_and_by_service(observer: Observer, tmp_path: Path) -> None:
    simulator = new_simulator(lockouts=[True, False])
    with bench_of(tmp_path, observer, simulator, lockout_on_start=True, link_timeout=2.0) as bench:
        bench.connect()
        bench.wait(lambda: not bench.seen()['config_available'], 'the lockout')
        response = observer.call(Trigger, f'{bench.name}/lockout', tries=3)
        assert response.success
        assert 'locked out' in response.message


# -- the link -------------------------------------------------------------------------------------


def test_unplugged_is_a_stop_and_plugged_in_heals(bench: Bench, servo: Talker) -> None:
    bench.port.apply('unplug')
    bench.wait_stop(True)
    servo.pause()
    bench.wait(lambda: bench.diagnostics.status(LINK).level == DiagnosticStatus.ERROR, 'told')
    bench.port.apply('plug')
    bench.wait_stop(False)
    # The SSC itself has kept the last command; it must not stay in force.
    bench.wait(lambda: bench.seen()['serial_us'][:2] == [1200, 0], 'the failsafe')


def test_deactivated_leaves_the_failsafe(bench: Bench, servo: Talker) -> None:
    assert bench.observer.change_state(bench.name, 'deactivate')
    bench.wait_stop(True)
    bench.wait(lambda: bench.seen()['serial_us'][:2] == [1200, 0], 'the failsafe')
    # Names of which a running node has no parameters.
    for names in ('servos', 'axes', 'buttons'):
        done, why = bench.observer.set_parameter(bench.name, names, ['other'])
        assert (done, 'restart the node' in why) == (False, True), why
    assert bench.observer.change_state(bench.name, 'activate')
    bench.wait_stop(False)
