# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The FORT VSC bridge: a wireless e-stop and remote as ROS topics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import reprlib
from typing import Any, ClassVar, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import BatteryState, Joy, JoyFeedback, NavSatFix
from std_msgs.msg import Int8, String, UInt8

from bridge_core.diagnostics import to_msg
from bridge_core.managed_node import latched_qos
from bridge_core.node import BridgeNode
from bridge_core.parameters import BRIDGE_PARAMETERS, Parameter
from bridge_core.report import Status
from bridge_core.runner import run
from bridge_core.session import Level
from fort_vsc_bridge import convert
from fort_vsc_bridge.display_texts import status_from
from fort_vsc_bridge.parameters import PARAMETERS
from fort_vsc_bridge.protocol.messages import Heartbeat, RemoteStatus
from fort_vsc_bridge.reasons import REASONS
from fort_vsc_bridge.session import (
    Event,
    GpsSentence,
    ModeChanged,
    RemoteState,
    Session,
    Sticks,
    UserValue,
)
from fort_vsc_bridge.session.report import device_state
from fort_vsc_bridge.wire import BRIDGE, STOP_HEARD

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from bridge_core.transports.request import ArgumentsT


class FortVscBridge(BridgeNode[Event]):
    """One VSC with its remote; see docs/devices/fort_vsc.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *PARAMETERS)
    BRIDGE = BRIDGE
    REASONS = REASONS
    TELLS_DEVICE = True

    def __init__(self, **options: Any) -> None:
        self._bad_sentences = 0
        self._gga_heard = False  # since the last RMC; the next remote may send none
        self._said: Heartbeat | None = None  # as told last
        self._remote: RemoteStatus | None = None  # likewise
        self._stop_heard = False  # ever, and so it has to be repeated for as long as this node is
        super().__init__('fort_vsc_bridge', **options)

    def create_interfaces(self) -> None:
        """Create what the manual's messages become."""
        self._joy = self.create_publisher(Joy, '~/joy', 10)
        self._mode = self.create_publisher(String, '~/mode', latched_qos())
        self._autonomy_mode = self.create_publisher(String, '~/autonomy_mode', latched_qos())
        self._radio_strength = self.create_publisher(Int8, '~/radio_strength', latched_qos())
        self._battery = self.create_publisher(BatteryState, '~/battery', latched_qos())
        self._fix = self.create_publisher(NavSatFix, '~/fix', 10)
        self._nmea = self.create_publisher(String, '~/nmea', 10)
        self._user_values = self.create_publisher(KeyValue, '~/user_values', 10)
        self.stop_input('~/software_estop', self._on_software_estop)
        self.asked_input(JoyFeedback, '~/set_feedback', self._on_set_feedback, 10)
        self.asked_input(KeyValue, '~/set_user_value', self._on_set_user_value, 10)
        self.asked_input(KeyValue, '~/set_user_name', self._on_set_user_name, 10)
        self.asked_input(String, '~/display_text', self._on_display_text, 10)
        self.asked_input(UInt8, '~/get_user_value', self._on_get_user_value, 10)
        if topic := self.values['show_status']:
            self.create_subscription(DiagnosticStatus, topic, self._on_status, latched_qos())

    def carried_over(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """What asked for stops has to be heard again, or its silence is one."""
        del values
        return {STOP_HEARD: self._stop_heard or self.stop_unheard}

    def forget_device(self) -> None:
        """Publish that nothing is known of the VSC."""
        self.on_event(ModeChanged(None))
        self.on_event(RemoteState(None))

    @property
    def hardware_name(self) -> str:
        """The port, or the CAN channel."""
        return str(self.values['channel' if self.values['transport'] == 'can' else 'port'])

    def on_event(self, event: Event) -> None:
        """Publish one event of the session."""
        if isinstance(event, Sticks):
            self._publish_sticks(event)
        elif isinstance(event, ModeChanged):
            self._publish_mode(event.heartbeat)
        elif isinstance(event, RemoteState):
            self._battery.publish(convert.battery_state(event.status, *self.header()))
            self._radio_strength.publish(convert.radio_strength(event.status))
            self._remote = event.status
            self.publish_device()
        elif isinstance(event, GpsSentence):
            self._publish_gps(event)
        elif isinstance(event, UserValue):
            self._user_values.publish(convert.user_value(event.key, event.value))

    def extra_values(self) -> dict[str, Any]:
        """Return how many GPS sentences could not be read."""
        return {'bad GPS sentences': self._bad_sentences}

    def _publish_mode(self, said: Heartbeat | None) -> None:
        modes = (each.mode if each else None for each in (said, self._said))
        mode, was = map(convert.mode_string, modes)
        self._said = said
        if mode != was:
            self.log(Level.OK, f'mode: {mode.data}, was {was.data}', site='mode')
        self._mode.publish(mode)
        self._autonomy_mode.publish(convert.mode_string(said.autonomy if said else None))
        self.publish_device()

    def device_state(self) -> Any:
        """Return what VSC and remote say of themselves."""
        state = Status(*device_state(self._said, self._remote))
        return to_msg(state, self.full_name, self.hardware_id)

    def _publish_sticks(self, sticks: Sticks) -> None:
        joy = convert.joy(
            sticks.axes,
            sticks.buttons,
            *self.header(),
            axis_full_scale=self.values['axis_full_scale'],
            deadband=self.values['deadband'],
        )
        self._joy.publish(self.vouched(joy))

    def _publish_gps(self, gps: GpsSentence) -> None:
        self._nmea.publish(String(data=gps.sentence))
        kind = convert.nmea_type(gps.sentence)
        fix = convert.nav_sat_fix(gps.sentence, *self.header())
        if fix is None:
            self._bad_sentences += kind in ('GGA', 'RMC')
            return
        if kind == 'GGA' or not self._gga_heard:  # RMC has no altitude: only where it is all
            self._fix.publish(fix)
        self._gga_heard = kind == 'GGA'

    # Requests.

    def on_distrusted(self, text: str) -> None:
        """Ask the VSC to stop at once: it is not known what ~/software_estop says."""
        del text
        self._ask_stop(True)

    def on_unheard(self, text: str) -> None:
        """Ask the VSC to stop; the topic is not in use by that."""
        del text
        self.request(Session.set_software_estop, True, key='software_estop', stop=True)

    def on_unheard_gone(self) -> None:
        """Go on as before, if nobody was ever heard."""
        if not self._stop_heard:
            self.request(Session.forget_software_estop, key='software_estop', stop=True)

    def _on_software_estop(self, message: Any) -> None:
        self._ask_stop(message.data)

    def _ask_stop(self, stop: bool) -> None:
        self._stop_heard = True
        self.request(Session.set_software_estop, stop, key='software_estop', stop=stop)

    def _on_set_feedback(self, message: Any) -> None:
        self._convert('set_feedback', message.id, convert.rumble_sides, message, Session.rumble)

    def _on_set_user_value(self, message: Any) -> None:
        self._convert(
            'set_user_value', message.key, convert.key_and_value, message, Session.set_feedback
        )

    def _on_set_user_name(self, message: Any) -> None:
        self._convert(
            'set_user_name', message.key, convert.key_and_text, message, Session.set_name
        )

    def _on_display_text(self, message: Any) -> None:
        self._convert(
            'display_text', 'lines', convert.display_text, message, Session.set_display_text
        )

    def _on_get_user_value(self, message: Any) -> None:
        key = f'get_user_value {message.data}'
        self.request(Session.get_feedback, message.data, key=key)

    def _on_status(self, message: Any) -> None:
        values = {pair.key: pair.value for pair in message.values}
        status = status_from(values, self._joy.topic_name)
        self.request(Session.hear_status, status, key='show_status')

    def _convert(
        self,
        topic: str,
        of: Any,
        arguments_of: Callable[[Any], tuple[Unpack[ArgumentsT]]],
        message: Any,
        method: Callable[[Session, Unpack[ArgumentsT], float], object],
    ) -> None:
        """Request what a message asks; of each key or motor (``of``) the latest wins."""
        if not self.active:
            return
        try:
            arguments = arguments_of(message)
        except ValueError as error:
            self.refuse(f'{topic} {reprlib.repr(of)}: {error}')
        else:
            self.request(method, *arguments, key=f'{topic} {reprlib.repr(of)}')


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([FortVscBridge]))


if __name__ == '__main__':
    main()
