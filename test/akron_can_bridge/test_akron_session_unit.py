# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which unit the Akron session follows and where to, and what it makes of what that says."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math
from typing import Any

import pytest

from akron_can_bridge.protocol import (
    AddressAnnouncement,
    decode,
    DigitalOutputs,
    Fault,
    FaultStatus,
    Name,
    Output,
    Vista,
    VistaData,
    VistaPosition,
)
from akron_can_bridge.session import (
    Cause,
    DeviceChanged,
    FaultsChanged,
    FILTERS,
    LimitsChanged,
    OutputsChanged,
    Positions,
    Settings,
    UnitChanged,
)
from akron_can_bridge.session.finder import Finder
from akron_can_bridge.session.unit import Unit
from bridge_core.j1939 import CanFrame
from bridge_core.session import Level, StopChanged, Verdict
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    ef,
    faults,
    joystick,
    LINK_LIMIT,
    MOVE,
    moved,
    MOVING,
    NAME,
    name,
    NO_FAULTS,
    NOT_ENABLED,
    of,
    OTHER_ANNOUNCED,
    OTHER_PIN,
    OURS,
    OUTPUTS,
    PIN,
    POSITION,
    REST,
    Turning,
    UNIT,
    VERSIONS,
)

NOW = 100.0
OUR_PIN, OTHER = AddressAnnouncement(PIN), AddressAnnouncement(OTHER_PIN)
OUR_NAME = Name.from_data(NAME.data)
RENAMED = replace(OUR_NAME, function=OUR_NAME.function + 1)
STRANGE_NAME = Name(identity=1, manufacturer=0)
MANY = 32


def started() -> Finder:
    finder = Finder(Settings())
    finder.start(NOW)
    return finder


def test_unit_that_was_never_heard_has_no_type() -> None:
    assert Finder(Settings()).device_type == 0
    assert Finder(Settings(unit_address=UNIT, device_type=1032)).device_type == 1032


def test_new_start_forgets_the_devices() -> None:
    finder = started()
    finder.announced(0x81, OTHER, NOW)
    assert finder.devices == {OTHER_PIN: 0x81}
    finder.start(NOW + 1.0)
    assert finder.devices == {}


@pytest.mark.parametrize(
    ('asked', 'name', 'after', 'restarted'),
    [
        (False, OUR_NAME, 0.0, True),
        (True, OUR_NAME, 1.0, False),
        (True, OUR_NAME, 1.0 + 1e-6, True),
        (False, STRANGE_NAME, 0.0, False),
    ],
)
def test_claim_within_a_second_of_a_request_is_its_answer_and_no_restart(
    asked: bool, name: Name, after: float, restarted: bool
) -> None:
    finder = started()
    finder.announced(UNIT, OUR_PIN, NOW)
    if asked:
        finder.request_sent(NOW)
    finder.expect_reset()
    finder.claimed(UNIT, name, NOW + after)
    assert finder.is_back(OUR_PIN, NOW + 9.0) is restarted


def test_unit_of_a_session_before_is_the_only_one() -> None:
    finder = started()
    assert not finder.keep('')
    assert not finder.keep(PIN)
    finder.announced(0x81, AddressAnnouncement(OTHER_PIN), NOW)
    assert finder.unit is None
    finder.announced(UNIT, OUR_PIN, NOW)
    assert not finder.keep('')
    assert finder.keep(OTHER_PIN)
    assert finder.pin == OTHER_PIN
    finder.announced(UNIT, OUR_PIN, NOW)
    assert finder.unit is None


def test_unit_of_a_session_before_does_not_overrule_the_pin_that_is_given() -> None:
    finder = Finder(Settings(device_pin=PIN))
    assert not finder.keep(OTHER_PIN)
    assert finder.pin == PIN


def test_so_many_devices_are_remembered_and_followed_and_no_more() -> None:
    finder = started()
    pins = [f'1032AE{number:09}' for number in range(MANY + 1)]
    for address, pin in enumerate(pins):
        finder.announced(0x40 + address, AddressAnnouncement(pin), NOW)
    assert list(finder.devices) == pins[:MANY]
    finder.announced(0xA0, AddressAnnouncement(pins[5]), NOW)
    assert finder.devices[pins[5]] == 0xA0


def test_without_a_unit_there_are_no_rivals() -> None:
    finder = Finder(Settings(device_type=1042))
    finder.start(NOW)
    finder.announced(UNIT, OUR_PIN, NOW)
    assert finder.unit is None
    assert finder.devices
    assert finder.rivals() == []
    assert not finder.alone


# -- which address it has -------------------------------------------------------------------------

# Devices announce their PIN (ours, other, twin) or claim an address by a OUR_NAME.
PINS = {'ours': OUR_PIN, 'other': OTHER, 'twin': AddressAnnouncement('1032CE100801035')}
NAMES = {
    'Name': OUR_NAME,
    'Twin': replace(OUR_NAME, function_instance=1),  # the same identity number
    'Renamed': RENAMED,
    'Neighbour': replace(OUR_NAME, identity=OUR_NAME.identity + 1),
    'Stranger': replace(OUR_NAME, manufacturer=0),
}
AT = f'unit {PIN} is at address'
LOST = f'unit {PIN} has lost address 80'
TO_ANOTHER, CLAIMS_ANOTHER = f'{LOST} to another device', f'{LOST} and claims another'
# What is heard, the address then, and what was told of it.
STORIES: list[tuple[str, int | None, list[str]]] = [
    ('ours@80 ours@82 ours@82', 0x82, [f'{AT} 80', f'{AT} 82']),
    ('ours@FE', None, []),
    ('ours@80 Name@80 Stranger@81', 0x80, [f'{AT} 80']),
    ('ours@80 Name@80 Renamed@80', None, [f'{AT} 80', TO_ANOTHER]),
    ('ours@80 Neighbour@80', None, [f'{AT} 80', TO_ANOTHER]),
    ('ours@80 Stranger@80', None, [f'{AT} 80', TO_ANOTHER]),
    ('ours@80 Stranger@80 Name@80 ours@80', 0x80, [f'{AT} 80', TO_ANOTHER, f'{AT} 80']),
    ('ours@80 other@80', None, [f'{AT} 80', f'{LOST} to {OTHER_PIN}']),
    ('ours@80 Name@91', None, [f'{AT} 80', CLAIMS_ANOTHER]),
    ('ours@80 Name@FE', None, [f'{AT} 80', CLAIMS_ANOTHER]),  # it cannot claim any
    ('ours@80 Renamed@90', None, [f'{AT} 80', CLAIMS_ANOTHER]),
    ('ours@80 Renamed@90 ours@80 Name@80', 0x80, [f'{AT} 80', CLAIMS_ANOTHER, f'{AT} 80']),
    ('Name@80 restart ours@80 Renamed@80', 0x80, [f'{AT} 80']),
    ('Name@80 ours@80 Twin@91 twin@91', 0x80, [f'{AT} 80']),
    ('ours@80 twin@91 Name@91', 0x80, [f'{AT} 80']),
    ('Name@80 ours@80 Twin@80 ours@80 Twin@80', 0x80, [f'{AT} 80', TO_ANOTHER, f'{AT} 80']),
]
# The same where the unit is at an address that is given.
FIXED: list[tuple[str, int | None, list[str]]] = [
    ('ours@80 ours@80 other@81 ours@91 Name@91', 0x80, [f'{AT} 80']),
    ('other@81 Stranger@80 Name@90', None, ['unit at 80 has lost address 80 to another device']),
    ('Stranger@80 Name@80', 0x80, ['unit at 80 has lost address 80 to another device']),
    ('Stranger@90 Name@90', 0x80, []),
    ('ours@80 other@80 Name@80', None, [f'{AT} 80', f'{LOST} to {OTHER_PIN}']),
]


@pytest.mark.parametrize(
    ('options', 'story', 'address', 'told'),
    [
        *(({}, *row) for row in STORIES),
        *(({'unit_address': UNIT, 'device_type': 1032}, *row) for row in FIXED),
    ],
)
def test_address_is_followed_and_told_on_change(
    options: dict[str, Any], story: str, address: int | None, told: list[str]
) -> None:
    finder = Finder(Settings(**options))
    finder.start(NOW)
    texts = []
    for word in story.split():
        what, _, at = word.partition('@')
        if what == 'restart':
            finder.start(NOW)
        elif what in PINS:
            texts.append(finder.announced(int(at, 16), PINS[what], NOW))
        else:
            texts.append(finder.claimed(int(at, 16), NAMES[what], NOW))
    assert (finder.address, [text for text in texts if text]) == (address, told)


NAME_REQUEST = CanFrame(0x18EAFF38, bytes.fromhex('00EE00'))  # the manual's, from address 38
STRANGER = '0100000000000000'  # a NAME that is not Akron Brass's


def name_requests(bench: Bench, since: float = 0.0) -> list[float]:
    return [at for at, frame in bench.sent if frame == NAME_REQUEST and at >= since]


# -- finding it -----------------------------------------------------------------------------------


def test_name_request_goes_out_at_the_start_and_every_second_while_nothing_is_heard() -> None:
    bench = Bench()
    bench.open()
    assert name_requests(bench) == [100.0]
    bench.wait(10.0)
    assert len(name_requests(bench)) == 10
    bench.take(ANNOUNCED)
    start = bench.now
    bench.run(3.0)
    assert name_requests(bench, start) == []
    bench.wait(5.0)
    assert 4 <= len(name_requests(bench, start)) <= 5


@pytest.mark.parametrize(
    ('options', 'unit'),
    [
        ({}, 0x80),
        ({'device_type': 0}, 0x80),
        ({'device_pin': OTHER_PIN}, 0x81),
        # Its highest bit counted, as the printed example does not: 26021A0B hex.
        ({'device_pin': '1032AE637671947'}, 0x80),
        ({'device_pin': OTHER_PIN, 'device_type': 1040}, 0x81),
        ({'device_type': 1052}, None),
        ({'device_pin': '1032AE100801037'}, None),
    ],
)
def test_choice_by_pin_or_type(options: dict[str, Any], unit: int | None) -> None:
    bench = Bench(**options)
    bench.open()
    bench.take(ANNOUNCED, OTHER_ANNOUNCED)
    assert bench.session.finder.address == unit
    if unit is None:
        reason = bench.session.stop_reasons(bench.now)[0]
        assert f'heard instead: {PIN}, {OTHER_PIN}' in reason


# -- moving it ------------------------------------------------------------------------------------


def test_readdressed_in_the_midst_of_motion_it_goes_on() -> None:
    bench = Bench(soe_permissive=True).moving()
    events = bench.take(moved(ANNOUNCED, 0x90))
    assert of(UnitChanged, events) == [UnitChanged(f'unit {PIN} is at address 90', PIN, 1032)]
    start = bench.now + 1e-9
    for _ in range(10):
        bench.wait(0.02)
        bench.take(moved(OUTPUTS, 0x90))
        bench.estop_in(False)
        bench.command(MOVE)
    assert not bench.session.estop
    assert set(bench.joystick_frames(start)) == {MOVING}
    assert bench.asked(start, 0x90) != []
    assert bench.asked(start, 0x80) == []
    assert bench.session.finder.moves == 1


@pytest.mark.parametrize(
    ('frame', 'text'),
    [
        (name(STRANGER, 0x80), 'to another device'),
        (moved(OTHER_ANNOUNCED, 0x80), f'to {OTHER_PIN}'),
    ],
)
def test_lost_address_is_not_believed_and_names_asked_for(frame: CanFrame, text: str) -> None:
    bench = Bench().play('find; 0.5 rest')
    start = bench.now
    (lost,) = of(UnitChanged, bench.take(frame))
    assert lost == UnitChanged(f'unit {PIN} has lost address 80 {text}', PIN, 1032)
    assert name_requests(bench, start) == [start]
    bench.take(NOT_ENABLED)  # whoever that is now
    assert not bench.session.estop
    bench.wait(LINK_LIMIT)
    assert bench.session.estop
    assert 'has no address at present' in bench.session.stop_reasons(bench.now)[0]
    bench.take(moved(ANNOUNCED, 0x85), moved(OUTPUTS, 0x85), moved(NO_FAULTS, 0x85))
    assert not bench.session.estop
    assert bench.session.finder.moves == 1


def test_claims_on_and_on_do_not_make_us_flood_the_bus() -> None:
    bench = Bench().find_unit()
    start = bench.now
    for _ in range(1000):
        bench.take(name(STRANGER, 0x80))
        bench.take(ANNOUNCED)
        bench.now += 0.001
    assert 5 <= len(name_requests(bench, start)) <= 11


VISTA = (VistaData(240, 0, 0, Vista(0)), VistaPosition(1, 2))

# -- stops ----------------------------------------------------------------------------------------


MINI: dict[str, Any] = {'device_type': 1033, 'source_address': 0x38}
AT_90: dict[str, Any] = {'unit_address': 0x90}
PADDED = 'open; say unit; ' + 10 * 'wait 0.1; say 83C051FFFFFFFFFF; '
HEALTH: list[tuple[dict[str, Any], str, str]] = [  # settings, what happens, why it is a stop
    ({}, 'open', 'no unit was found (wanted: 6032 Universal II)'),
    ({}, 'open; say unit', 'faults are not known'),
    ({}, 'open; say unit outputs', 'faults are not known'),
    ({}, 'open; say unit well', 'enable input is not known'),
    ({}, 'find', ''),
    ({}, 'find; say disabled', 'enable input is not asserted'),
    ({}, f'find; {4 * "wait 0.1; say 011D940371000041; "}', 'enable input is not known'),
    ({}, 'find; say 011D940371000045; 1.5 rest', 'faults are not known'),
    ({}, 'find; say 011D940371000045; 1.5 rest; say well', ''),
    ({}, PADDED, f'the firmware of unit {PIN}'),
    ({}, PADDED, 'type 83 cannot have 8 bytes'),
    ({}, f'{PADDED}wait 1', 'it is silent'),
    (AT_90, 'open', 'check power and CAN wiring of unit at 90'),
    (AT_90, 'open; say outputs well', 'unit at 90'),  # that was somebody else
    (AT_90, 'open; say outputs@90 well@90', ''),
    (AT_90, 'open; say outputs@90 well@90 disabled@90', 'not asserted'),
    # A Mini Universal tells its fault itself, by type 84; what others say does not count.
    (MINI, 'open; say FF83150266021A0B@81', 'no digital outputs (type 84) come'),
    (MINI, 'open; say FF83150266021A0B@81 848002@81', ''),
    (MINI, 'open; say FF83150266021A0B@81 84C000@81', 'device faulted'),
    (MINI, 'open; say FF83150266021A0B@81 848002@82 848002@81 84C000@82', ''),
    (MINI, 'open; say FF83150266021A0B@81 848002@81 FF83150266021A0B@90 84C000@90', 'faulted'),
]


@pytest.mark.parametrize(('options', 'script', 'reason'), HEALTH)
def test_health_of_a_unit(options: dict[str, Any], script: str, reason: str) -> None:
    bench = Turning(**options).play(script)
    assert bench.session.estop is bool(reason)
    assert reason in '; '.join(bench.session.stop_reasons(bench.now))


# Bits 1 to 5 of the manual's table are the motor axes.
@pytest.mark.parametrize('bit', range(7))
def test_faults_of_motor_axes_alone_are_a_stop(bit: int) -> None:
    bench = Bench().find_unit()
    (event,) = of(FaultsChanged, bench.take(faults(1 << bit, 11)))
    assert 'pCode error code 11 (rotation sensor error)' in event.faults[0]
    reasons = bench.session.stop_reasons(bench.now)
    assert [f'motor axis {bit} fault' in reason for reason in reasons] == [True] * (1 <= bit <= 5)


def turn(bench: Bench, seconds: float) -> None:
    """Have the unit report that it turns by 10 degrees a second."""
    for step in range(round(seconds / 0.1)):
        bench.wait(0.1)
        bench.take(OUTPUTS, ef(f'01{10 * step << 4 | 4:04X}0000000041'))


@pytest.mark.parametrize('cause', Cause)
def test_cause_that_is_not_listed_is_no_stop_but_is_known(cause: Cause) -> None:
    frames = {
        Cause.ENABLE: [NOT_ENABLED],
        Cause.MOTOR_FAULT: [faults(2)],
        Cause.FOREIGN_JOYSTICK: [joystick()],
        Cause.LINK: [],
        Cause.MOTION: [],
    }
    alone = Bench(estop_on=frozenset({cause})).find_unit()
    without = Bench(estop_on=frozenset(set(Cause) - {cause})).find_unit()
    for bench in (alone, without):
        bench.take(*frames[cause])
        if cause is Cause.MOTION:
            turn(bench, 1.5)
    if cause is Cause.LINK:
        alone.wait(1.0)
        assert alone.session.estop
        return
    assert alone.session.estop
    assert not without.session.estop
    assert list(without.session.causes(without.now)) == [cause]
    assert 'no stop: estop_on' in without.session.warnings(without.now)[0]


@pytest.mark.parametrize('counted', [frozenset(Cause), frozenset({Cause.FOREIGN_JOYSTICK})])
def test_discarded_input_is_a_stop_whichever_cause_counts(counted: frozenset[Cause]) -> None:
    bench = Bench(estop_on=counted).moving()
    bench.now += 0.001  # within a slot
    bench.session.interrupted('this node was held up', bench.now)
    start = bench.now
    events = bench.poll()
    assert events[0] == StopChanged(Verdict(True, True, False))
    assert bench.session.stop_reasons(bench.now) == ['this node was held up']
    assert bench.all_neutral(start)
    bench.wait(LINK_LIMIT)
    assert bench.session.estop == (Cause.LINK in counted)
    bench.take(OUTPUTS)  # nobody knows any more who that is
    assert not bench.session.link_up
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    assert not bench.session.estop
    assert bench.all_neutral(start)


# -- what is told ---------------------------------------------------------------------------------


def test_positions_are_the_manuals_in_rad_and_none_without_a_sensor() -> None:
    bench = Bench().find_unit()
    (event,) = of(Positions, bench.take(POSITION))
    assert event.rotation == pytest.approx(math.radians(47.3))
    assert event.elevation == pytest.approx(math.radians(-5.5))
    (event,) = of(Positions, bench.take(ef('01000F0371000041')))
    assert event.rotation is None


def test_limits_are_told_on_change_and_when_they_cease() -> None:
    bench = Bench().find_unit()
    frames = (POSITION, ef('81FED401C280'), ef('82FF38038400'))
    told = of(LimitsChanged, bench.take(*frames))[-1]
    assert told.rotation is not None
    assert (told.rotation.left_deg, told.rotation.right_deg) == (-30.0, 45.0)
    assert told.elevation is not None
    assert (told.elevation.down_deg, told.elevation.up_deg) == (-20.0, 90.0)
    assert of(LimitsChanged, bench.take(*frames)) == []
    assert of(LimitsChanged, bench.wait(1.0)) == [LimitsChanged()]


def test_outputs_and_inputs_are_told_with_those_of_the_neighbours() -> None:
    bench = Bench().find_unit()
    (first,) = of(OutputsChanged, bench.events)
    assert first == OutputsChanged(DigitalOutputs.from_bytes(OUTPUTS.data))
    assert first.outputs is not None
    assert Output.PANEL_LED in first.outputs.outputs
    # The manual's, from a 6033 at 81 and a 6039 at D0.
    bench.take(OUTPUTS, ef('848002', 0x81), ef('8501', 0xD0))
    told = of(OutputsChanged, bench.events)[-1]
    assert told.mini is not None
    assert told.inputs is not None
    # A second one of each is not mixed in while the first one is there.
    assert of(OutputsChanged, bench.take(ef('844000', 0x82), ef('8504', 0xD1))) == []
    bench.wait(0.2)
    bench.take(OUTPUTS)
    bench.wait(0.2)
    bench.take(OUTPUTS, ef('844000', 0x82))
    assert of(OutputsChanged, bench.events)[-1].mini is not None


# -- noise ----------------------------------------------------------------------------------------


def test_counters_tell_malformed_from_unknown_and_from_what_is_not_ours() -> None:
    bench = Bench().find_unit()
    counters = bench.session.counters
    before = (counters.frames, bench.session.decoder.other_frames)
    size = counters.bytes
    bench.take(ef('8300'), ef('77'), ef('0100', source=0x55), CanFrame(0x18FEF100, b'\0'))
    bench.take(ef('41', destination=0x05))
    assert counters.malformed == 1
    # Another maker's, whose first byte happens to be that of an announcement, of 84, of 85.
    bench.take(ef('FF01', 0x55), ef('8400000000', 0x55), ef('85', 0x55), ef('FF', 0x55))
    assert counters.malformed == 1
    assert counters.unknown_types == 1
    assert (counters.frames - before[0], bench.session.decoder.other_frames - before[1]) == (9, 7)
    assert counters.bytes - size == 16


def test_filters_pass_all_that_is_taken_and_hardly_more() -> None:
    def passes(frame: CanFrame) -> bool:
        return any(not (frame.identifier ^ identifier) & mask for identifier, mask in FILTERS)

    name_request = CanFrame(0x18EAFF37, bytes.fromhex('00EE00'))
    ours = [ANNOUNCED, NAME, POSITION, OUTPUTS, NO_FAULTS, joystick(), joystick(pgn=0xFDD7)]
    ours.append(name_request)
    assert all(passes(frame) for frame in ours)
    assert all(passes(CanFrame(frame.identifier & 0x03FFFFFF, b'')) for frame in ours)
    assert all(passes(moved(frame, source)) for frame in ours for source in range(256))
    others = (joystick(pgn=0xFDD8), CanFrame(0x18FEF100, b''))
    assert not any(passes(frame) for frame in others)


# -- settings -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    'options',
    [
        {'source_address': 0x32},
        {'source_address': 0x39},
        {'joy_source': 0x12},
        {'joy_source': 0x38},
        {'allowed_joysticks': frozenset({0})},
        {'allowed_joysticks': frozenset({0x38})},
        {'device_pin': '1032'},
        {'device_pin': 'A032AE100801035'},
        {'device_pin': '1032\x00\x00100801035'},
        {'device_pin': '1035AE100801035'},  # a joystick
        {'device_type': 1035},
        {'link_timeout': math.nan},
    ],
)
def test_settings_that_cannot_be_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options)).split('_')[0]):
        Settings(**options)


# -- what is known of a unit that was lost --------------------------------------------------------


def known() -> Unit:
    """Return what has heard all that is kept: faults, versions and Vista data."""
    unit = Unit(LINK_LIMIT)
    unit.faults = FaultStatus(Fault(0), 0)
    for frame in VERSIONS:
        assert not unit.versions_known
        unit.keep(decode(frame).message, 0.0)  # type: ignore[arg-type]
    for message in VISTA:
        unit.keep(message, 0.0)
    return unit


@pytest.mark.parametrize('lose', [Unit.lost, Unit.forget_state])
def test_lost_unit_keeps_its_versions_alone(lose: Callable[[Unit], None]) -> None:
    unit = known()
    assert all(unit.kept(type(message)) == message for message in VISTA)
    lose(unit)
    assert unit.versions_known
    assert unit.faults is None
    assert not any(unit.kept(type(message)) for message in VISTA)


def told(*frames: CanFrame, **options: Any) -> Sequence[str]:
    bench = Bench(**options).find_unit()
    bench.take(*frames)
    return bench.session.warnings(bench.now)


WARNINGS: dict[str, tuple[list[CanFrame], dict[str, Any]]] = {
    'another device (NAME 0000000000000001) claims our own': (
        [name('0100000000000000', OURS)],
        {},
    ),
    f'{OTHER_PIN} would do as well as {PIN}': ([OTHER_ANNOUNCED], {}),
    'the joystick at joy_source reports x error': (
        [joystick('127D046400100000')],
        {'joy_source': 0x33, 'allowed_joysticks': frozenset({0x33})},
    ),
    'SOE mode is active': ([ef('83C851')], {}),
    'move the stick to give the SOE permission': ([ef('83C851')], {'soe_permissive': True}),
    'the unit is in setup mode, or may be; call ~/reset': ([ef('46', destination=OURS)], {}),
    'a message is not as in the manual: type 83 cannot': ([ef('83C051FFFFFFFFFF')], {}),
    'the unit is not calibrated': ([ef('011D940371000040')], {}),
    'the rotation position is in error': ([ef('011D9A0371000041')], {}),
    'the elevation position is in error': ([ef('011D94037A000041')], {}),
    'faults: internal fuse blown; pCode error code 0': ([faults(1 << 21)], {}),
    'faults: none; pCode error code 11 (rotation sensor error)': ([faults(0, 11)], {}),
}


@pytest.mark.parametrize('text', WARNINGS)
def test_each_cause_has_its_sentence(text: str) -> None:
    frames, options = WARNINGS[text]
    (warning,) = told(*frames, **options)
    assert warning.startswith(text)


def test_who_the_unit_is_and_who_claims_our_address_is_told_on_change() -> None:
    bench = Bench()
    bench.open()
    bench.take(NAME, ANNOUNCED, ANNOUNCED, NAME)
    bench.take(*(name('0100000000000000', at) for at in (OURS, 0x99)))  # it gives way
    known = DeviceChanged(PIN, 1032, 0x80, Name.from_bytes(NAME.data))
    assert of(DeviceChanged, bench.events) == [known, replace(known, namesake=Name(1, 0)), known]


def test_what_is_asked_for_is_no_warning() -> None:
    assert told(soe_permissive=True) == []
    assert told(OTHER_ANNOUNCED, device_pin=PIN) == []
    # Not available is not broken: there are units without sensors and calibration.
    assert told(ef('01000F000F000043')) == []


def test_stale_input_is_a_warning_and_a_command_that_is_held_none() -> None:
    bench = Bench().find_unit()
    assert (Level.WARN, 'an input is stale') in bench.session.problems(bench.now)
    bench.run(0.2, REST, estop=True)
    assert bench.session.problems(bench.now) == []
    bench.run(0.3, REST, estop=None)
    assert bench.session.problems(bench.now) == [(Level.WARN, 'an input is stale')]


def test_figures_of_motion() -> None:
    bench = Bench().moving()
    assert bench.session.values(bench.now)['motion commanded'] is True
    assert bench.session.values(bench.now)['neutral because'] == 'commands go out'
    bench.estop_in(True)
    bench.command(MOVE)
    found = bench.session.values(bench.now)
    assert found['motion commanded'] is False
    assert found['neutral because'] == 'e-stop input is true; last stop: e-stop input is true'
    bench.command(REST)


# By hand: voltage 512, digital output 1 and digital input 1 on, X 100, Y 3, all else 0.
VISTA_DATA = ef(f'21{512 << 46 | 1 << 41 | 1 << 32 | 100 << 22 | 3 << 6:014X}', destination=OURS)
TURNS = [ef(f'01{degrees}40371000041') for degrees in ('1D9', '1E3', '1ED')]  # 47.3, 48.3, 49.3
ALLOWED = {'allowed_joysticks': frozenset({0x35})}
KNOWN = [ANNOUNCED, *VERSIONS, NO_FAULTS]
STICKS = [ANNOUNCED, OTHER_ANNOUNCED, joystick(), joystick(source=0x35)]
TWO = f'other Akron Brass devices = {OTHER_PIN} at 81 (6032 Universal II)'
FIGURES: list[tuple[dict[str, Any], list[CanFrame], str]] = [  # settings, what is heard, figures
    ({}, [], 'unit = not found yet | address = none | source address = 38'),
    ({}, [], 'versions = not known | faults = not known'),
    ({}, KNOWN, f'unit = {PIN} | type = 6032 Universal II | address = 80'),
    (
        *({}, KNOWN),
        'versions = fixed boot 1.11, bootloader 2.4, system 2.6; style 3356, subtype 14, '
        'pCode 2.4; config type 60320014, config 2.4',
    ),
    ({}, KNOWN, 'faults = faults: none; pCode error code 0 (none)'),
    ({}, KNOWN, 'motion commanded = False | motion reported = none'),
    ({}, KNOWN, 'other Akron Brass devices = none | joysticks heard = none'),
    ({}, STICKS, TWO),
    (ALLOWED, STICKS, 'joysticks heard = 33 foreign, 35 allowed'),
    ({'device_pin': '1032AE100801037'}, [OTHER_ANNOUNCED], TWO),
    ({'unit_address': 0x90}, [moved(OUTPUTS, 0x90)], 'unit = at 90 | type = 6032 Universal II'),
    ({}, [ANNOUNCED, *TURNS], 'motion reported = moves'),
    (
        *({}, [ANNOUNCED, VISTA_DATA, ef('2212345678', destination=OURS)]),
        'Vista: system voltage (raw) = 512 | Vista: joystick X, Y (raw) = 100, 3 | '
        'Vista: on = digital output 1, digital input 1 | '
        f'Vista: rotation, elevation (raw) = {0x1234}, {0x5678}',
    ),
    ({}, [ANNOUNCED, ef(f'21{"00" * 7}', destination=OURS)], 'Vista: on = none'),
    (
        *({}, [ANNOUNCED, ef('FE413F0D0A', destination=OURS), ef('FD01000000')]),
        r"ASCII pipe = 'A?\r\n' | diagnostic data = type 01: 00 00 00",
    ),
]


@pytest.mark.parametrize(('options', 'frames', 'figures'), FIGURES)
def test_figures(options: dict[str, Any], frames: list[CanFrame], figures: str) -> None:
    bench = Bench(**options)
    bench.open()
    for frame in frames:
        bench.take(frame)
        bench.wait(0.1)
    found = bench.session.values(bench.now)
    for figure in figures.split(' | '):
        name, _, value = figure.partition(' = ')
        assert str(found[name]) == value, name
    assert not [data for data in bench.asked() if data[:2] in ('FE', 'FD')]
