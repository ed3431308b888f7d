# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Faults of every bring-up, each planted once and looked at four times.

The doctor, the bridge's own diagnostic, ~/status of the mux and the status page have to name the
same cause by its code, and what to do about it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
import errno
import importlib
import os
from pathlib import Path
import re
from typing import Any

import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
import serial
from std_msgs.msg import Bool

from bridge_core.diagnostics import to_msg
from bridge_core.reasons import Coded
from bridge_core.report import Damage, LinkStatus, Report, report, Status
from bridge_core.transports import TransportError
from fort_vsc_bridge.simulator import Simulator as Vsc
from rugged_teleop.devices import devices
from rugged_teleop.doctor.configuration import Configured
from rugged_teleop.doctor.findings import Finding
from rugged_teleop.doctor.graph import Endpoint, Graph, graph_findings, Said
from rugged_teleop.doctor.listening import device_findings, Heard
from rugged_teleop.doctor.networks import Filters, Group, group_findings
from rugged_teleop.doctor.ports import Holder, port_findings, PortFacts, User
from rugged_teleop.doctor.serial_lines import Line, line_findings
from rugged_teleop.reasons import catalogue
from rugged_teleop.status_page.model import Diagnostic
from safety_mux.device_words import DeviceWords
from safety_mux.report import report_of, Surroundings
from stage.captures import STREAMS
from stage.fed_mux import SteppedMux
from stage.page_rig import FORT, model, MUX
from stage.rig import wait_for
from stage.safety_mux_bench import Bench, CONFIG, HELD, OFF
from test.rugged_teleop.doctor.doctor_rig import counted, node, noise
from vm110_bridge.simulator import Simulator as BaseUnit

VSC = b''.join(STREAMS['fort_serial'])
SSC = b''.join(STREAMS['ssc'])
PORT = PortFacts('/dev/fort_vsc', '/dev/ttyUSB0', 0o660, 0, 20, 'dialout')
TICK = 0.02  # s
Two = tuple[Iterable[Finding], Report]  # what the doctor finds, and what the bridge reports


def texts(findings: Iterable[Finding]) -> str:
    return '; '.join(f'{each.text}: {each.remedy}' for each in findings)


class Ear:
    """The session of a configured bridge that hears something for two seconds."""

    def __init__(self, configured: Configured, spoken: Callable[[float], Sequence[Any]]) -> None:
        bridge = importlib.import_module(f'{configured.name}.wire').BRIDGE
        self.session = bridge.make_session(dict(configured.values))
        self.now, self.chunks = 0.0, []
        self.session.opened(self.now)
        while self.now < 2.0:
            self.now += TICK
            for chunk in spoken(self.now):
                self.chunks.append(chunk)
                self.session.receive(chunk, self.now)
            self.session.poll(self.now)

    def heard(self) -> Heard:
        stops = tuple(self.session.stop_reasons(self.now))
        return Heard(tuple(self.chunks), self.session.link_up, stops)

    def report(self) -> Report:
        port = LinkStatus(is_open=True, error='')
        return report(port, self.session, Damage(self.session.counters), {}, self.now)


def always(data: bytes) -> Callable[[float], Sequence[bytes]]:
    return lambda now: [data]


def commanded(device: Any, *commands: str) -> Callable[[float], Sequence[Any]]:
    for command in commands:
        device.apply(command)
    return device.poll  # type: ignore[no-any-return]


def closed(folder: Path, error: OSError) -> Report:
    """Return what a bridge says whose port gives this error."""
    configured = node(folder, 'fort_vsc_bridge', port=PORT.path)
    bridge = importlib.import_module('fort_vsc_bridge.wire').BRIDGE
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(serial, 'serial_for_url', lambda *_, **__: _raise(error))
        with pytest.raises(TransportError) as caught:
            bridge.make_transport(dict(configured.values)).open()
    session = bridge.make_session(dict(configured.values))
    port = LinkStatus(error=caught.value.reason)
    return report(port, session, Damage(session.counters), {}, 0.0)


def _raise(error: OSError) -> None:
    raise error


# The faults.


def wrong_baud(folder: Path) -> Two:
    vsc = node(folder, 'fort_vsc_bridge')
    ear = Ear(vsc, always(noise(VSC)))
    return line_findings([Line(vsc, ear.heard(), 'fort_serial', 57600)]), ear.report()


def wrong_baud_of_a_drive(folder: Path) -> Two:
    drive = node(folder, 'esi_drive_bridge')
    ear = Ear(drive, always(noise(b''.join(STREAMS['esi_status']))))
    return line_findings([Line(drive, ear.heard(), 'esi_status', 57600)]), ear.report()


def no_permission(folder: Path) -> Two:
    found = port_findings(PORT, User('robot', 1000, {1000}), '/fort_vsc_bridge')
    return found, closed(folder, OSError(errno.EACCES, os.strerror(errno.EACCES)))


def port_in_use(folder: Path) -> Two:
    facts = replace(PORT, mode=0o666, holders=(Holder(7, 'minicom'),))
    found = port_findings(facts, User('robot', 1000, {1000}), '/fort_vsc_bridge')
    return found, closed(folder, OSError(errno.EAGAIN, os.strerror(errno.EAGAIN)))


def swapped_ports(folder: Path) -> Two:
    vsc = node(folder, 'fort_vsc_bridge', port='/dev/a')
    ssc = node(folder, 'ssc_bridge', port='/dev/b')
    ear, other = Ear(vsc, always(SSC)), Ear(ssc, always(VSC))
    lines = [
        Line(vsc, ear.heard(), 'ssc', 115200),
        Line(ssc, other.heard(), 'fort_serial', 115200),
    ]
    assert 'that port is the SSC' in other.report().device.message
    return line_findings(lines), ear.report()


def dead_remote(folder: Path) -> Two:
    vsc = node(folder, 'fort_vsc_bridge')
    ear = Ear(vsc, commanded(Vsc(), 'radio off'))
    return device_findings(vsc, ear.heard()), ear.report()


def pressed_e_stop(folder: Path) -> Two:
    vsc = node(folder, 'fort_vsc_bridge')
    ear = Ear(vsc, commanded(Vsc(), 'estop remote on'))
    return device_findings(vsc, ear.heard()), ear.report()


def wrong_crc(folder: Path) -> Two:
    unit = node(folder, 'vm110_bridge', crc='mpeg2')
    ear = Ear(unit, commanded(BaseUnit(7, crc='iso_hdlc')))
    return list(group_findings(Group(unit, ear.heard()), Filters())), ear.report()


def wrong_byte_count(folder: Path) -> Two:
    ssc = node(folder, 'ssc_bridge')
    ear = Ear(ssc, always(counted(2)))
    return line_findings([Line(ssc, ear.heard())]), ear.report()


def wired_e_stop(folder: Path) -> Two:
    return of_vsc(folder, 'estop vsc on')


def of_vsc(folder: Path, *commands: str) -> Two:
    vsc = node(folder, 'fort_vsc_bridge')
    ear = Ear(vsc, commanded(Vsc(), *commands))
    return device_findings(vsc, ear.heard()), ear.report()


FAULTS = [
    # The words that doctor and bridge have, and the code that the bridge, ~/status and page have.
    (wrong_baud, 'baud', 'fort.link.garbled'),
    (wrong_baud_of_a_drive, 'baud', 'esi.link.garbled'),
    (
        no_permission,
        'no permission.*(group dialout|-aG dialout).*log in again',
        'port.no_permission',
    ),
    (port_in_use, 'in use by.*(end|close) that', 'port.in_use'),
    (swapped_ports, 'port', 'fort.link.garbled'),
    (dead_remote, 'switch the remote on', 'fort.estop.remote'),
    (pressed_e_stop, 'release the stop at SRC', 'fort.estop.remote'),
    (wired_e_stop, 'release the stop at VSC', 'fort.estop.wired'),
    (wrong_crc, 'set crc to auto', 'vm110.link.other_crc'),
    (wrong_byte_count, 'byte count.*manual|manual.*byte count', 'ssc.link.byte_count'),
]


@pytest.mark.parametrize(
    ('plant', 'words', 'code'), FAULTS, ids=[fault[0].__name__ for fault in FAULTS]
)
def test_fault_is_named_by_doctor_bridge_status_and_page_alike(
    plant: Callable[[Path], Two], words: str, code: str, tmp_path: Path
) -> None:
    found, said = plant(tmp_path)
    found = list(found)
    assert re.search(words, texts(found))
    assert {each.code for each in found if each.kind.startswith('device')} <= {code, LOST}
    why = said.device.message
    assert re.search(words, why)
    device = to_msg(said.device, 'fort_vsc_bridge: device', '')
    assert {pair.key: pair.value for pair in device.values}['code'] == code

    bench = Bench()
    bench.estops['fort'] = True
    heard = DeviceWords(bench.arbiter.explain)
    heard.listen('e-stop source', 'fort', f'{FORT}/estop')
    assert heard.hear_diagnostics([device])
    heard.pass_on(bench.now)
    bench.run(0.5)
    status = report_of(bench.arbiter.status(bench.now), AROUND, bench.now)
    assert f"e-stop source 'fort' demands a stop: {why}" in status.message.replace(
        f'/{FORT[1:]}/', '~/'
    )
    assert named_alike(status, code)

    page = model()
    page.estop(FORT, True, 1.0)
    for part, each in (('link', said.link), ('device', said.device)):
        page.diagnostic(f'{FORT[1:]}: {part}', Diagnostic(each.level, each.message, {}), 1.0)
    shown = page.snapshot(1.1, 1.0)
    (card,) = (each for each in shown['bridges'] if each['name'] == FORT)
    (event,) = (each for each in shown['events'] if 'demands a stop' in each['text'])
    assert card['device']['message'] == event['reason'] == why


@pytest.mark.parametrize('name', [name for name, each in devices().items() if each.reasons])
def test_device_that_is_silent_or_closed_is_named_by_its_code(name: str, tmp_path: Path) -> None:
    ear = Ear(node(tmp_path, name), lambda now: [])
    silent = ear.session.stop_reasons(ear.now)
    ear.session.closed(ear.now)
    for reasons in (silent, ear.session.stop_reasons(ear.now)):
        assert reasons
        assert all(isinstance(each, Coded) and each.code in catalogue() for each in reasons)


AROUND = Surroundings('', (), None, {}, {}, {}, None)
LOST = 'fort.remote.off'  # comes with a stop of the VSC


def named_alike(status: Status, code: str) -> bool:
    """Tell whether ~/status, doctor and page name this code first, in few words."""
    said = to_msg(status, 'safety_mux', '')
    values = {pair.key: pair.value for pair in said.values}
    assert values['code'] == code
    of_doctor = graph_findings(Graph([], [Said.of('safety_mux', 1, said.message, values)]))
    assert code in {each.code for each in of_doctor if each.kind in ('inhibit', 'source quiet')}
    page = model()
    page.status(MUX, values, 1.0)
    page.state(MUX, values['state'], 1.0)
    (now,) = page.snapshot(1.1, 1.0)['muxes'][0]['now']
    assert now['code'] == code
    assert now['steps']
    assert len(now['cause'].split()) < 10
    assert len(now['steps'][0].split()) < 10
    return True


def hold(bench: Bench, code: str) -> None:
    bench.arbiter.hold(Coded(code, 'x'))


# By what is done to a mux that is READY, or ACTIVE by 'fort' first.
OF_THE_MUX: list[tuple[str, Callable[[Bench], object], str]] = [
    ('ready', lambda bench: bench.estops.update(fort=None), 'mux.source.stale'),
    ('new', lambda bench: bench.estops.update(fort=True), 'mux.source.stop'),
    ('new', lambda bench: None, 'mux.reset.clearing'),
    ('ready', lambda bench: bench.samples.update(fort=None, senior=None), 'mux.operator.stale'),
    ('stopped', lambda bench: bench.samples.update(fort=OFF), 'mux.operator.busy'),
    ('ready', lambda bench: None, 'mux.operator.press'),
    ('stopped', lambda bench: None, 'mux.reset.due'),
    ('active', lambda bench: bench.arbiter.trip(bench.now), 'mux.trip.active'),
    ('active', lambda bench: bench.samples.update(fort=HELD), 'mux.owner.zero'),
    (
        'ready',
        lambda bench: bench.arbiter.set_invalid(
            'e-stop source', 'fort', 'x', Coded('input.doubled', 'x')
        ),
        'input.doubled',
    ),
    (
        'ready',
        lambda bench: bench.arbiter.set_invalid('operator', 'fort', 'x', '2 axes'),
        'mux.operator.invalid',
    ),
    (
        'ready',
        lambda bench: bench.arbiter.input_of('e-stop source', 'fort').prove(bench.now, bench.now),
        'mux.input.old',
    ),
    ('ready', lambda bench: hold(bench, 'mux.output.doubled'), 'mux.output.doubled'),
    ('ready', lambda bench: hold(bench, 'mux.inactive'), 'mux.inactive'),
]


@pytest.mark.parametrize(('before', 'plant', 'code'), OF_THE_MUX, ids=lambda each: str(each)[:20])
def test_fault_of_the_mux_is_named_by_status_doctor_and_page_alike(
    before: str, plant: Callable[[Bench], object], code: str
) -> None:
    bench = Bench(replace(CONFIG, autonomy=None))
    if before == 'stopped':
        bench.run(0.6)
    elif before != 'new':
        getattr(bench, before)()
    plant(bench)
    bench.run(0.4)
    status = report_of(bench.arbiter.status(bench.now), AROUND, bench.now)
    assert named_alike(status, code)


# What only the graph shows: the mux looks itself.


@pytest.fixture
def mux(context: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[SteppedMux]:
    result = SteppedMux(context, monkeypatch)
    yield result
    result.mux.destroy_node()


def inhibit(mux: SteppedMux, text: str) -> str:
    """Return the inhibit with this text, as of now; empty: there is none."""
    mux.mux._look_around(mux.now)
    mux.run(0.1)
    return next((each for each in mux.values().values() if re.search(text, each)), '')


def test_source_that_nobody_publishes_is_named_alike(mux: SteppedMux) -> None:
    topic = f'{mux.mux.get_namespace()}/esi_drive_bridge/estop'
    wired = Endpoint('/safety_mux', topic, 'std_msgs/msg/Bool', False)
    assert re.search(
        f'{topic}: nobody publishes it.*start its node, or correct the topic',
        texts(graph_findings(Graph([wired]))),
    )
    text = f'nobody publishes .*{topic}.*: start its node, or correct the topic'
    wait_for(lambda: inhibit(mux, text))
    assert 'mux.topic.unpublished' in mux.values().values()
    mux.mux.create_publisher(Bool, topic, 1)
    wait_for(lambda: not inhibit(mux, text), what='somebody publishes it')


def test_mismatch_of_qos_is_named_alike(mux: SteppedMux) -> None:
    topic = f'{mux.mux.get_namespace()}/fort_vsc_bridge/estop'
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    ends = [
        Endpoint('/site', topic, 'std_msgs/msg/Bool', True, best_effort),
        Endpoint('/safety_mux', topic, 'std_msgs/msg/Bool', False, QoSProfile(depth=1)),
    ]
    (found,) = (each for each in graph_findings(Graph(ends)) if each.kind == 'qos mismatch')
    assert re.search('best effort.*publish it reliable', texts([found]), re.IGNORECASE)
    mux.mux.create_publisher(Bool, topic, best_effort)
    text = f"source 'fort' is invalid: .* publishes {topic} best effort: make it reliable"
    wait_for(lambda: inhibit(mux, text))
    assert 'input.best_effort' in mux.values().values()
