"""The FORT VSC bridge: a wireless e-stop and remote as ROS topics."""

from typing import Any
from typing import ClassVar

from diagnostic_msgs.msg import KeyValue
from sensor_msgs.msg import BatteryState
from sensor_msgs.msg import Joy
from sensor_msgs.msg import JoyFeedback
from sensor_msgs.msg import NavSatFix
from std_msgs.msg import Bool
from std_msgs.msg import String
from std_msgs.msg import UInt8

from bridge_core.diagnostics import ERROR
from bridge_core.diagnostics import Status
from bridge_core.diagnostics import summarise
from bridge_core.diagnostics import WARN
from bridge_core.node import BridgeNode
from bridge_core.node import latched_qos
from bridge_core.parameters import BRIDGE_PARAMETERS
from bridge_core.parameters import Parameter
from bridge_core.parameters import ParameterError
from bridge_core.runner import run
from bridge_core.transports import Transport
from bridge_core.transports.hidraw import HidrawTransport
from bridge_core.transports.serial import SerialTransport
from fort_vsc_bridge import convert
from fort_vsc_bridge.parameters import make_session
from fort_vsc_bridge.parameters import make_wire
from fort_vsc_bridge.parameters import PARAMETERS
from fort_vsc_bridge.protocol import CanWire
from fort_vsc_bridge.protocol import mode_name
from fort_vsc_bridge.protocol import REPORT_SIZE
from fort_vsc_bridge.session import GpsSentence
from fort_vsc_bridge.session import ModeChanged
from fort_vsc_bridge.session import RemoteState
from fort_vsc_bridge.session import Session
from fort_vsc_bridge.session import Sticks
from fort_vsc_bridge.session import UserValue

_LOW_BATTERY_PERCENT = 20


class FortVscBridge(BridgeNode):
    """One VSC with its remote; see docs/devices/fort_vsc.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *PARAMETERS)

    def __init__(self, **options: Any) -> None:
        self._bad_sentences = 0
        self._gga_heard = False
        super().__init__('fort_vsc_bridge', **options)

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse what cannot go together. :raises ParameterError: naming it."""
        make_session(values)
        try:
            _make_transport(values)
        except ValueError as error:
            raise ParameterError(f'parameter {error}') from error
        except ImportError as error:
            raise ParameterError(f"parameter transport = 'can': {error}") from error

    def create_interfaces(self) -> None:
        """Create what the manual's messages become."""
        self._joy = self.publisher(Joy, '~/joy', 10)
        self._mode = self.publisher(String, '~/mode', latched_qos())
        self._battery = self.publisher(BatteryState, '~/battery', latched_qos())
        self._fix = self.publisher(NavSatFix, '~/fix', 10)
        self._nmea = self.publisher(String, '~/nmea', 10)
        self._user_values = self.publisher(KeyValue, '~/user_values', 10)
        self.create_subscription(Bool, '~/software_estop', self._on_software_estop, 10)
        self.create_subscription(JoyFeedback, '~/set_feedback', self._on_set_feedback, 10)
        self.create_subscription(KeyValue, '~/set_user_value', self._on_set_user_value, 10)
        self.create_subscription(KeyValue, '~/set_user_name', self._on_set_user_name, 10)
        self.create_subscription(String, '~/display_text', self._on_display_text, 10)
        self.create_subscription(UInt8, '~/get_user_value', self._on_get_user_value, 10)

    def make_session(self) -> Session:
        """Return a session for the wire that ``transport`` names."""
        return make_session(self.values)

    def make_transport(self) -> Transport:
        """Return the port that ``transport`` names, not yet open."""
        return _make_transport(self.values)

    @property
    def hardware_name(self) -> str:
        """The port, or the CAN channel."""
        return str(self.values['channel' if self.values['transport'] == 'can' else 'port'])

    def on_event(self, event: Any) -> None:
        """Publish one event of the session."""
        if isinstance(event, Sticks):
            self._publish_sticks(event)
        elif isinstance(event, ModeChanged):
            self._mode.publish(convert.mode_string(event.mode))
        elif isinstance(event, RemoteState):
            self._battery.publish(convert.battery_state(event.status, *self._header()))
        elif isinstance(event, GpsSentence):
            self._publish_gps(event)
        elif isinstance(event, UserValue):
            self._user_values.publish(convert.user_value(event.key, event.value))

    def device_status(self, now: float) -> Status:
        """Return mode, stops, faulty controls, battery and settings in words."""
        session: Session = self.session
        level, message = summarise(self._problems(session, now), 'ok')
        heartbeat, remote = session.heartbeat, session.remote_status
        values: dict[str, Any] = {
            'mode': convert.mode_string(session.mode).data,
            'e-stop indication': f'0x{heartbeat.estop:08X}' if heartbeat else 'unknown',
            'autonomy mode': mode_name(heartbeat.autonomy) if heartbeat else 'unknown',
            'remote connected': session.remote_connected,
            'software e-stop in use': session.software_estop_in_use,
            'faulty controls': ', '.join(session.faulty) or 'none',
            'bad GPS sentences': self._bad_sentences,
            **{f'setting {name}': state for name, state in session.setting_states.items()},
        }
        if remote is not None:
            values |= {
                'battery (%)': remote.battery_percent,
                'charging': remote.charging,
                'strength at VSC (0 low to 2 high)': remote.strength_vsc,
                'strength at remote (0 low to 2 high)': remote.strength_src,
                'reserved bytes (RSSI on some)': remote.reserved.hex(' '),
            }
        return Status(level, message, values)

    def _problems(self, session: Session, now: float) -> list[tuple[bytes, str]]:
        stop_level = WARN if session.link_up else ERROR
        problems = [(stop_level, reason) for reason in session.stop_reasons(now)]
        if session.faulty:
            problems.append(
                (ERROR, f'the remote reports {", ".join(session.faulty)}; have it repaired')
            )
        if session.link_up and session.joystick_age(now) > self.values['link_timeout']:
            problems.append((WARN, f'no joystick messages; {session.wire.NO_JOYSTICK}'))
        remote = session.remote_status
        if remote and remote.battery_percent <= _LOW_BATTERY_PERCENT and not remote.charging:
            problems.append(
                (WARN, f"the remote's battery is at {remote.battery_percent} %; charge it")
            )
        if session.software_estop_refused:
            problem = f'transport {session.wire.NAME} cannot carry software_estop, but it comes: '
            problems.append((ERROR, f'{problem}the VSC does not stop; wire that stop elsewhere'))
        if session.looped_back:
            problems.append((WARN, 'our own frames come back: is RX wired to TX, or echo on?'))
        return problems

    def _header(self) -> tuple[Any, str]:
        return self.stamp(), self.values['frame_id']

    def _publish_sticks(self, sticks: Sticks) -> None:
        self._joy.publish(
            convert.joy(
                sticks.axes,
                sticks.buttons,
                *self._header(),
                axis_full_scale=self.values['axis_full_scale'],
                deadband=self.values['deadband'],
            )
        )

    def _publish_gps(self, gps: GpsSentence) -> None:
        self._nmea.publish(String(data=gps.sentence))
        kind = convert.nmea_type(gps.sentence)
        fix = convert.nav_sat_fix(gps.sentence, *self._header())
        if fix is None:
            self._bad_sentences += kind in ('GGA', 'RMC')
            return
        self._gga_heard = self._gga_heard or kind == 'GGA'
        if kind == 'GGA' or not self._gga_heard:  # RMC has no altitude: only where it is all
            self._fix.publish(fix)

    # Requests: on the executor's thread, posted to the link thread.

    def _on_software_estop(self, message: Any) -> None:
        stop = message.data
        self.request('software_estop', lambda s, now: s.set_software_estop(stop, now), sticky=stop)

    def _on_set_feedback(self, message: Any) -> None:
        def rumble(session: Session, now: float) -> None:
            del now
            left, right = convert.rumble_sides(message)
            session.rumble(left=left, right=right)

        self.request(f'set_feedback {message.id}', rumble)

    def _on_set_user_value(self, message: Any) -> None:
        self.request(
            f'set_user_value {message.key}',
            lambda s, now: s.set_feedback(*convert.key_and_value(message)),
        )

    def _on_set_user_name(self, message: Any) -> None:
        self.request(
            f'set_user_name {message.key}',
            lambda s, now: s.set_name(*convert.key_and_text(message)),
        )

    def _on_display_text(self, message: Any) -> None:
        self.request('display_text', lambda s, now: s.set_display_text(message.data))

    def _on_get_user_value(self, message: Any) -> None:
        self.request(f'get_user_value {message.data}', lambda s, now: s.get_feedback(message.data))


def _make_transport(values: dict[str, Any]) -> Transport:
    """Return the port, not yet open. :raises ValueError: a parameter that it cannot take."""
    wire = make_wire(values)
    if isinstance(wire, CanWire):
        # Late: who has no CAN need not have python-can.
        from bridge_core.transports.can import CanTransport

        where, bitrate = (values['interface'], values['channel']), values['bitrate'] or None
        return CanTransport(*where, bitrate=bitrate, filters=wire.filters)
    if values['transport'] == 'hid':
        return HidrawTransport(values['port'], REPORT_SIZE)
    return SerialTransport(values['port'], values['baud'])


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([FortVscBridge]))


if __name__ == '__main__':
    main()
