# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Callbacks for ROS messages, called with whatever their types can hold.

The first byte of a read chooses the callback, the others fill the message's fields: NaN, infinite
and huge numbers, arrays of any length, any text. There is no middleware: a stand-in has what a
callback asks of its node, and the session or the arbiter behind it is the real one.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
import copy
from functools import partial
import math
import struct
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Twist, TwistStamped
from sensor_msgs.msg import JointState, Joy, JoyFeedback
from std_msgs.msg import (
    Bool,
    Float64,
    MultiArrayDimension,
    String,
    UInt8,
    UInt8MultiArray,
    UInt16,
    UInt16MultiArray,
)

from akron_can_bridge.node import AkronCanBridge
from akron_can_bridge.session import Session as AkronSession, Settings as AkronSettings
from assurance.fuzz.campaign import Target
from assurance.fuzz.mutate import Input, Kit, whole
from esi_drive_bridge.node import EsiDriveBridge
from esi_drive_bridge.session import Session as EsiSession
from fort_vsc_bridge.node import FortVscBridge
from fort_vsc_bridge.session import Session as FortSession, Settings as FortSettings
from rugged_teleop.why.rules import Monitor
from safety_mux.button import Presses
from safety_mux.intake import Intake
from safety_mux.mapping import forward_and_turn, JoyMapping, NamedJoints, Stick
from safety_mux.protocol import State
from safety_mux.settings import Autonomy, EStopSource, Feedback, MuxConfig, Operator, SpeedLimit
from safety_mux.stamps import StampWatch
from ssc_bridge.node import SscBridge
from ssc_bridge.session import Session as SscSession, Settings as SscSettings
from stage.esi_drive_rig import make_settings
from stage.safety_mux_bench import Bench, DRIVE
from stage.ssc_rig import PAN, TILT
from vm110_bridge.node import Vm110Bridge
from vm110_bridge.session import Session as Vm110Session, Settings as Vm110Settings

_NUMBERS = (
    *(0.0, -0.0, 1.0, -1.0, 0.5, 1.05, 1.0500001, -1.06, 3.0, 1e9),
    *(math.nan, math.inf, -math.inf, 1.7e308, -1.7e308, 5e-324),
)
_WORDS = (
    *('left', 'right', 'pan', 'tilt', 'nobody', '', '1', '-1', '90', '0x5', 'nan', '1e999'),
    *('9' * 5000, 'x' * 3000, '\0', 'ä\n', 'on', 'off', 'low', 'high', ' 1', '٣', '1_0', 'fort'),
)
_SIZES = (0, 1, 2, 3, 4, 6, 8, 16, 24, 3000)
_LONGEST = 1000  # characters of a text for people, whatever it cites


class Filler:
    """Fills the fields of messages from bytes; where they end, all is 0."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1] if self._at <= len(self._data) else 0

    def fill(self, message: Any) -> Any:
        """Fill and return it."""
        for name, kind in message.get_fields_and_field_types().items():
            setattr(message, name, self._value(kind, getattr(message, name)))
        return message

    def _value(self, kind: str, default: Any) -> Any:
        if kind.startswith('sequence<'):
            size = _SIZES[self.byte() % len(_SIZES)]
            item = kind[len('sequence<') : -1].split(',')[0]
            few = [self._item(item) for _ in range(min(size, 24))]
            return few * (size // len(few)) if few else []
        if hasattr(default, 'get_fields_and_field_types'):
            return self.fill(default)
        return self._item(kind)

    def _item(self, kind: str) -> Any:
        kind = kind.partition('<')[0]
        if kind in ('double', 'float'):
            return self._number(kind)
        if kind == 'boolean':
            return bool(self.byte() & 1)
        if kind == 'string':
            return _WORDS[self.byte() % len(_WORDS)]
        if kind in ('octet', 'byte'):
            return bytes((self.byte(),))
        if kind.startswith(('int', 'uint')):
            bits = int(kind.lstrip('uint'))
            raw = bytes(self.byte() for _ in range(min(bits // 8, 2)))
            return int.from_bytes(raw, 'little', signed=kind.startswith('int'))
        return self.fill(_ITEMS[kind]())

    def _number(self, kind: str) -> float:
        choice = self.byte()
        if choice >= 0xF0:
            raw = bytes(self.byte() for _ in range(8))
            number = float(struct.unpack('<d', raw)[0])
        elif choice >= 0x80:
            return (choice - 0xB8) / 0x38
        else:
            number = _NUMBERS[choice % len(_NUMBERS)]
        too_large = kind == 'float' and math.isfinite(number) and abs(number) > 3.4e38
        return math.copysign(math.inf, number) if too_large else number


_ITEMS: dict[str, Callable[[], Any]] = {
    'std_msgs/MultiArrayDimension': MultiArrayDimension,
    'diagnostic_msgs/DiagnosticStatus': DiagnosticStatus,
    'diagnostic_msgs/KeyValue': KeyValue,
}


Callback = tuple[str, Any, tuple[Any, ...]]  # its name, the message's type, what follows


class BridgeNode:
    """Has what callbacks of a bridge ask of their node; requests reach the session at once."""

    active = True

    def __init__(self, kind: Any, session: Any, **fields: Any) -> None:
        self._kind = kind
        self._session = session
        self.values = {each.name: each.default for each in kind.PARAMETERS} | fields
        self.refused = 0
        self.now = 100.0
        self.__dict__ |= fields

    def request(self, method: Callable[..., Any], *arguments: Any, **options: Any) -> int:
        del options
        try:
            getattr(self._session, method.__name__)(*arguments, self.now)
        except ValueError as error:  # a refusal, see BridgeNode.request
            self.refuse(str(error))
        return 1

    def refuse(self, text: str) -> None:
        assert len(text) < _LONGEST, 'a line without an end'
        self.refused += 1

    def on_refused(self, number: int, key: str, text: str) -> None:
        self.refuse(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._kind, name).__get__(self)


class CallbackTarget(Target):
    """The callbacks of one bridge's node: what makes no sense is refused, and nothing else."""

    lines = (60_000, 2000)
    most = 12_000

    def __init__(
        self,
        name: str,
        kind: Any,
        make: Callable[[], Any],
        callbacks: Sequence[Callback],
        **fields: Any,
    ) -> None:
        self.name = f'{name} callbacks'
        seeds = [bytes((n, 1, 2, 3, 4, 1, 2, 3, 4)) for n in range(len(callbacks))]
        self.kit = Kit([whole(*seeds)], [bytes((n,)) for n in range(32)], (0.0, 0.02, 0.3))
        self._kind = kind
        self._make = make
        self._callbacks = callbacks
        self._fields = fields

    def run(self, reads: Input) -> Hashable:
        """Hear messages; return which were refused."""
        session = self._session = self._make()
        node = BridgeNode(self._kind, session, **self._fields)
        session.opened(node.now)
        seen = set()
        for pause, data in reads:
            node.now += pause
            filler = Filler(data)
            number = filler.byte() % len(self._callbacks)
            name, kind, more = self._callbacks[number]
            before = node.refused
            getattr(node, name)(filler.fill(kind()), *more)
            seen.add((number, node.refused > before))
            _, frames = session.poll(node.now)
            assert len(frames) < 200, 'more than a line carries'
            for frame in frames:
                session.sent(frame, node.now)
        return frozenset(seen)

    def kept(self) -> Any:
        """Return the session."""
        return self._session


_MUX_CONFIG = MuxConfig(
    joints=2,
    sources=(EStopSource('fort'), EStopSource('drive')),
    operators=(Operator('fort', priority=1), Operator('senior', priority=2)),
    autonomy=Autonomy(),
    drives=('',),
    feedback=Feedback(('left', 'right')),
    speed_limits=(SpeedLimit('zone'),),
)
_MAPPING = JoyMapping((Stick(0), Stick(1)), (0,))


class MuxTarget(Target):
    """
    The mux's callbacks while an operator drives.

    No rule is broken, as the monitors tell. A stop, or a malformed message of whoever has
    control, ends the motion for good, as nobody resets: both are judged here, not by the mux.
    """

    name = 'mux callbacks'
    lines = (60_000, 2000)
    most = 8000
    _CALLBACKS: tuple[Callback, ...] = (
        ('_joy', Joy, ('fort',)),
        ('_joy', Joy, ('senior',)),
        ('_estop', Bool, ('fort',)),
        ('_own_estop', Bool, ('fort',)),
        ('_drive_enabled', Bool, ('',)),
        ('_limit', Float64, ('zone',)),
        ('_feedback', JointState, ()),
        ('_autonomy', Twist, ()),
        ('_autonomy', TwistStamped, ()),
        ('_autonomy', JointState, ()),
    )

    def __init__(self) -> None:
        drive = bytes((0, 0, 0, 0, 2, 4, 4, 1, 1, 0))
        seeds = [bytes((n, 1, 2, 3, 4, 1, 2, 3, 4)) for n in range(len(self._CALLBACKS))]
        self.kit = Kit(
            [whole(drive, *seeds), *(whole(drive, seed, drive) for seed in seeds)],
            [bytes((n,)) for n in range(32)],
            (0.0, 0.01, 0.02, 0.05, 0.3),
        )
        bench = Bench(_MUX_CONFIG)
        bench.limits = {'zone': 1.0}
        self._prepared = _driving(bench)

    def run(self, reads: Input) -> Hashable:
        """Hear messages while an operator drives; return the states and where it ended."""
        bench = self._bench = copy.deepcopy(self._prepared)
        self._monitor = Monitor(_MUX_CONFIG, [bench.limit] * _MUX_CONFIG.joints)
        intake = _intake(bench)
        states = {bench.decision.state}
        ended = False
        for pause, data in reads:
            filler = Filler(data)
            name, kind, more = self._CALLBACKS[filler.byte() % len(self._CALLBACKS)]
            message = filler.fill(kind())
            owner = bench.decision.owner
            intake._values = {'autonomy.type': kind.__name__, 'interface': 'velocity'}
            if getattr(intake, name)(*more, message, bench.now):
                bench.tick()
            ended |= name == '_estop' and message.data
            ended |= name == '_joy' and more == (owner,) and _is_malformed(message)
            self._check(bench, ended)
            for _ in range(round(pause / 0.01)):
                bench.now += 0.01
                self._check(bench, ended)
            states.add(bench.decision.state)
            words = bench.arbiter.status(bench.now).inhibits
            assert all(len(text) < _LONGEST for text in words), 'a line without an end'
        return frozenset(states), bench.decision.owner

    def _check(self, bench: Bench, ended: bool) -> None:
        decision = bench.tick()
        for broken in self._monitor.decided(decision, bench.now):
            raise AssertionError(f'rule {broken.rule}: {broken.words}')
        moves = any(decision.demand)
        assert not ended or decision.state is not State.ACTIVE, 'it goes on'
        assert not (ended and moves), 'it moves after a stop of category 0'

    def kept(self) -> Any:
        """Return the arbiter."""
        return self._bench.arbiter


def _is_malformed(joy: Any) -> bool:
    short = len(joy.axes) < 2 or len(joy.buttons) < 1
    return short or not all(abs(value) <= 1.05 for value in joy.axes)


def _driving(bench: Bench) -> Bench:
    """Have an operator drive with what is measured as it is commanded."""

    def measured(decision: Any) -> None:
        bench.arbiter.measured(decision.demand, bench.now)

    bench.run(0.6, measured)
    assert bench.reset().ok
    bench.run(0.4, measured)
    bench.samples['fort'] = DRIVE
    bench.run(0.7, measured)
    assert bench.decision.state is State.ACTIVE, bench.why()
    return bench


def _said(record: Callable[[str, Any, float], None]) -> Callable[[str, Any, float], None]:
    return lambda name, message, now: record(name, message.data, now)


def _intake(bench: Bench) -> Any:
    intake: Any = Intake.__new__(Intake)
    vars(intake).update(
        arbiter=bench.arbiter,
        mappings=dict.fromkeys(('fort', 'senior'), _MAPPING),
        presses={n: Presses((0,), _MAPPING.pressed_at) for n in ('fort', 'senior')},
        stamps={n: StampWatch(0.25, required=False) for n in ('fort', 'senior')},
        _own_estop=_said(bench.arbiter.own_estop_message),
        _drive_enabled=_said(bench.arbiter.drive_enabled),
        _limit=_said(bench.arbiter.speed_limit),
        _heard=lambda kind, name, message: None,
        _decision=bench.decision,
        _named=NamedJoints(('left', 'right')),
        _of_twist=forward_and_turn,
    )
    return intake


MESSAGES = (
    MuxTarget(),
    CallbackTarget(
        'vsc',
        FortVscBridge,
        partial(FortSession, FortSettings()),
        (
            ('_on_software_estop', Bool, ()),
            ('_on_set_feedback', JoyFeedback, ()),
            ('_on_set_user_value', KeyValue, ()),
            ('_on_set_user_name', KeyValue, ()),
            ('_on_display_text', String, ()),
            ('_on_get_user_value', UInt8, ()),
        ),
    ),
    CallbackTarget(
        'vm110',
        Vm110Bridge,
        partial(Vm110Session, Vm110Settings()),
        (
            ('_on_hold_output', Bool, ()),
            ('_on_periodic_output', UInt8MultiArray, ()),
            ('_on_send_command', UInt8MultiArray, ()),
            ('_on_command_done', UInt16, ()),
        ),
    ),
    CallbackTarget(
        'akron',
        AkronCanBridge,
        partial(AkronSession, AkronSettings()),
        (
            ('_on_cmd_joy', Joy, ()),
            ('_on_estop_in', Bool, ()),
            ('_on_soe_directions', UInt8, ()),
        ),
        _limited=False,
    ),
    CallbackTarget(
        'ssc',
        SscBridge,
        partial(SscSession, SscSettings(servos=(PAN, TILT))),
        (
            ('_on_pulse_command', UInt16MultiArray, ()),
            ('_on_servo_command', JointState, ()),
            ('_on_estop_in', Bool, ()),
            ('_on_aux_outputs', KeyValue, ()),
        ),
        _settings=SscSettings(servos=(PAN, TILT)),
        _sent=SimpleNamespace(commanded=False, aux_set=set()),
    ),
    CallbackTarget(
        'esi',
        EsiDriveBridge,
        partial(EsiSession, make_settings()),
        (
            ('_on_command', JointState, ()),
            ('_on_enable', Bool, ()),
            ('_on_estop_in', Bool, ()),
        ),
        _axes=make_settings().axes,
    ),
)
