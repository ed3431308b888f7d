# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the sessions may be set to, at the very limits, and when a line carries what is asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
import re
from typing import Any

import pytest

from akron_can_bridge.parameters import Cause, PARAMETERS as AKRON_PARAMETERS
from akron_can_bridge.session import Settings as AkronSettings
from bridge_core.parameters import Parameter
from esi_drive_bridge.parameters import PARAMETERS as ESI_PARAMETERS
from esi_drive_bridge.protocol import Layout
from esi_drive_bridge.session import Settings as EsiSettings
from fort_vsc_bridge.parameters import PARAMETERS as VSC_PARAMETERS
from fort_vsc_bridge.session import DeviceSettings, Settings as VscSettings
from ssc_bridge.channels import AxisInput, ButtonInput, Failsafe
from ssc_bridge.parameters import parameter_table
from ssc_bridge.protocol import CommandState, Configuration, DigitalInput, PulseAccumulator
from ssc_bridge.session import Settings as SscSettings
from stage.esi_drive_rig import IDLE, make_settings
from stage.fort_vsc_rig import heartbeat
from stage.ssc_rig import GRIP, status as ssc_status, TILT
from vm110_bridge.parameters import PARAMETERS as VM110_PARAMETERS
from vm110_bridge.session import Settings as Vm110Settings

PAN = AxisInput('pan', 1)


def defaults(parameters: Sequence[Parameter], **changes: Any) -> Mapping[str, Any]:
    return {each.name: each.default for each in parameters} | changes


@pytest.mark.parametrize(
    ('port', 'heard'), [('/dev/ttyS0', 0), ('socket://far:1', 1), ('RFC2217://far:1', 1)]
)
@pytest.mark.parametrize(
    ('bridge', 'values', 'frame'),
    [
        ('fort_vsc', defaults(VSC_PARAMETERS), heartbeat()),
        ('esi_drive', defaults(ESI_PARAMETERS, joint_names=['a', 'b']), IDLE),
        ('ssc', defaults(parameter_table({})), ssc_status()),
    ],
)
def test_frame_that_a_serial_server_sends_in_pieces_is_heard(
    bridge: str, values: Mapping[str, Any], frame: bytes, port: str, heard: int
) -> None:
    session = import_module(f'{bridge}_bridge.wire').make_session({**values, 'port': port})
    session.opened(1.0)
    session.receive(frame[:4], 1.0)
    session.poll(1.1)
    session.receive(frame[4:], 1.14)
    assert session.counters.frames == heard
    warned = any('its line goes over a network' in text for _, text in session.problems(1.14))
    assert warned == bool(heard and bridge != 'fort_vsc')  # which bounds the age of its line


# One message may be missing before a link counts as lost.
RARE: dict[str, Any] = {'link_timeout': 0.2}
_, *REST = SscSettings().poll_rates
SLOW_VSC = DeviceSettings(joystick_interval_ms=100, heartbeat_interval_ms=100)


def by_itself(rate: float, polled: float) -> dict[str, Any]:
    """Return settings of an SSC that sends a status at this rate, and is asked for it."""
    rates = (rate, 0.0, 0.0, 0.0, 0.0)
    return {**RARE, 'poll_rates': (polled, *REST), 'message_rates': rates}


FIT: list[tuple[Any, dict[str, Any]]] = [
    (VscSettings, {**RARE, 'device': SLOW_VSC}),
    (SscSettings, {**RARE, 'poll_rates': (10.0, *REST)}),
    (SscSettings, {**RARE, 'poll_rates': (0.0, *REST)}),  # by itself, at a rate that is not told
    *((SscSettings, by_itself(10.0, polled)) for polled in (0.0, 9.9)),
    (SscSettings, {'axes': (PAN,), 'plausible_us': (PAN.min_us, PAN.max_us)}),
    (SscSettings, {'estop_states': {CommandState.MS_1_5}, 'lost_link_is_stop': True}),
    (AkronSettings, {'button_switches': (1, 12)}),
    (AkronSettings, {'button_switches': (1, 13), 'extended': True}),
    *(
        (AkronSettings, {'button_switches': (switch,), 'automatic_motion': True})
        for switch in range(1, 13)
    ),
    (AkronSettings, {'unit_address': 0x80, 'device_type': 1040}),
]
REFUSED: list[tuple[Any, str, dict[str, Any]]] = [
    (make_settings, 'layout padded has 1 axes', {'layout': Layout.PADDED}),
    (VscSettings, 'link_timeout', {'link_timeout': VscSettings().wire.INTERVAL}),
    *(
        (VscSettings, f'{name} must not be', {**RARE, 'device': DeviceSettings(**{name: 101})})
        for name in ('joystick_interval_ms', 'heartbeat_interval_ms')
    ),
    (SscSettings, 'poll_rates', {**RARE, 'poll_rates': (9.9, *REST)}),
    *((SscSettings, 'status at', by_itself(9.9, polled)) for polled in (0.0, 9.9)),
    (SscSettings, 'must all differ', {'axes': (PAN,), 'buttons': (ButtonInput('pan', 2),)}),
    *(
        (SscSettings, 'calibration.pan: min_us', {'axes': (PAN,), 'plausible_us': (low, high)})
        for low, high in ((PAN.min_us + 1, PAN.max_us), (PAN.min_us, PAN.max_us - 1))
    ),
    (AkronSettings, 'need extended', {'button_switches': (1, 13)}),
    *(  # oscillate, its pause, deploy, stow
        (AkronSettings, 'start motion', {'button_switches': (switch,)}) for switch in (4, 7, 8, 9)
    ),
    (AkronSettings, 'needs a device_type', {'unit_address': 0x80, 'device_type': 0}),
    (AkronSettings, '33 is a joystick', {'unit_address': 0x33}),
]


@pytest.mark.parametrize(('settings', 'options'), FIT)
def test_settings_that_just_fit_are_taken(settings: Any, options: dict[str, Any]) -> None:
    assert settings(**options)


@pytest.mark.parametrize(('settings', 'text', 'options'), REFUSED)
def test_settings_that_do_not_fit_are_refused(
    settings: Any, text: str, options: dict[str, Any]
) -> None:
    with pytest.raises(ValueError, match=re.escape(text)):
        settings(**options)


def test_drive_is_as_its_parameters_say() -> None:
    values = defaults(ESI_PARAMETERS, joint_names=['winch'], single_axis_layout='compact')
    settings = EsiSettings.from_parameters(values)
    assert [axis.joint for axis in settings.axes] == ['winch']
    assert settings.layout is Layout.COMPACT
    assert settings.baud == values['baud']


def test_line_of_the_drive_carries_what_just_fits() -> None:
    # 4.2, 4.3: 10 bytes to a drive of two axes, 12 from it; a byte is 10 bits.
    just = {'baud': 120000, 'command_rate': 1000.0, 'status_rate': 1000.0}
    assert make_settings(**just).line_warnings() == ()
    (warning,) = make_settings(**just | {'baud': 119999}).line_warnings()
    assert 'status packets of 12 bytes at 1000 Hz need 120000 bit/s' in warning
    assert make_settings(**just | {'baud': 100000}).line_warnings() == (
        warning.replace('119999', '100000'),
    )
    assert len(make_settings(**just | {'baud': 99999}).line_warnings()) == 2


hold = pytest.mark.parametrize(
    'changes', [{'failsafe': Failsafe.HOLD}, {'servos': (GRIP,)}], ids=['unnamed', 'named']
)


@hold
@pytest.mark.parametrize(
    ('by_itself', 'unasked'),
    [
        ((0.0, 5.0, 0.0, 0.0, 0.0), (20.0, 0.0, 10.0, 50.0, 10.0)),
        ((0.0, 0.0, 5.0, 0.0, 0.0), (20.0, 5.0, 0.0, 50.0, 10.0)),
    ],
    ids=['channel sources', 'pulse outputs'],
)
def test_ssc_that_tells_not_what_drives_an_output_and_how_is_no_place_to_hold(
    changes: dict[str, Any], by_itself: tuple[float, ...], unasked: tuple[float, ...]
) -> None:
    """
    An output that was never commanded would follow its own echo, and swing for ever.

    Or it would lose the pulse that it is to keep.
    """
    SscSettings(poll_rates=unasked, servos=(TILT,))
    SscSettings(poll_rates=unasked, message_rates=by_itself, **changes)
    seldom = tuple(0.79 * rate for rate in by_itself)  # may come after what waits for it
    polled = tuple(map(max, unasked, seldom))
    for polls, rates in ((unasked, (0.0,) * 5), (unasked, seldom), (polled, seldom)):
        asked = {**changes, 'poll_rates': polls, 'message_rates': rates}
        with pytest.raises(
            ValueError, match=r"message_rates: the failsafe 'hold' needs .* at 4 Hz"
        ):
            SscSettings(**asked)


def test_ssc_is_as_its_parameters_say() -> None:
    changes = {'servos': ['pan'], 'failsafe': 'hold', 'estop_states': ['1 ms'], 'baud': 9600}
    settings = SscSettings.from_parameters(defaults(parameter_table(changes), **changes))
    assert [axis.name for axis in settings.axes] == ['turn', 'forward']
    assert [button.name for button in settings.buttons] == ['deadman']
    assert [servo.name for servo in settings.servos] == ['pan']
    assert settings.failsafe is Failsafe.HOLD
    assert settings.estop_states == {CommandState.MS_1}
    assert (settings.baud, settings.poll_rates) == (9600, SscSettings().poll_rates)


def test_line_of_the_ssc_carries_what_just_fits() -> None:
    # 4.1, 4.2.1: 6 bytes around payloads of 2, outputs, 2 an output, 2 an input, 2 and 2 a word.
    some = Configuration(0, 8, (PulseAccumulator(rising=True),) * 2 + (DigitalInput(),) * 4)
    sizes = [6 + 2, 6 + 16, 6 + 32, 6 + 16, 6 + 2 + 4]
    rates = (50.0, 20.0, 10.0, 50.0, 20.0)
    bits = round(10 * sum(size * rate for size, rate in zip(sizes, rates, strict=True)))
    for baud, warnings in ((bits, 0), (bits - 1, 1)):
        settings = SscSettings(poll_rates=(0.0,) * 5, message_rates=rates, baud=baud)
        assert len(settings.line_warnings(some)) == warnings


def test_monitor_is_as_its_parameters_say() -> None:
    changes = {'allowed_joysticks': [0, 0x33], 'button_switches': [1], 'estop_on': ['motor_fault']}
    settings = AkronSettings.from_parameters(defaults(AKRON_PARAMETERS, **changes))
    assert settings.allowed_joysticks == {0x33}  # 0 stands for none
    assert settings.button_switches == (1,)
    assert settings.estop_on == {Cause.MOTOR_FAULT}
    assert settings.link_timeout == AkronSettings().link_timeout


def test_base_unit_is_as_its_parameters_say() -> None:
    settings = Vm110Settings.from_parameters(defaults(VM110_PARAMETERS, bu_id=7))
    assert settings == Vm110Settings(bu_id=7)
    lit = Vm110Settings.from_parameters(defaults(VM110_PARAMETERS, led_switches=[0, 3]))
    assert lit == Vm110Settings(led_switches=frozenset({3}))
