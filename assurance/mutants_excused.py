# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Mutants that may survive, by file, as ``make mutants`` shows them; each with its reason."""

_SET_FIRST = 'it is set before it is read'
_NOT_READ = 'until it was heard, it is not usable, and its value not read'
_OF_PROCESSES = 'a wire with a process of its own reads it: test_process_link.py, test_runner.py'
_FOR_TYPES = 'the rest of the line is true of it; for the type checker'
_ABSTRACT = 'each kind has its own'
_FALSY = 'None is as false'
_WITH_SILENCE = 'it is read where there was a silence, and set with that'
_SELECTED = 'it is read of an owner only, and selecting it sets it'
_OWNED = 'without a ramp there is an owner in ACTIVE, and in no other state'
_SESSION_AND_PORT = 'there are both or neither; for the type checker'
_WAKES = 'any number wakes'
_LOOKS_AGAIN = 'what is left wakes it again and again, and the port is looked at all the same'
_NO_STDIN = 'descriptor 0 is the standard input'
_FOR_A_BYTE = 'it is asked for a byte'
_NO_NINTH = 'no frame of CAN has a ninth byte'
_IN_ONE_GO = 'so many bytes give the same in one go and in parts'
_JUST_THEN = 'at just that moment either will do'
_LONG_PAST = 'the clock is far beyond it'
_ALLOWED = 'the system may allow less, and either is much'
_IN_FORCE = 'what is in force is there since the command for it has ended'

EXCUSED: dict[str, dict[str, str]] = {
    'akron_can_bridge/convert.py': {
        '_deflection: abs(value) <= _BEYOND -> abs(value) < _BEYOND': (
            'axes of a Joy are float32, and none of those is exactly 1.05'
        ),
        '_pressed: switch and button -> button': 'switches are looked up from 1 on: 0 is none',
        'limits: 0 -> 1': 'no device has the type 0 or 1, so neither names an axis',
    },
    'vm110_bridge/convert.py': {
        'encoder: position + 2147483648 -> position - 2147483648': 'the same modulo 2 ** 32',
    },
    'fort_vsc_bridge/convert.py': {
        'nav_sat_fix: message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_UNKNOWN -> '
        'pass': 'unknown is 0, the default',
        '_gga: 6 -> 7': 'a position is the first four',
        '_rmc: 7 -> 8': 'a position is the first four',
        "_number: not text or text.strip('0123456789.-') -> text.strip('0123456789.-')": (
            'float refuses an empty text, too'
        ),
    },
    'safety_mux/protocol.py': {
        'Limiter.step: 1.0 -> 2.0': 'each limiter has its own',
        'Status: True -> False': 'the arbiter always says it',
    },
    'ssc_bridge/channels.py': {
        'Servo.pulse: position > 0.0 -> position >= 0.0': 'at 0 both ends give the centre',
    },
    'ssc_bridge/convert.py': {
        'position: offset > 0 -> offset >= 0': 'an offset of 0 is 0 on either scale',
        "_aux_request: dot and number.isdecimal() and (what in ('level', 'pulse', 'period')) -> "
        "number.isdecimal() and what in ('level', 'pulse', 'period')": (
            'without a dot there is nothing behind it, which is none of the three'
        ),
    },
    'bridge_core/gate.py': {
        'Gate.__init__: True -> False': 'until an input was heard it is stale, whatever it says',
        'Gate.__init__: False -> True': 'until an input was heard it is stale, whatever it says',
        'Gate.__init__: self._waits_until = math.inf -> pass': _SET_FIRST,
        'Gate.forget: False -> True': 'until an input was heard it is stale, whatever it says',
        'Gate.hear_enable: self.enable is not None and self.command is not None -> '
        'self.enable is not None or self.command is not None': _FOR_TYPES,
        'Gate.hear_enable: self.enable is not None and self.command is not None -> '
        'self.command is not None': _FOR_TYPES,
        'Gate.hear_enable: self.enable is not None and self.command is not None -> '
        'self.enable is not None': _FOR_TYPES,
    },
    'bridge_core/checksums.py': {
        'fletcher16: len(data) > _FLETCHER_CHUNK -> len(data) >= _FLETCHER_CHUNK': _IN_ONE_GO,
        'is_fletcher16: len(data) > _FLETCHER_CHUNK -> len(data) >= _FLETCHER_CHUNK': _IN_ONE_GO,
        'is_fletcher16: not (plain ^ sums) & 255 and fletcher16(data) == sums -> '
        'fletcher16(data) == sums': 'the plain sum is a part of both',
    },
    'bridge_core/framing.py': {
        'Decoder.feed: raise NotImplementedError -> pass': _ABSTRACT,
        'StreamParser._scan: start < len(buffer) -> start <= len(buffer)': (
            'nothing is found in nothing'
        ),
        'StreamParser._size: return 0 -> return None': _FALSY,
        'StreamParser._header_begins: len(header) - 1 -> len(header) + 1': (
            'a whole header would have been found'
        ),
    },
    'bridge_core/lane.py': {
        'Lane.call: thread is None or thread is threading.current_thread() or (not '
        'thread.is_alive()) or self.fault.done() -> thread is None or thread is '
        'threading.current_thread() or (not thread.is_alive())': 'a thread with a fault ends',
        '_exists: return False -> return None': _FALSY,
        ': 0.4 -> 1.4': 'a time that others can wait for',
        ': 10000 -> 10001': 'a great many',
    },
    'bridge_core/rclpy_inner.py': {
        "waiter_of: node.get_logger().info(f'{name}: by the executor of rclpy, whose wait set is "
        "another') -> pass": 'a line of the log',
        'NotForExecutors.can_execute: return False -> return None': _FALSY,
        'NotForExecutors.beginning_execution: return False -> return None': _FALSY,
        ': 20 -> 21': 'a few of one topic',
        '_WaitSetWaiter.wait: 1 -> 2': 'any number below 0 waits for ever',
        '_WaitSetWaiter.wait: 1000000000.0 -> 1000000001.0': 'it waits a billionth longer',
        '_WaitSetWaiter._release: self._set = None -> pass': 'another set follows, or the end',
        '_ExecutorWaiter.__init__: False -> True': 'its node has one thing more, not used',
        '_ExecutorWaiter.close: self._executor.shutdown() -> pass': 'nobody spins it any more',
        'wait_set_works: return False -> return None': _FALSY,
        'wait_set_works: 0 -> 1': 'a set with room for one more; a wait of a nanosecond',
        'make_wait_set: 0 -> 1': 'a set with room for one more',
        'make_wait_set: 1 -> 2': 'a set with room for one more',
    },
    'bridge_core/packets.py': {
        ": _M = TypeVar('_M', bound='Message') -> pass": _FOR_TYPES,
    },
    'bridge_core/publishers.py': {
        'PublisherWatch.heard: sequence_number is None or self.blind -> self.blind': _FOR_TYPES,
    },
    'bridge_core/session.py': {
        'HeldButtons.of: button or 0 -> button': _FOR_TYPES,
        'Session.__init__: -math.inf -> math.inf': 'the first step looks at everything either way',
        "Session.__init__: self._interruption = '' -> pass": _SET_FIRST,
        'Session._take_repeated: return False -> return None': _FALSY,
        'Session._step: self._stepped_at <= now < self._quiet_until -> '
        'self._stepped_at < now < self._quiet_until': 'it looks once more, and finds the same',
    },
    'bridge_core/transports/link.py': {
        ': 60.0 -> 61.0': 'for a machine that is starved; any minute does',
        'Link.__init__: 1.0 -> 2.0': 'each node has its parameter reconnect_period',
        'Link.__init__: 0 -> 1': _OF_PROCESSES,
        'Link._put: raise NotImplementedError -> pass': _ABSTRACT,
        'Mailbox.close: 1 -> 2': 'any number below 0 is no descriptor',
        'Link._run: raise NotImplementedError -> pass': _ABSTRACT,
        'Link._end: raise NotImplementedError -> pass': _ABSTRACT,
        'ThreadLink.__init__: self._tap >= 0 -> self._tap > 0': _NO_STDIN,
        'ThreadLink.__init__: 0 -> 1': _NO_STDIN,
        'Link.__init__: self.device = device -> pass': _OF_PROCESSES,
        'Link.__init__: self._rt_priority = rt_priority -> pass': _OF_PROCESSES,
        'Link.__init__: 1 -> 2': 'any numbers do that are not the same',
        'Mailbox.put: 1 -> 2': _WAKES,
        'Mailbox.end: 1 -> 2': _WAKES,
        'Mailbox.close: self._wake_fd >= 0 -> self._wake_fd > 0': _NO_STDIN,
        'Mailbox.close: 0 -> 1': _NO_STDIN,
    },
    'bridge_core/supervisor.py': {
        'Supervisor.__init__: self.word = Word.NONE -> pass': _SET_FIRST,
        'Supervisor.__init__: -math.inf -> math.inf': _SET_FIRST,
        'Supervisor.__init__: 0.0 -> 1.0': _LONG_PAST,
        'Supervisor.is_news: now <= self._said_at + self._times.silence -> '
        'now < self._said_at + self._times.silence': _JUST_THEN,
        'Supervisor.failed: now >= self._sound_at -> now > self._sound_at': _JUST_THEN,
        'Supervisor.recovered: now < self._sound_at -> now <= self._sound_at': _JUST_THEN,
        'Supervisor.is_sound: now >= self._sound_at -> now > self._sound_at': _JUST_THEN,
        'Supervisor.doubt: 0.0 -> 1.0': _LONG_PAST,
        'Orders.give: self._activation is None or self._activation.number not in self._open -> '
        'self._activation is None': _IN_FORCE,
        'Orders.give: self._before = self._activation -> pass': _IN_FORCE,
        'Orders._settle: newest.number <= command.number -> newest.number < command.number': (
            'each command has a number of its own'
        ),
        'Orders.all: activation is not None and activation.number in self._open -> '
        'activation is not None': _IN_FORCE,
    },
    'bridge_core/transports/child.py': {
        ': 1 -> 2': _ALLOWED,
        ': 20 -> 21': _ALLOWED,
        'Child.ends: return False -> return None': _FALSY,
        "environment: sys.modules[name].__file__ or '' -> sys.modules[name].__file__": _FOR_TYPES,
    },
    'bridge_core/transports/process.py': {
        ': 1024 -> 1025': 'a great many',
        'ProcessLink.__init__: 0 -> 1': 'it wakes once more',
        'ProcessLink.__init__: 0.0 -> 1.0': _LONG_PAST,
        'ProcessLink._wake: self._wake_fd >= 0 -> self._wake_fd > 0': _NO_STDIN,
        'ProcessLink._wake: 0 -> 1': _NO_STDIN,
        'ProcessLink._wake: 1 -> 2': _WAKES,
        'ProcessLink._wait_and_step: now - meant > _LATE -> now - meant >= _LATE': _JUST_THEN,
        'ProcessLink._read: return False -> return None': _FALSY,
        'ProcessLink._judge: self._wire is not None and (not self._state.trouble) and '
        '(now >= self._hangs_at()) -> not self._state.trouble and now >= self._hangs_at()': (
            'without a wire there is no end of its silence; for the type checker'
        ),
        'ProcessLink._judge: self._wire is not None and now >= self._state.kill_at() -> '
        'now >= self._state.kill_at()': (
            'without a wire there is no end of its silence; for the type checker'
        ),
        'ProcessLink._new_process: n >= 0 -> n > 0': _NO_STDIN,
        'ProcessLink._new_process: before >= 0 -> before > 0': _NO_STDIN,
        'ProcessLink._new_process: 0 -> 1': _NO_STDIN,
        'ProcessLink.stop: self._wake_fd >= 0 -> self._wake_fd > 0': _NO_STDIN,
        'ProcessLink.stop: 0 -> 1': _NO_STDIN,
        'ProcessLink.stop: 1 -> 2': 'any number below 0 is no descriptor',
    },
    'bridge_core/transports/wire_process.py': {
        ': 1 -> 2': _ALLOWED,
        ': 20 -> 21': _ALLOWED,
        ': 64 -> 65': 'the port has its turn, one request later',
        'receive: 2 -> 3': 'unread messages are told once',
        'receive: continue -> pass': 'it is the last of the loop',
        'receive: break -> pass': 'it fails once more',
        'Node.__init__: self._told_at = 0.0 -> pass': _SET_FIRST,
        'Node.__init__: 0.0 -> 1.0': _SET_FIRST,
        'Node.wait_for_turn: return False -> return None': _FALSY,
        'Node.take: raise EOFError -> pass': 'the end is found once more',
        'Node._tell: 0.0 -> 1.0': _LONG_PAST,
        'Node._tell: return False -> return None': _FALSY,
        '_show: comm.write(name) -> pass': 'test_process_link.py asks ps for the name',
        'load: gc.freeze() -> pass': 'the collector looks at more, and finds the same',
        'run: tap >= 0 -> tap > 0': _NO_STDIN,
        'run: 0 -> 1': _NO_STDIN,
    },
    'bridge_core/transports/active.py': {
        'Active._deliver: clock.now() - now <= FROZEN_TIME -> clock.now() - now < FROZEN_TIME': (
            'a freeze is no more exact'
        ),
        'Active.say_farewell: clock.now() < end -> clock.now() <= end': (
            'one try more, at just that moment'
        ),
    },
    'bridge_core/transports/opener.py': {
        'Opener.heard: 64 -> 65': 'what is left wakes it once more',
    },
    'bridge_core/transports/wire.py': {
        'Wire._deactivate: now = clock.now() -> pass': (
            'what is before it has just begun, or has waited for long enough'
        ),
        ': 1.0 -> 2.0': 'the longest wait: the next look at the levels is due sooner',
        'Wire.__init__: self._backoff = BACKOFF_START -> pass': _SET_FIRST,
        'Wire.run: self._stepped_at = clock.now() -> pass': 'without a port no freeze counts',
        'Wire._wait: self._active is not None and self.status.is_open -> '
        'self.status.is_open': _SESSION_AND_PORT,
        'Wire.interrupt: self._active is not None and self.status.is_open -> '
        'self.status.is_open': _SESSION_AND_PORT,
        'Wire._wait_for_port: self._opener.heard() -> pass': _LOOKS_AGAIN,
        'Wire._port: -1 -> 1': 'it is asked of an open port',
        'Wire._port: 1 -> 2': 'it is asked of an open port',
    },
    'fort_vsc_bridge/protocol/can.py': {
        ': CanMessage = BasicJoystick | ExtendedJoystick | Heartbeat | RemoteStatus | '
        'UserFeedback | StringSegment -> pass': _FOR_TYPES,
        ': 8 -> 9': _NO_NINTH,
        '_Sticks.__init__: self._since = 0.0 -> pass': _SET_FIRST,
        '_Sticks.__init__: self._alike_at = 0.0 -> pass': _SET_FIRST,
        '_Sticks.__init__: 0.0 -> 1.0': _SET_FIRST,
    },
    'fort_vsc_bridge/protocol/frames.py': {
        ': 1 -> 2': 'a longer payload than max_length is refused before',
    },
    'fort_vsc_bridge/protocol/hid.py': {
        ': 1 -> 2': 'a pad is pressed by any number but 0',
    },
    'fort_vsc_bridge/protocol/values.py': {': 256 -> 257': _FOR_A_BYTE},
    'fort_vsc_bridge/protocol/serial.py': {
        **dict.fromkeys(
            (
                'SerialDecoder.feed: stream.count(PACKETS.header) > self.counters.frames - frames '
                '-> stream.count(PACKETS.header) >= self.counters.frames - frames',
                'SerialDecoder._unexpected: size - start < HEAD_SIZE -> size - start <= HEAD_SIZE',
            ),
            'it searches more often or later, and finds the same',
        ),
        'SerialDecoder.feed: 1 -> 2': 'both bytes together are no header',
        'SerialDecoder._unexpected: 1 -> 2': 'no header begins at the second byte of one',
    },
    'fort_vsc_bridge/protocol/wires.py': {
        'CanWire.check: isinstance(message, UserFeedback) and message.key == '
        'Key.USER_ESTOP_TIMEOUT -> message.key == Key.USER_ESTOP_TIMEOUT': (
            'all that CAN carries has a key, and no text has that one'
        ),
        "SerialWire: NAME = 'serial' -> pass": (
            'it is read where a wire lacks something, and this one lacks nothing'
        ),
        'Wire.decoder: raise NotImplementedError -> pass': _ABSTRACT,
        'Wire.frames: raise NotImplementedError -> pass': _ABSTRACT,
    },
    'fort_vsc_bridge/session/device.py': {
        '_KeySetting.__init__: self._questions = 0 -> pass': _SET_FIRST,
        '_KeySetting.__init__: 0 -> 1': _SET_FIRST,
        '_IntervalSetting.__init__: -math.inf -> math.inf': _SET_FIRST,
        '_IntervalSetting.__init__: self._count = 0 -> pass': _SET_FIRST,
        '_Setting._found: return False -> return None': _FALSY,
        '_IntervalSetting.__init__: 0 -> 1': _SET_FIRST,
        '_IntervalSetting.__init__: 0.0 -> 1.0': _SET_FIRST,
        '_IntervalSetting.poll: 0 -> 1': 'no interval is of 1 ms',
        '_IntervalSetting._matches: return False -> return None': _FALSY,
    },
    'fort_vsc_bridge/session/session.py': {
        "Session.__init__: self._rejection = '' -> pass": _SET_FIRST,
        'Session.__init__: self._joystick_alone = False -> pass': _SET_FIRST,
        'Session.__init__: False -> True': _SET_FIRST,
        'Session._silence: wire.GARBLED and self._garbled(now) -> self._garbled(now)': (
            'of the wire without these words every read is a frame'
        ),
        'Session._forget: self._joystick_heard.reset() -> pass': (
            'it has expired by the time at which it is read again'
        ),
        'Session.__init__: self._settled_at = math.inf -> pass': _SET_FIRST,
        **{
            f'Session.{name}: self._expire(now) -> pass': 'it expires nothing, and a poll follows'
            for name in (
                *('set_software_estop', 'set_feedback', 'set_name', 'set_display_text'),
                *('get_feedback', 'rumble', 'forget_software_estop'),
            )
        },
    },
    'fort_vsc_bridge/session/software_stop.py': {
        'SoftwareStop.__init__: self._wanted = False -> pass': _SET_FIRST,
        'SoftwareStop.__init__: False -> True': _SET_FIRST,
        'SoftwareStop.want: before or self._remedy(now) -> before': (
            'a stop that stands when the next call comes is owed then'
        ),
        "SoftwareStop._remedy: return '' -> return None": _FALSY,
    },
    'fort_vsc_bridge/session/stops.py': {
        'StopJudge.__init__: False -> True': _SET_FIRST,
        'StopJudge.__init__: 0.0 -> 1.0': _SET_FIRST,
        'StopJudge.asked: self._asked and (not remedy) -> self._asked': (
            'it is read once nothing is asked, and set anew then'
        ),
    },
    'ssc_bridge/protocol/messages.py': {
        ": _P = TypeVar('_P', bound='_Pulses') -> pass": _FOR_TYPES,
    },
    'ssc_bridge/protocol/values.py': {
        'UnknownFunction.__post_init__: 0 -> 1': 'a word of 0 is a known function',
    },
    'ssc_bridge/session/auxiliary.py': {
        'AuxOutputCommands.__init__: self._undone_levels = False -> pass': _SET_FIRST,
        'AuxOutputCommands.__init__: False -> True': _SET_FIRST,
        ": _T = TypeVar('_T', DigitalOutput, PulseOutput) -> pass": _FOR_TYPES,
        'counts_of: 1 -> 2': 'either is too many',
        'AuxInputTotals.configure: False -> True': _SET_FIRST,
        '_after: measured is None or not isinstance(before.function, PulseAccumulator) -> '
        'not isinstance(before.function, PulseAccumulator)': (
            'what fits the configuration has a measurement of each; for the type checker'
        ),
        'AuxOutputCommands._is_one_shot: isinstance(function, PulseOutput) and function.one_shot '
        '-> function.one_shot': _FOR_TYPES,
        'AuxOutputCommands.stop: isinstance(function, DigitalOutput) and function.initially_high '
        '-> function.initially_high': _FOR_TYPES,
    },
    'ssc_bridge/session/outputs.py': {
        ': 3 -> 4': 'one may be lost; three or four',
        'Channel.__init__: 0.0 -> 1.0': _SET_FIRST,
        'Channel.__init__: self._target = 0.0 -> pass': _SET_FIRST,
        'Outputs.__init__: 0 -> 1': _SET_FIRST,
        'Outputs.__init__: self._releases = 0 -> pass': _SET_FIRST,
    },
    'ssc_bridge/session/polling.py': {
        'Poller.__init__: self._due = dict.fromkeys(rates, math.inf) -> pass': _SET_FIRST,
    },
    'ssc_bridge/session/session.py': {
        'Session.__init__: self._settled_at = math.inf -> pass': _SET_FIRST,
        'Session.claim_outputs: self._refresh(now) -> pass': (
            'messages are paced, whether there is anything to release or not'
        ),
        'Session.claim_aux: self._refresh(now) -> pass': 'no verdict depends on what is claimed',
        'Session.follow_on_aux: -math.inf -> math.inf': (
            'the configuration begins it anew; before it, only a farewell asks'
        ),
        'Session._forget: self.sticks.heard.reset() -> pass': (
            'it matters once sticks are published again, which feeds it'
        ),
        'Session._forget_device: self.sticks.faulty = () -> pass': (
            'a stop follows, and the neutral sticks that it owes clear it'
        ),
        'Session._take_checked: self._confirmed and self.link_up and self.configuration -> '
        'self._confirmed and self.configuration': 'nothing is confirmed while the link is down',
        'Session._take_checked: self._confirmed and self.link_up and self.configuration -> '
        'self._confirmed and self.link_up': 'what is confirmed is known; for the type checker',
        'Session._judge: state is not None and state in self.settings.stop_states -> '
        'state in self.settings.stop_states': 'None is none of them; for the type checker',
        'Session._follow: not self.link_up and self.status is not None -> not self.link_up': (
            'without a status all that is forgotten already'
        ),
    },
    'ssc_bridge/session/settings.py': {
        'Settings._check_calibration: low <= axis.min_us < axis.max_us <= high -> '
        'low <= axis.min_us <= axis.max_us <= high': 'the axis has its centre between them',
    },
    'ssc_bridge/session/sticks.py': {
        'sticks_of: 0 -> 1': 'the session puts those of HeldButtons there',
        'buttons_of: us[button.channel - 1] or 0 -> us[button.channel - 1]': _FOR_TYPES,
        'buttons_of: 0 -> 1': _FOR_TYPES,
    },
    'akron_can_bridge/session/asker.py': {
        'Asker._takes: return False -> return None': _FALSY,
    },
    'akron_can_bridge/session/drive.py': {
        'Drive.__init__: False -> True': 'a press begins with a pause, which sets it',
    },
    'akron_can_bridge/session/finder.py': {
        'Finder.__init__: self._owes_request = True -> pass': _SET_FIRST,
        'Finder.__init__: True -> False': _SET_FIRST,
        'Finder.keep: return False -> return None': _FALSY,
        'Finder.claimed: source != fixed or is_ours -> is_ours': (
            'a claim of another address that is not ours ends the same below'
        ),
        'Finder.heard_after: silence >= _RESTART_SILENCE -> silence > _RESTART_SILENCE': (
            'no unit restarts in that very time'
        ),
        'Finder.rivals: self.unit is None or self._settings.device_pin -> self.unit is None': (
            'no other PIN is the one that was given'
        ),
        'Finder._is_ours: self.unit is None or source in self._others() -> '
        'source in self._others()': 'a name has a number in common with none',
        'Finder._has_identity: self.unit is not None and name.manufacturer == AKRON_BRASS and '
        '(name.identity == self.unit.identity) -> name.manufacturer == AKRON_BRASS and '
        'name.identity == self.unit.identity': _FOR_TYPES,
        'Finder.__init__: self._asked_at = -math.inf -> pass': _SET_FIRST,
        'Finder.__init__: -math.inf -> math.inf': _SET_FIRST,
        'Finder.__init__: self._due = math.inf -> pass': _SET_FIRST,
        "Finder.announced: return '' -> return None": _FALSY,
    },
    'akron_can_bridge/session/motion.py': {
        'Demand.__init__: True -> False': 'what it is not told yet is a stop',
        'Motion.__init__: -math.inf -> math.inf': (
            'without a step there is no motion, and the first step sets when that began'
        ),
    },
    'akron_can_bridge/session/joysticks.py': {
        'Joysticks.__init__: self._extended = _NO_EXTENDED -> pass': _SET_FIRST,
        'Joysticks.hear_sticks: True -> False': 'its sticks always count: silence alone is owed',
        '_is_of_vsc: unused or () -> unused': _FOR_TYPES,
        'Joysticks.pushes: at in allowed and at in self._rested -> at in self._rested': (
            'one that nobody allowed is a stop, in which this is not asked'
        ),
    },
    'akron_can_bridge/session/session.py': {
        'Session._due_frames: self.demand.withheld or self.drive.forbidden(now, self._holds()) -> '
        'self.demand.withheld': 'whatever forbids motion withholds it in the same step',
        'Session.set_directions: self._expire(now) -> pass': 'the refresh at its end does it',
        'Session.limit_directions: self._expire(now) -> pass': 'the refresh at its end does it',
        'Session.limit_directions: self._refresh(now) -> pass': 'no verdict depends on directions',
        'Session.take_over: self._expire(now) -> pass': 'the refresh at its end does it',
        'Session.set_directions: self._refresh(now) -> pass': 'no verdict depends on directions',
        'Session.__init__: False -> True': (
            'until all was clear once nothing is paused; and who asks for a reset sets the other'
        ),
        'Session._concerns_us: return False -> return None': _FALSY,
        'Session._take_proprietary: isinstance(message, protocol.MiniOutputs) and '
        'self.settings.unit_type != MINI_UNIVERSAL -> self.settings.unit_type != MINI_UNIVERSAL': (
            'of neighbours come types 84, 85 and FF, and Unit keeps no FF'
        ),
    },
    'akron_can_bridge/session/report.py': {
        '_bus_warnings: rivals and finder.unit is not None -> rivals': _FOR_TYPES,
    },
    'akron_can_bridge/session/settings.py': {
        'Settings.__post_init__: self.allowed_joysticks <= set(JOYSTICK_ADDRESSES) -> '
        'self.allowed_joysticks < set(JOYSTICK_ADDRESSES)': (
            'all of them include our own, which is refused below'
        ),
        'Settings.__post_init__: 0 -> 1': 'neither is more than 12',
    },
    'akron_can_bridge/session/stops.py': {
        f"{function}: return '' -> return None": _FALSY
        for function in ('_enable_missing', '_mini_faulted', '_motor_fault')
    },
    'akron_can_bridge/protocol/fields.py': {
        'statuses.unpack: 3 -> 4': 'only the last ones count',
    },
    'akron_can_bridge/session/unit.py': {
        'Unit.wants_fault_poll: return False -> return None': _FALSY,
        'Unit.wants_fault_poll: now < self._faults_at + FAULT_PERIOD -> '
        'now <= self._faults_at + FAULT_PERIOD': 'the poll is due now or a moment later',
        'Unit.limits: 0 -> 1': 'any angle, as long as it stays',
        ": M = TypeVar('M', bound=Message) -> pass": _FOR_TYPES,
    },
    'akron_can_bridge/protocol/broadcasts.py': {'AddressAnnouncement: 9 -> 10': _NO_NINTH},
    'akron_can_bridge/protocol/frames.py': {
        ": _M = TypeVar('_M', bound='Message') -> pass": _FOR_TYPES,
        'Message._from_payload: raise NotImplementedError -> pass': _ABSTRACT,
        'Writable.__init_subclass__: super().__init_subclass__(**options) -> pass': (
            'the bases do nothing there'
        ),
    },
    'akron_can_bridge/protocol/values.py': {': 256 -> 257': _FOR_A_BYTE},
    'vm110_bridge/session/serials.py': {
        **dict.fromkeys(
            ['SerialNumbers._start: WINDOW - 1 -> WINDOW + 1', 'SerialNumbers._start: 1 -> 2'],
            'what is beyond the window is not looked at',
        ),
        ': 1 -> 2': 'no number is more than half of all behind another',
        'SerialNumbers._has_restarted: return False -> return None': _FALSY,
        **{
            f'SerialNumbers.__init__: {change}': _SET_FIRST
            for change in (
                *('self._seen = 0 -> pass', 'self._length = 0 -> pass', '0 -> 1', '0.0 -> 1.0'),
                *('self._count_gap = True -> pass', 'True -> False'),
                'self._run_start = self._run_at = 0.0 -> pass',
            )
        },
    },
    'vm110_bridge/protocol/frames.py': {
        ": _M = TypeVar('_M', bound='Message') -> pass": _FOR_TYPES,
        'Message._from_payload: raise NotImplementedError -> pass': _ABSTRACT,
        'Message._to_payload: raise NotImplementedError -> pass': _ABSTRACT,
    },
    'vm110_bridge/protocol/messages.py': {
        ": _C = TypeVar('_C', bound='_Command') -> pass": _FOR_TYPES,
        ": _A = TypeVar('_A', bound='_Acknowledge') -> pass": _FOR_TYPES,
        'burst: 1 -> 2': 'from 0, it is one packet with either',
    },
    'vm110_bridge/session/outbox.py': {
        'CommandOutbox.due: self._outstanding is None or now < self.sends_at -> '
        'now < self.sends_at': _FOR_TYPES,
    },
    'vm110_bridge/session/session.py': {
        'Session.__init__: self._has_news = False -> pass': _SET_FIRST,
        'Session.__init__: False -> True': _SET_FIRST,
        'Session.forget_hold_output: self._refresh(now) -> pass': 'the poll that follows does it',
        'Session.faulty: self.vrpi is not None and self.enabled -> self.enabled': _FOR_TYPES,
        **{
            f'Session.{name}: self._expire(now) -> pass': (
                'it depends on no verdict, and a poll follows'
            )
            for name in (
                *('set_periodic_output', 'command_published', 'command_done'),
                'forget_hold_output',
            )
        },
    },
    'vm110_bridge/session/controls.py': {
        '_is_enabled: vrpi is not None and vrpi.ru_state == RuState.ENABLED and '
        '(vrpi.ru_disabled == Disabled.ENABLED) -> vrpi.ru_state == RuState.ENABLED and '
        'vrpi.ru_disabled == Disabled.ENABLED': _FOR_TYPES,
    },
    'vm110_bridge/session/stops.py': {
        'StopJudge.__init__: False -> True': 'the state Initial hides it until it is set',
        'StopJudge.__init__: self._taken_at = self._armed_at = now -> pass': (
            'the state Initial hides them until they are set'
        ),
        'StopJudge.__init__: 0.0 -> 1.0': 'both are below LEAST_SILENCE',
        'StopJudge.__init__: -math.inf -> math.inf': _WITH_SILENCE,
        'StopJudge.__init__: self._released_at = -math.inf -> pass': _WITH_SILENCE,
        'StopJudge.hold: self._holding and (not holding) -> self._holding': (
            'it is read once nothing is held, and set anew then'
        ),
    },
    'vm110_bridge/session/encoder.py': {
        'Encoder.__init__: 0 -> 1': _SET_FIRST,
        'Encoder.__init__: self._last = 0 -> pass': _SET_FIRST,
        'Encoder.read: value - self._last + 128 -> value - self._last - 128': (
            'the same modulo 256'
        ),
    },
    'safety_mux/outputs.py': {
        'Repeated.__init__: self._due = -math.inf -> pass': _SET_FIRST,
        'Repeated.__init__: -math.inf -> math.inf': _SET_FIRST,
        'Repeated.say: value != self._value or self._message is None -> value != self._value': (
            'no value is None'
        ),
    },
    'safety_mux/arbiter.py': {
        'Arbiter.__init__: False -> True': _SET_FIRST,
        'Arbiter.__init__: self._owner_since = 0.0 -> pass': _SET_FIRST,
        'Arbiter.__init__: self._stopping_since = 0.0 -> pass': _SET_FIRST,
        'Arbiter.__init__: self._settled = False -> pass': _SET_FIRST,
        'Arbiter.__init__: 0.0 -> 1.0': _SET_FIRST,
        'Arbiter.select_autonomy: self.autonomy.problem(now) or self.autonomy.lapse -> '
        'self.autonomy.problem(now)': 'a lapse also ends the rest, which is missing then',
        'Arbiter.tick: 0.0 -> 1.0': 'the first tick is STOPPED, at zero',
        'Arbiter._drop_requests: self.through_zero = False -> pass': _SET_FIRST,
        'Arbiter._drop_requests: False -> True': _SET_FIRST,
        'Arbiter.still_clearing: self.state is not State.STOPPED or clear >= limit -> clear >= '
        'limit': 'every other state began with a reset, so all had been clear for long',
        'Arbiter._output: self.state is State.ACTIVE and self.owner is not None -> '
        'self.state is State.ACTIVE or self.owner is not None': _OWNED,
        'Arbiter._output: self.state is State.ACTIVE and self.owner is not None -> '
        'self.owner is not None': _OWNED,
        'Arbiter._output: self.state is State.ACTIVE and self.owner is not None -> '
        'self.state is State.ACTIVE': _OWNED,
        'Arbiter._output: self.feedback is not None and to_zero and ends and in_motion and '
        '(not any(demand)) -> to_zero and ends and in_motion and (not any(demand))': (
            'without feedback what is at zero is not in motion'
        ),
    },
    'safety_mux/resets.py': {
        'ResetCalls.script: self.last is None or not self.go_on -> not self.go_on': _FOR_TYPES,
        "ResetCalls.script: return '' -> return None": _FALSY,
    },
    'safety_mux/stops.py': {
        "Stops.counts: source.config.operator or '' -> source.config.operator": _FOR_TYPES,
    },
    'safety_mux/inputs.py': {
        'Input.use: raise NotImplementedError -> pass': _ABSTRACT,
        'Input.count_as_silent: self.drop_requests() -> pass': (
            'a freeze also stops, and every stop drops them'
        ),
        'SourceInput.__init__: True -> False': _NOT_READ,
        'SpeedLimitInput.__init__: 1.0 -> 2.0': 'until it was heard the lowest counts, if less',
    },
    'safety_mux/owners.py': {
        'OwnerInput.at_rest: raise NotImplementedError -> pass': _ABSTRACT,
        'OwnerInput.given_up: raise NotImplementedError -> pass': _ABSTRACT,
        'OperatorInput.count_as_silent: self.newest = None -> pass': 'silence hides it anyway',
        'Run.__init__: self.until = 0.0 -> pass': _SET_FIRST,
        'Run.__init__: 0.0 -> 1.0': _SET_FIRST,
        'OwnerInput.rested: self.rest.since is not None and self.rest.length >= self.neutral_time '
        '-> self.rest.length >= self.neutral_time': 'without a sample the length is 0',
        'OperatorInput.__init__: self.pressed = False -> pass': 'the first sample sets it',
        'OperatorInput.__init__: False -> True': 'the first sample sets it',
        'OperatorInput.sample: self.drop_requests() -> pass': (
            'a fault did so when it came, and nothing is kept while it lasts'
        ),
        'OperatorInput.at_rest: self.newest is not None and self.newest.at_rest -> '
        'self.newest.at_rest': 'it is asked of what is fresh and valid only',
        'OperatorInput.advice: self.newest is not None and self.newest.deadman -> '
        'self.newest.deadman': 'it is asked of what is fresh and valid only',
        'AutonomyInput.__init__: self.selected = False -> pass': _SELECTED,
        'AutonomyInput.__init__: False -> True': _SELECTED,
        'AutonomyInput.drop_requests: self.selected = False -> pass': _SELECTED,
        'AutonomyInput.drop_requests: False -> True': _SELECTED,
    },
    'safety_mux/feedback.py': {
        'FeedbackInput.__init__: self._at_zero = False -> pass': _SET_FIRST,
        'FeedbackInput.__init__: False -> True': _SET_FIRST,
    },
    'safety_mux/limits.py': {
        'JointLimiter._joined: self._values[n] * target[n] -> self._values[n] / target[n]': (
            'it is asked for the sign, and the target is not 0'
        ),
        **dict.fromkeys(
            [
                'JointLimiter._joined: 1.0 -> 2.0',
                'JointLimiter._joined: share < 1.0 -> share <= 1.0',
            ],
            'no joint is faster than alone either way',
        ),
        **dict.fromkeys(
            [
                '_together: len(group) > 1 and all((limits[n].together and (not limits[n].jerk) '
                'for n in group)) -> all((limits[n].together and (not limits[n].jerk) for n in '
                'group))',
                '_together: len(group) > 1 -> len(group) >= 1',
            ],
            'alone, its share is the least',
        ),
        'JointLimiter.step: 1.0 -> 2.0': 'times 1.0 is the same',
        '_forward: dt > 0.0 -> dt >= 0.0': 'zero either way',
        '_eased: 0.0 < left < math.inf -> 0.0 <= left < math.inf': 'nothing grows where it is',
        '_eased: value * goal -> value / goal': 'the sign is the same; of 0 nothing is left',
        '_follow: size > limit.magnitude -> size >= limit.magnitude': 'as large is the same',
        '_follow: size = limit.magnitude -> pass': (
            'it is compared only, and more than that by rounding alone'
        ),
        '_follow: size > abs(value) -> size >= abs(value)': (
            'as large, with the same sign, is there already'
        ),
        '_follow: abs(goal - value) <= most -> abs(goal - value) < most': 'it leads there',
    },
    'safety_mux/mapping.py': {
        'Stick.shape: math.copysign(1.0, value) * (-1.0 if self.inverted else 1.0) -> '
        'math.copysign(1.0, value) / (-1.0 if self.inverted else 1.0)': 'both are 1 or -1',
        'JoyMapping: 0 -> 1': 'a stick and a deadman need one each anyway',
        'JoyMapping._mix: 0 -> 1': 'in arcade both reach as far',
    },
    'safety_mux/button.py': {
        'ResetButton.__init__: self._since = 0.0 -> pass': _SET_FIRST,
        'ResetButton.__init__: 0.0 -> 1.0': _SET_FIRST,
        'ResetButton.hear: pressed and (not before) -> not before': (
            'while the button is released, neither time nor fault is read'
        ),
    },
    'esi_drive_bridge/protocol.py': {': 256 -> 257': _FOR_A_BYTE},
    'esi_drive_bridge/session/ramp.py': {
        'Ramp._nearer: 1.0 -> 2.0': 'it is read of velocities, and then it is not the default',
        '_start: value * goal > 0.0 -> value * goal >= 0.0': 'without a size, or without a goal',
    },
    'esi_drive_bridge/session/group.py': {
        'AxisGroup.expires_at: 2 -> 3': 'it wakes up more often than it needs to',
        'AxisGroup.watch: 0.0 <= gap <= limit -> 0.0 <= gap < limit': (
            'what was fed no later is stale at that moment, too'
        ),
        'AxisGroup.__init__: False -> True': (
            'the first packet is due anyway; what is heard and cleared is set before it is read'
        ),
        'AxisGroup.is_settled: return self.phase is Phase.ENABLED -> return None': (
            'a status is judged more often than it needs to be'
        ),
        'AxisGroup.set_command: False -> True': 'a gate with enable does not look at it',
        'AxisGroup._reset: self._counts = self._zeros -> pass': _SET_FIRST,
        'AxisGroup._reset: self._until = -math.inf -> pass': _SET_FIRST,
        'AxisGroup._reset: -math.inf -> math.inf': _SET_FIRST,
        'AxisGroup.watch: self._counts = self._zeros -> pass': (
            'packets that disable say 0, and what enables begins at rest'
        ),
    },
    'esi_drive_bridge/session/session.py': {
        'Session.__init__: -math.inf -> math.inf': (
            'it is set before it is read, or lies ahead: no report and no pause is either'
        ),
        'Session.__init__: 0.0 -> 1.0': 'without its moment the pause is none',
        'Session.warnings: self.link_up and self.status is not None -> self.link_up': _FOR_TYPES,
        'Session._take_repeated: return False -> return None': _FALSY,
        'Session._follow: self._known = None -> pass': 'a silent link is a stop, too',
    },
}
