# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the Akron session makes of what the unit says: stops, events, noise."""

from collections.abc import Callable
import math
from typing import Any

import pytest

from akron_can_bridge.protocol import (
    decode,
    DigitalOutputs,
    Fault,
    FaultStatus,
    Output,
    Status,
    Vista,
    VistaData,
    VistaPosition,
)
from akron_can_bridge.session import (
    Cause,
    FaultsChanged,
    FILTERS,
    LimitsChanged,
    OutputsChanged,
    Positions,
    Settings,
)
from akron_can_bridge.session.unit import Unit
from bridge_core.j1939 import CanFrame
from bridge_core.session import StopChanged, Verdict
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    ef,
    faults,
    joystick,
    LINK_LIMIT,
    moved,
    NAME,
    NO_FAULTS,
    NOT_ENABLED,
    of,
    OUTPUTS,
    PIN,
    POSITION,
    VERSIONS,
)

VISTA = (VistaData(240, 0, 0, Vista(0)), VistaPosition(1, 2))

# -- stops ----------------------------------------------------------------------------------------


def test_silence_is_a_stop_at_the_limit() -> None:
    bench = Bench().find_unit()
    bench.wait(LINK_LIMIT - 1e-3)
    assert not bench.session.estop
    events = bench.wait(2e-3)
    assert events[0] == StopChanged(Verdict(True, True, False))
    assert bench.session.stop_reasons(bench.now) == [
        f'check power and CAN wiring of unit {PIN}: it is silent, last heard 301 ms ago, limit '
        '300 ms'
    ]


def test_closed_port_is_a_stop_and_forgets_the_unit() -> None:
    bench = Bench().moving()
    events = bench.close()
    assert events[0] == StopChanged(Verdict(True, True, False))
    assert bench.session.stop_reasons(bench.now) == ['the port is not open']
    bench.open()
    bench.take(OUTPUTS, NO_FAULTS)
    assert bench.session.estop
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    assert not bench.session.estop


def test_enable_input_that_is_not_told_any_more_is_a_stop() -> None:
    bench = Bench().find_unit()
    for _ in range(4):
        bench.wait(0.1)
        bench.take(POSITION)
    assert bench.session.link_up
    assert 'enable input is not known' in bench.session.stop_reasons(bench.now)[0]


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


def test_unknown_is_a_stop_whichever_cause_counts() -> None:
    for cause in set(Cause) - {Cause.FOREIGN_JOYSTICK}:  # of which silence is none
        bench = Bench(estop_on=frozenset({cause}))
        bench.open()
        assert bench.session.estop


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


def test_turning_changes_no_limit() -> None:
    bench = Bench().find_unit()
    bench.take(POSITION)
    before = len(bench.events)
    turn(bench, 2.0)
    assert of(LimitsChanged, bench.events[before:]) == []
    (broken,) = of(LimitsChanged, bench.take(ef('011D9A0371000041')))
    assert broken.position is not None
    assert broken.position.rotation.fault is Status.ERROR


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
    bench.take(ef('FF83150266021A0B', 0x90), ef('84C000', 0x90))  # from its next address
    assert bench.session.estop


@pytest.mark.parametrize('options', [{'device_type': 1033}, {'device_pin': '1033AE100801035'}])
def test_another_mini_universal_never_vouches_for_ours(options: dict[str, Any]) -> None:
    bench = Bench(**options)
    bench.open()
    bench.take(ef('848002', 0x82), ef('FF83150266021A0B', 0x81))
    assert bench.session.estop
    bench.take(ef('84C000', 0x81))
    assert 'device faulted' in bench.session.stop_reasons(bench.now)[0]


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
