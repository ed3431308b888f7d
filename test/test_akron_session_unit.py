"""Which unit the Akron session follows, where to, and what it makes of what the unit says."""

import math
import random
from typing import Any

import pytest

from akron_can_bridge.protocol import DigitalOutputs
from akron_can_bridge.protocol import Fault
from akron_can_bridge.protocol import Output
from akron_can_bridge.session import Answer
from akron_can_bridge.session import Cause
from akron_can_bridge.session import FaultsChanged
from akron_can_bridge.session import FILTERS
from akron_can_bridge.session import LimitsChanged
from akron_can_bridge.session import OutputsChanged
from akron_can_bridge.session import Positions
from akron_can_bridge.session import Request
from akron_can_bridge.session import Session
from akron_can_bridge.session import Settings
from akron_can_bridge.session import StopChanged
from akron_can_bridge.session import UnitChanged
from akron_can_bridge.session.report import warnings
from bridge_core.j1939 import CanFrame
from test.akron_session_rig import ANNOUNCED
from test.akron_session_rig import Bench
from test.akron_session_rig import ef
from test.akron_session_rig import joystick
from test.akron_session_rig import LINK_LIMIT
from test.akron_session_rig import MOVE
from test.akron_session_rig import MOVING
from test.akron_session_rig import NAME
from test.akron_session_rig import name
from test.akron_session_rig import NO_FAULTS
from test.akron_session_rig import NOT_ENABLED
from test.akron_session_rig import of
from test.akron_session_rig import OPERATIONAL_ERROR
from test.akron_session_rig import OTHER_ANNOUNCED
from test.akron_session_rig import OTHER_PIN
from test.akron_session_rig import OURS
from test.akron_session_rig import OUTPUTS
from test.akron_session_rig import PIN
from test.akron_session_rig import POSITION
from test.akron_session_rig import REST

NAME_REQUEST = CanFrame(0x18EAFF38, bytes.fromhex('00EE00'))  # the manual's, from address 38
STRANGER = '0100000000000000'  # a NAME that is not Akron Brass's


def moved(frame: CanFrame, source: int) -> CanFrame:
    """Return the same frame from another address."""
    return CanFrame(frame.identifier & ~0xFF | source, frame.data)


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


def test_announcement_makes_the_unit_known_and_the_polls_go_to_its_address() -> None:
    bench = Bench()
    bench.open()
    assert bench.session.estop
    assert 'no unit was found (wanted: 6032 Universal II)' in bench.session.stop_reasons(0.0)[0]
    events = bench.take(ANNOUNCED)
    assert UnitChanged(f'unit {PIN} is at address 80') in events
    assert bench.session.link_up
    assert sorted(bench.asked()) == ['02', '03', '04', '05']
    assert bench.session.estop  # enable and faults are not known
    bench.take(OUTPUTS)
    assert bench.session.estop
    assert StopChanged(False, False, True) in bench.take(NO_FAULTS)
    assert not bench.session.estop
    assert bench.session.stop_reasons(bench.now) == []


def test_unit_that_was_not_announced_is_not_believed() -> None:
    bench = Bench()
    bench.open()
    bench.take(OUTPUTS, POSITION, NO_FAULTS, NAME)
    assert bench.session.estop
    assert not bench.session.link_up
    assert of(Positions, bench.events) == []
    assert bench.session.other_frames == 3


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


def test_joystick_of_the_same_maker_is_never_taken_for_the_unit() -> None:
    bench = Bench(device_type=0)
    bench.open()
    # By hand: digits 1-4 are 1035 = 40B hex instead of 408.
    bench.take(ef('FF831502E6021A0B', 0x82))
    assert bench.session.finder.devices == {'1035AE100801035': 0x82}
    assert bench.session.finder.address is None


def test_choice_by_type_stays_with_the_first_and_tells_of_the_other() -> None:
    bench = Bench().find_unit()
    bench.take(OTHER_ANNOUNCED)
    bench.wait(5.0)
    bench.take(OTHER_ANNOUNCED)
    assert bench.session.finder.address == 0x80
    assert bench.session.finder.rivals() == [OTHER_PIN]
    assert Bench(device_pin=PIN).find_unit().session.finder.rivals() == []


def test_two_units_each_with_its_session() -> None:
    one, two = Bench(device_pin=PIN), Bench(device_pin=OTHER_PIN, source_address=0x37)
    for bench in (one, two):
        bench.open()
        bench.take(ANNOUNCED, OTHER_ANNOUNCED)
    one.take(OUTPUTS, moved(NOT_ENABLED, 0x81), NO_FAULTS)
    two.take(OUTPUTS, moved(NOT_ENABLED, 0x81), CanFrame(0x18EF3781, NO_FAULTS.data))
    assert not one.session.estop
    assert 'enable input' in two.session.stop_reasons(two.now)[0]
    # Each one's frames are a foreign joystick to the other, unless they are told.
    one.take(joystick(source=0x37))
    assert one.session.estop
    told = Bench(device_pin=PIN, allowed_joysticks=frozenset({0x37})).find_unit()
    told.take(joystick(source=0x37))
    assert not told.session.estop


# -- moving it ------------------------------------------------------------------------------------


def test_readdressed_in_the_midst_of_motion_it_goes_on() -> None:
    bench = Bench(soe_permissive=True).moving()
    events = bench.take(moved(ANNOUNCED, 0x90))
    assert events == [UnitChanged(f'unit {PIN} is at address 90')]
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


def test_old_address_says_nothing_any_more() -> None:
    bench = Bench().find_unit()
    bench.take(moved(ANNOUNCED, 0x90))
    bench.take(NOT_ENABLED)
    assert not bench.session.estop
    bench.wait(LINK_LIMIT)
    bench.take(OUTPUTS)
    assert bench.session.estop


@pytest.mark.parametrize(
    ('frame', 'text'),
    [
        (name(STRANGER, 0x80), 'to another device'),
        (moved(OTHER_ANNOUNCED, 0x80), f'to {OTHER_PIN}'),
        (moved(NAME, 0x91), 'and claims another'),
        (moved(NAME, 0xFE), 'and claims another'),  # it cannot claim any
    ],
)
def test_lost_address_is_not_believed_any_more_and_names_are_asked_for(
    frame: CanFrame, text: str
) -> None:
    bench = Bench().find_unit()
    bench.run(0.5, REST)
    start = bench.now
    assert bench.take(frame) == [UnitChanged(f'unit {PIN} has lost address 80 {text}')]
    assert name_requests(bench, start) == [start]
    bench.take(NOT_ENABLED)  # whoever that is now
    assert not bench.session.estop
    bench.wait(LINK_LIMIT)
    assert bench.session.estop
    assert 'has no address at present' in bench.session.stop_reasons(bench.now)[0]
    bench.take(moved(ANNOUNCED, 0x85), moved(OUTPUTS, 0x85), moved(NO_FAULTS, 0x85))
    assert not bench.session.estop
    assert bench.session.finder.moves == 1


def test_unit_that_defends_its_address_comes_back_by_its_announcement() -> None:
    bench = Bench().find_unit()
    bench.take(name(STRANGER, 0x80), NAME, ANNOUNCED, OUTPUTS)
    bench.run(0.5)
    assert bench.session.finder.address == 0x80
    assert not bench.session.estop


def test_own_claim_of_the_unit_and_claims_elsewhere_change_nothing() -> None:
    bench = Bench().find_unit()
    assert bench.take(NAME, name(STRANGER, 0x81)) == []
    assert bench.session.finder.address == 0x80


def test_claims_on_and_on_do_not_make_us_flood_the_bus() -> None:
    bench = Bench().find_unit()
    start = bench.now
    for _ in range(1000):
        bench.take(name(STRANGER, 0x80))
        bench.take(ANNOUNCED)
        bench.now += 0.001
    assert 5 <= len(name_requests(bench, start)) <= 11


def test_another_device_that_claims_our_own_address_is_told() -> None:
    bench = Bench().find_unit()
    bench.take(name(STRANGER, OURS))
    assert bench.session.finder.namesake is not None
    bench.take(name(STRANGER, 0x99))  # it gave way
    assert bench.session.finder.namesake is None


# -- stops ----------------------------------------------------------------------------------------


def test_silence_is_a_stop_at_the_limit() -> None:
    bench = Bench().find_unit()
    bench.wait(LINK_LIMIT - 1e-3)
    assert not bench.session.estop
    events = bench.wait(2e-3)
    assert events[0] == StopChanged(True, True, False)
    assert bench.session.stop_reasons(bench.now) == [
        f'unit {PIN} is silent: last heard 301 ms ago, limit 300 ms; check its power and CAN '
        'wiring'
    ]


def test_faults_are_asked_for_again_after_a_silence() -> None:
    bench = Bench().find_unit()
    bench.wait(1.0)
    start = bench.now
    bench.take(OUTPUTS)
    assert bench.session.estop
    assert bench.asked(start) == ['02']
    bench.take(NO_FAULTS)
    assert not bench.session.estop


def test_closed_port_is_a_stop_and_forgets_the_unit() -> None:
    bench = Bench().moving()
    events = bench.close()
    assert events[0] == StopChanged(True, True, False)
    assert bench.session.stop_reasons(bench.now) == ['the port is not open']
    bench.open()
    bench.take(OUTPUTS, NO_FAULTS)
    assert bench.session.estop
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    assert not bench.session.estop


def test_enable_input_that_is_not_asserted_is_a_stop() -> None:
    bench = Bench().find_unit()
    bench.take(NOT_ENABLED)
    assert bench.session.estop
    assert 'not asserted' in bench.session.stop_reasons(bench.now)[0]
    bench.take(OUTPUTS)
    assert not bench.session.estop


def test_enable_input_that_is_not_told_any_more_is_a_stop() -> None:
    bench = Bench().find_unit()
    for _ in range(4):
        bench.wait(0.1)
        bench.take(POSITION)
    assert bench.session.link_up
    assert 'enable input is not known' in bench.session.stop_reasons(bench.now)[0]


def faults(bits: int, pcode: int = 0) -> CanFrame:
    return ef(f'02{bits:08X}{pcode:04X}', destination=OURS)


# By the manual's table: bytes 2 to 5 of the response, from the top.
FAULT_BITS = {
    31: 'S12 processor or code',
    30: 'CAN output overrun',
    29: 'SCI output overrun',
    23: 'external EEPROM',
    21: 'internal fuse blown',
    16: 'pCode syntax error',
    15: 'XGATE processor or code',
    14: 'CAN input overrun',
    13: 'SCI input overrun',
    8: 'digital output 3',
    7: 'digital output 2',
    6: 'digital output 1',
    5: 'motor axis 5',
    4: 'motor axis 4',
    3: 'motor axis 3',
    2: 'motor axis 2',
    1: 'motor axis 1',
    0: 'internal EEPROM',
}


@pytest.mark.parametrize(('bit', 'words'), FAULT_BITS.items())
def test_every_fault_bit_is_named_and_motor_axes_stop(bit: int, words: str) -> None:
    bench = Bench().find_unit()
    bench.take(faults(1 << bit))
    (event,) = of(FaultsChanged, bench.events[-2:])
    assert words in event.faults[0]
    assert bench.session.estop == (1 <= bit <= 5)
    if bench.session.estop:
        assert f'{words} fault' in bench.session.stop_reasons(bench.now)[0]


def test_pcode_is_told() -> None:
    bench = Bench().find_unit()
    (event,) = of(FaultsChanged, bench.take(faults(0, 11)))
    assert 'pCode error code 11 (rotation sensor error)' in event.faults[0]
    assert not bench.session.estop


@pytest.mark.parametrize('cause', Cause)
def test_cause_that_is_not_listed_is_no_stop_but_is_known(cause: Cause) -> None:
    frames = {
        Cause.ENABLE: [NOT_ENABLED],
        Cause.MOTOR_FAULT: [faults(2)],
        Cause.FOREIGN_JOYSTICK: [joystick()],
        Cause.LINK: [],
    }
    alone = Bench(estop_on=frozenset({cause})).find_unit()
    without = Bench(estop_on=frozenset(set(Cause) - {cause})).find_unit()
    for bench in (alone, without):
        bench.take(*frames[cause])
    if cause is Cause.LINK:
        alone.wait(1.0)
        assert alone.session.estop
        return
    assert alone.session.estop
    assert not without.session.estop
    assert list(without.session.causes(without.now)) == [cause]
    assert 'no stop: estop_on' in warnings(without.session, without.now)[0]


def test_unknown_is_a_stop_whichever_cause_counts() -> None:
    for cause in (Cause.LINK, Cause.ENABLE, Cause.MOTOR_FAULT):
        bench = Bench(estop_on=frozenset({cause}))
        bench.open()
        assert bench.session.estop


# -- what is told ---------------------------------------------------------------------------------


def test_positions_are_the_manuals_in_rad() -> None:
    bench = Bench().find_unit()
    (event,) = of(Positions, bench.take(POSITION))
    assert event.rotation == pytest.approx(math.radians(47.3))
    assert event.elevation == pytest.approx(math.radians(-5.5))


def test_position_without_a_sensor_is_none() -> None:
    bench = Bench().find_unit()
    (event,) = of(Positions, bench.take(ef('01000F03710000' + '41')))
    assert event.rotation is None
    assert event.elevation == pytest.approx(math.radians(-5.5))


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


def test_mini_universal_as_the_unit_reports_its_fault() -> None:
    bench = Bench(device_type=1033, source_address=0x38)
    bench.open()
    bench.take(ef('FF83150266021A0B', 0x81))  # digits 1-4: 1033 = 409 hex
    assert bench.session.estop
    bench.take(ef('848002', 0x81))
    assert not bench.session.estop
    bench.take(ef('84C000', 0x81))
    assert 'device faulted' in bench.session.stop_reasons(bench.now)[0]
    bench.take(ef('848002', 0x82), ef('848002', 0x81), ef('84C000', 0x82))
    assert not bench.session.estop


# -- polls and services ---------------------------------------------------------------------------


def test_operational_error_has_the_faults_polled_at_once_and_every_second() -> None:
    bench = Bench().find_unit()
    bench.run(1.5, REST)
    start = bench.now
    bench.take(OPERATIONAL_ERROR)
    assert bench.asked(start) == ['02']
    bench.take(faults(2))
    assert bench.session.estop
    for _ in range(30):
        bench.wait(0.1)
        bench.take(OPERATIONAL_ERROR, OUTPUTS, faults(2))
    assert bench.asked(start).count('02') in (3, 4)
    bench.take(POSITION)
    for _ in range(20):
        bench.wait(0.1)
        bench.take(POSITION, OUTPUTS, NO_FAULTS)
    assert not bench.session.estop
    start = bench.now
    bench.run(3.0)
    assert bench.asked(start) == []


def test_faults_that_are_not_answered_are_not_known() -> None:
    bench = Bench().find_unit()
    bench.take(OPERATIONAL_ERROR)
    bench.run(1.5, REST)
    assert 'faults are not known' in bench.session.stop_reasons(bench.now)[0]
    bench.take(NO_FAULTS)
    assert not bench.session.estop


VERSIONS = tuple(
    ef(data, destination=OURS) for data in ('03010B02040206', '040D1C000E0204', '050398690E0204')
)


def test_versions_are_polled_once() -> None:
    bench = Bench().find_unit()
    assert of(Answer, bench.take(*VERSIONS)) == [
        Answer(
            Request.POLL_VERSIONS,
            True,
            'fixed boot 1.11, bootloader 2.4, system 2.6; style 3356, subtype 14, pCode 2.4; '
            'config type 60320014, config 2.4',
        )
    ]
    start = bench.now + 1e-9
    bench.run(3.0)
    bench.wait(1.0)
    bench.run(1.0)
    assert {'03', '04', '05'} & set(bench.asked(start)) == set()


def test_poll_is_repeated_until_its_answer_and_asks_only_for_what_is_missing() -> None:
    bench = Bench().find_unit()
    bench.take(VERSIONS[0])
    start = bench.now + 1e-9
    bench.run(0.3)
    assert sorted(bench.asked(start)) == ['04', '05']
    (answer,) = of(Answer, bench.run(1.0))
    assert answer.text == 'the unit did not answer type 04, 05 within 1 s'
    assert not answer.success


ACKNOWLEDGED = {Request.ZERO_POSITIONS: '41', Request.ENTER_SETUP: '46'}


@pytest.mark.parametrize(('request_', 'data'), ACKNOWLEDGED.items())
def test_request_is_sent_once_and_its_acknowledgement_is_the_answer(
    request_: Request, data: str
) -> None:
    bench = Bench().find_unit()
    bench.run(1.5)
    start = bench.now
    bench.session.request(request_, bench.now)
    bench.poll()
    bench.run(0.5)
    assert bench.asked(start) == [data]
    assert bench.take(ef(data, destination=OURS)) == [Answer(request_, True, 'acknowledged')]


@pytest.mark.parametrize(('request_', 'data'), ACKNOWLEDGED.items())
def test_acknowledgement_to_somebody_else_is_not_ours(request_: Request, data: str) -> None:
    bench = Bench().find_unit()
    bench.run(1.5)
    bench.session.request(request_, bench.now)
    assert of(Answer, bench.take(ef(data, destination=0x05), ef(data, source=0x81))) == []
    (answer,) = of(Answer, bench.run(1.1))
    assert answer.text == f'the unit did not answer type {data} within 1 s'


def test_reset_is_answered_by_the_announcement_after_it() -> None:
    bench = Bench().find_unit()
    bench.run(1.5, REST)
    start = bench.now
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.poll()
    assert bench.asked(start) == ['45']
    bench.run(2.0, unit=False)
    assert bench.session.estop
    (answer,) = of(Answer, bench.take(ANNOUNCED))
    assert answer == Answer(Request.RESET_CONTROLLER, True, f'unit {PIN} is back')


def test_reset_without_a_return_times_out() -> None:
    bench = Bench().find_unit()
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.wait(4.9)
    assert [a for a in of(Answer, bench.events) if a.request is Request.RESET_CONTROLLER] == []
    (answer,) = of(Answer, bench.wait(0.2))
    assert 'within 5 s of its reset' in answer.text


@pytest.mark.parametrize(
    'request_', [Request.RESET_CONTROLLER, Request.ENTER_SETUP, Request.ZERO_POSITIONS]
)
def test_request_is_refused_while_motion_is_commanded(request_: Request) -> None:
    bench = Bench().moving()
    start = bench.now
    with pytest.raises(ValueError, match='motion is commanded'):
        bench.session.request(request_, bench.now)
    bench.poll()
    assert bench.asked(start) == []
    bench.session.request(Request.POLL_FAULTS, bench.now)


def test_no_motion_while_the_unit_is_being_reset() -> None:
    bench = Bench().find_unit()
    bench.run(0.1, REST)
    start = bench.now
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.run(0.5, MOVE)
    assert bench.all_neutral(start)
    assert 'the unit is being reset' in bench.session.inhibits(bench.now)


@pytest.mark.parametrize('request_', Request)
def test_request_without_a_unit_is_refused(request_: Request) -> None:
    bench = Bench()
    bench.open()
    with pytest.raises(ValueError, match='no unit was found'):
        bench.session.request(request_, bench.now)
    bench.close()
    with pytest.raises(ValueError, match=r'.'):
        bench.session.request(request_, bench.now)


def test_closing_answers_what_is_open() -> None:
    bench = Bench().find_unit()
    bench.run(1.5)
    bench.session.request(Request.ENTER_SETUP, bench.now)
    (answer,) = of(Answer, bench.close())
    assert answer == Answer(Request.ENTER_SETUP, False, 'the port was closed')


def test_vista_is_polled_at_its_rate_and_kept() -> None:
    bench = Bench(vista_rate=2.0).find_unit()
    bench.run(5.0)
    assert 9 <= bench.asked().count('21') <= 11
    off = Bench().find_unit()
    off.run(5.0)
    assert '21' not in off.asked()


# -- noise ----------------------------------------------------------------------------------------


def test_counters_tell_malformed_from_unknown_and_from_what_is_not_ours() -> None:
    bench = Bench().find_unit()
    counters = bench.session.counters
    before = (counters.frames, bench.session.other_frames)
    bench.take(ef('8300'), ef('77'), ef('0100', source=0x55), CanFrame(0x18FEF100, b'\0'))
    bench.take(ef('41', destination=0x05))
    assert counters.malformed == 1
    assert counters.unknown_types == 1
    assert (counters.frames - before[0], bench.session.other_frames - before[1]) == (5, 3)


def test_filters_pass_all_that_is_taken_and_hardly_more() -> None:
    def passes(frame: CanFrame) -> bool:
        return any(not (frame.identifier ^ identifier) & mask for identifier, mask in FILTERS)

    ours = (ANNOUNCED, NAME, POSITION, OUTPUTS, NO_FAULTS, joystick(), joystick(pgn=0xFDD7))
    assert all(passes(frame) for frame in ours)
    assert all(passes(CanFrame(frame.identifier & 0x03FFFFFF, b'')) for frame in ours)
    others = (NAME_REQUEST, joystick(pgn=0xFDD8), CanFrame(0x18FEF100, b''))
    assert not any(passes(frame) for frame in others)


def test_mutated_frames_raise_nothing_and_move_nothing() -> None:
    dice = random.Random(4)
    frames = (ANNOUNCED, OTHER_ANNOUNCED, NAME, POSITION, OUTPUTS, NO_FAULTS, *VERSIONS)
    frames += (joystick(), joystick(pgn=0xFDD7), ef('81FED401C280'), ef('41', destination=OURS))
    bench = Bench(soe_permissive=True, extended=True, joy_source=0x34, vista_rate=5.0).find_unit()
    bench.run(0.2, REST)
    for _ in range(10_000):
        frame = dice.choice(frames)
        data = bytearray(frame.data)
        for _ in range(dice.randrange(3)):
            data[dice.randrange(len(data))] = dice.randrange(256)
        identifier = frame.identifier ^ (1 << dice.randrange(29) if dice.random() < 0.3 else 0)
        size = dice.randrange(9) if dice.random() < 0.2 else len(data)
        bench.now += dice.random() * 0.01
        bench.take(CanFrame(identifier, bytes(data[:size])))
        bench.session.set_estop(False, bench.now)
        bench.session.set_command(*REST, bench.now)
    assert bench.all_neutral(0.0)
    assert bench.session.counters.malformed > 100
    assert bench.session.finder.moves > 1


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
        {'device_type': 1035},
        {'link_timeout': 0.1},
        {'link_timeout': math.nan},
        {'command_timeout': 0.0},
        {'estop_in_timeout': 9.0},
        {'answer_timeout': 0.0},
        {'vista_rate': -1.0},
    ],
)
def test_settings_that_cannot_be_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options)).split('_')[0]):
        Settings(**options)


def test_fault_flags_are_those_of_the_manual() -> None:
    assert sum(1 << bit for bit in FAULT_BITS) == sum(Fault)
    assert Session().estop
