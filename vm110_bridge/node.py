"""The VM-110 bridge: a base unit with its remotes as ROS topics."""

import itertools
from typing import Any
from typing import ClassVar

from diagnostic_msgs.msg import KeyValue
from sensor_msgs.msg import BatteryState
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool
from std_msgs.msg import Int32
from std_msgs.msg import UInt8MultiArray
from std_msgs.msg import UInt16

from bridge_core.diagnostics import ERROR
from bridge_core.diagnostics import Status
from bridge_core.diagnostics import summarise
from bridge_core.diagnostics import WARN
from bridge_core.node import BridgeNode
from bridge_core.node import latched_qos
from bridge_core.parameters import BRIDGE_PARAMETERS
from bridge_core.parameters import Parameter
from bridge_core.runner import run
from bridge_core.transports.multicast import MulticastTransport
from vm110_bridge import convert
from vm110_bridge.parameters import axis_signs
from vm110_bridge.parameters import OUTPUT_PORT_OFFSET
from vm110_bridge.parameters import PARAMETERS
from vm110_bridge.parameters import session_settings
from vm110_bridge.protocol import BuState
from vm110_bridge.protocol import Disabled
from vm110_bridge.protocol import LinkStatus
from vm110_bridge.protocol import PeriodicInput
from vm110_bridge.protocol import state_name
from vm110_bridge.session import ArmedChanged
from vm110_bridge.session import Command
from vm110_bridge.session import CommandResult
from vm110_bridge.session import EncoderTurned
from vm110_bridge.session import RemoteState
from vm110_bridge.session import Session
from vm110_bridge.session import Sticks

_LOW_BATTERY_PERCENT = 20
_COMMAND_DEPTH = 50  # a burst of commands must not lose its first to a slow listener
_LINK_HINTS = {
    LinkStatus.NO_LINK: 'no valid data has been received; check cable and the other end',
    LinkStatus.LINK_ERROR: "a configuration error; compare both ends' configuration",
    LinkStatus.INTERFACE_ERROR: 'reported by the link interface module; check it and its cable',
    LinkStatus.DATA_ERROR: 'the link is up, but what is exchanged is wrong; check the versions '
    'and periodic_output_size',
}
_LINKS_IN_ORDER = (LinkStatus.UNUSED, LinkStatus.OPERATIONAL, LinkStatus.PASSIVE)
_DISABLED_HINTS = {
    Disabled.TILTING: 'disabled due to tilting; hold it upright',
    Disabled.INACTIVITY: 'disabled due to inactivity; enable it again on the remote',
}


class Vm110Bridge(BridgeNode):
    """One base unit with its remotes; see docs/devices/vm110.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *PARAMETERS)

    def __init__(self, **options: Any) -> None:
        self._numbers = itertools.count()  # of requests that must not replace each other
        super().__init__('vm110_bridge', **options)

    def create_interfaces(self) -> None:
        """Create what the manual's packets become."""
        self._joy = self.publisher(Joy, '~/joy', 10)
        self._armed = self.publisher(Bool, '~/armed', latched_qos())
        self._enabled = self.publisher(Bool, '~/enabled', latched_qos())
        self._battery = self.publisher(BatteryState, '~/battery', latched_qos())
        self._encoder = self.publisher(Int32, '~/encoder', latched_qos())
        self._command = self.publisher(UInt8MultiArray, '~/command', _COMMAND_DEPTH)
        self._result = self.publisher(KeyValue, '~/command_result', _COMMAND_DEPTH)
        self.create_subscription(
            UInt8MultiArray, '~/periodic_output', self._on_periodic_output, 10
        )
        self.create_subscription(
            UInt8MultiArray, '~/send_command', self._on_send_command, _COMMAND_DEPTH
        )
        self.create_subscription(Bool, '~/hold_output', self._on_hold_output, 10)
        self.create_subscription(UInt16, '~/command_done', self._on_command_done, _COMMAND_DEPTH)
        self._publish_armed(ArmedChanged(armed=False, enabled=False))

    def make_session(self) -> Session:
        """Return a session for UDP EG-Link."""
        return Session(session_settings(self.values))

    def make_transport(self) -> MulticastTransport:
        """Return the multicast port, not yet open."""
        port = self.values['input_port']
        return MulticastTransport(
            self.values['group'],
            port,
            port + OUTPUT_PORT_OFFSET,
            ttl=self.values['ttl'],
            interface_address=self.values['interface_address'],
            allowed_sources=[source for source in self.values['allowed_sources'] if source],
        )

    @property
    def hardware_name(self) -> str:
        """The device's name where the user gave none: its group and port."""
        return f'{self.values["group"]}:{self.values["input_port"]}'

    def on_event(self, event: Any) -> None:
        """Publish one event of the session."""
        if isinstance(event, Sticks):
            self._publish_sticks(event)
        elif isinstance(event, ArmedChanged):
            self._publish_armed(event)
        elif isinstance(event, RemoteState):
            self._publish_battery(event)
        elif isinstance(event, EncoderTurned):
            self._encoder.publish(convert.encoder(event.position))
        elif isinstance(event, Command):
            self._command.publish(convert.command(event.command_id, event.data))
        elif isinstance(event, CommandResult):
            self._result.publish(convert.command_result(event.command_id, event.outcome))

    def device_status(self, now: float) -> Status:
        """Return states, links, remote and packets in the manual's words."""
        session: Session = self.session
        level, message = summarise(self._problems(session, now), _good_text(session))
        values: dict[str, Any] = {
            'base unit (bu_id)': session.bu_id or 'not heard yet',
            'CRC': session.crc.value if session.crc else 'not known yet',
            'hold output in use': session.hold_output_in_use,
            'VRPO withheld': session.output_held(now),
            **(_values(session.vrpi) if session.vrpi is not None else {}),
            **session.packets,
        }
        return Status(level, message, values)

    def _problems(self, session: Session, now: float) -> list[tuple[bytes, str]]:
        stop_level = WARN if session.link_up else ERROR
        problems = [(stop_level, reason) for reason in session.stop_reasons(now)]
        if session.vrpi is not None:
            problems += [(WARN, text) for text in _warnings(session.vrpi)]
        if session.faulty:
            problems.append(
                (ERROR, f'the remote reports {", ".join(session.faulty)}; have it repaired')
            )
        if session.link_up and session.hold_asked(now):
            text = 'VRPO are withheld, as hold_output asks or since it is silent'
            if not session.output_held(now):
                text = 'hold_output asks, but the relays are open already; VRPO go on for rearming'
            problems.append((WARN, text))
        others = session.other_base_units(now)
        if others:
            names = ', '.join(map(str, others))
            text = f'another base unit is on this group: {names}, beside ours, {session.bu_id}'
            problems.append((WARN, f'{text}; it is not listened to; give each a port of its own'))
        if session.looped_back:
            text = 'packets of a machine controller come to the input port; does one use the wrong'
            problems.append((WARN, f'{text} port?'))
        return problems

    def _header(self) -> tuple[Any, str]:
        return self.stamp(), self.values['frame_id']

    def _publish_sticks(self, sticks: Sticks) -> None:
        self._joy.publish(
            convert.joy(
                sticks.axes,
                sticks.buttons,
                *self._header(),
                axis_inverted=axis_signs(self.values),
                deadband=self.values['deadband'],
            )
        )

    def _publish_armed(self, event: ArmedChanged) -> None:
        self._armed.publish(Bool(data=event.armed))
        self._enabled.publish(Bool(data=event.enabled))

    def _publish_battery(self, event: RemoteState) -> None:
        remote = event.status
        percent = None if remote is None else remote.battery_percent
        docked = remote is not None and remote.docked
        self._battery.publish(convert.battery_state(percent, *self._header(), docked=docked))

    # Requests: on the executor's thread, posted to the link thread.

    def _on_hold_output(self, message: Any) -> None:
        hold = message.data
        self.request('hold_output', lambda s, now: s.set_hold_output(hold, now), sticky=hold)

    def _on_periodic_output(self, message: Any) -> None:
        self.request(
            'periodic_output', lambda s, now: s.set_periodic_output(convert.data_of(message))
        )

    def _on_send_command(self, message: Any) -> None:
        def send(session: Session, now: float) -> None:
            try:
                session.send_command(convert.data_of(message), now)
            except ValueError as error:
                self._result.publish(convert.command_result(None, str(error)))
                raise

        self.request(f'send_command {next(self._numbers)}', send)

    def _on_command_done(self, message: Any) -> None:
        self.request(
            f'command_done {message.data}', lambda s, now: s.command_done(message.data, now)
        )


def _good_text(session: Session) -> str:
    """Say how things stand where nothing is wrong."""
    vrpi = session.vrpi
    if vrpi is None or vrpi.bu_state != BuState.ARMED:
        return 'ok; no remote is armed, so none moves anything'
    return f'ok; RU {vrpi.armed_ru} is {state_name(vrpi.ru_state).lower()}'


def _warnings(vrpi: PeriodicInput) -> list[str]:
    """Say what is not a stop but not right either."""
    texts = [
        f'{name} is {state_name(status)}: {_link_hint(status)}'
        for name, status in _links(vrpi).items()
        if status not in _LINKS_IN_ORDER
    ]
    if vrpi.ru_disabled != Disabled.ENABLED:
        hint = 'disabled for an unknown reason'
        if isinstance(vrpi.ru_disabled, Disabled):
            hint = _DISABLED_HINTS[vrpi.ru_disabled]
        texts.append(f'RU {vrpi.armed_ru} is {hint}')
    if vrpi.armed_ru and vrpi.ru_battery <= _LOW_BATTERY_PERCENT and not vrpi.ru_docked:
        texts.append(f"the remote's battery is at {vrpi.ru_battery} %; dock it or exchange it")
    return texts


def _link_hint(status: LinkStatus | int) -> str:
    return _LINK_HINTS[status] if isinstance(status, LinkStatus) else 'the manual does not know it'


def _links(vrpi: PeriodicInput) -> dict[str, LinkStatus | int]:
    return {'EG-Link': vrpi.eg_link, 'EC-Link': vrpi.ec_link, 'C-Link': vrpi.c_link}


def _values(vrpi: PeriodicInput) -> dict[str, Any]:
    values: dict[str, Any] = {
        'BU state': state_name(vrpi.bu_state),
        'VLAPs': vrpi.vlaps,
        'unarmed RUs': vrpi.unarmed_rus,
        **{name: state_name(status) for name, status in _links(vrpi).items()},
        'armed RU': vrpi.armed_ru or 'none',
    }
    if vrpi.armed_ru:
        values |= {
            'RU state': state_name(vrpi.ru_state),
            'RU battery (%)': vrpi.ru_battery,
            'RU C-Link RSSI (%)': vrpi.ru_rssi,
            'RU on cable': vrpi.ru_cable,
            'RU docked': vrpi.ru_docked,
            'RU disabled': state_name(vrpi.ru_disabled) if vrpi.ru_disabled else 'no',
        }
    return values


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([Vm110Bridge]))


if __name__ == '__main__':
    main()
