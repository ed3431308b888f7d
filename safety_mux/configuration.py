# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The objects that are made from the mux's parameters."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
import re
from typing import Any, TypeVar

from bridge_core.parameters import names_of, ParameterError
from safety_mux.limits import JointLimit
from safety_mux.mapping import JoyMapping, Stick
from safety_mux.parameters import DEFAULTS, enabled_topic, parameter_table, telling_drives
from safety_mux.proofs import ENDINGS, provable
from safety_mux.settings import Autonomy, EStopSource, Feedback, MuxConfig, Operator, SpeedLimit
from safety_mux.soft_ends import SoftEnds

_T = TypeVar('_T')
_BUTTON = re.compile(r'([A-Za-z][A-Za-z0-9_]*)=([0-9]{1,3})')
MOST_BUTTONS = 255  # the greatest index
_REST_TIME = 0.01  # s, at most, from one decision to the next at rest, beside the period
_OF_SOURCE = ('timeout', 'counts', 'stop_category', 'proof', 'age_limit')
_OF_OPERATOR = ('priority', 'timeout', 'proof', 'age_limit')
_OF_FEEDBACK = ('timeout', 'standstill', 'overspeed_tolerance', 'overspeed_time')
_TIMES = ('clear_time', 'neutral_time', 'hold_time', 'stall_limit', 'stop_time', 'reset_silence')


def mux_config(values: Mapping[str, Any]) -> MuxConfig:
    """Return the arbiter's configuration. :raises ParameterError: it is not valid."""
    return _built(
        'parameters',
        lambda: MuxConfig(
            joints=len(values['joints']),
            sources=tuple(_source(values, name) for name in names_of(values, 'estop_sources')),
            operators=tuple(
                Operator(name, **_of(values, f'operator.{name}', *_OF_OPERATOR))
                for name in names_of(values, 'operators')
            ),
            autonomy=Autonomy(values['autonomy.timeout']) if values['autonomy.topic'] else None,
            torques=values['interface'] == 'effort',
            drives=_drives(values),
            drive_timeout=values['drive_enabled_timeout'],
            drive_proof=values['drive_enabled_proof'],
            drive_age_limit=values['drive_enabled_age_limit'],
            feedback=Feedback(tuple(values['joints']), **_of(values, 'feedback', *_OF_FEEDBACK))
            if values['feedback.topic']
            else None,
            speed_limits=tuple(
                SpeedLimit(name, **_of(values, f'speed_limit.{name}', 'timeout', 'lowest'))
                for name in names_of(values, 'speed_limits')
            ),
            **{name: values[name] for name in _TIMES},
        ),
    )


def _of(values: Mapping[str, Any], prefix: str, *names: str) -> dict[str, Any]:
    return {name: values[f'{prefix}.{name}'] for name in names}


def joy_mapping(values: Mapping[str, Any], operator: str) -> JoyMapping:
    """Return an operator's mapping. :raises ParameterError: it does not fit the joints."""
    prefix = f'operator.{operator}'
    axes = values[f'{prefix}.axis']

    def spread(name: str) -> list[Any]:
        given = values[f'{prefix}.{name}']
        if len(given) not in (1, len(axes)):
            raise ValueError(f'{name} must have 1 or {len(axes)} elements, as axis has')
        return list(given) * (len(axes) if len(given) == 1 else 1)

    def build() -> JoyMapping:
        columns = (spread(name) for name in ('scale', 'inverted', 'deadband', 'expo'))
        return JoyMapping(
            sticks=tuple(Stick(*row) for row in zip(axes, *columns, strict=True)),
            deadman=tuple(values[f'{prefix}.deadman_buttons']),
            buttons=1 + max(operator_buttons(values, operator).values(), default=-1),
            mixing=values[f'{prefix}.mixing'],
            pressed_at=values[f'{prefix}.pressed_at'],
            levels=tuple(values[f'{prefix}.speed_levels']),
            level_button=values[f'{prefix}.speed_button'],
            axis_buttons=tuple(spread('axis_buttons')),
        )

    if not values[f'{prefix}.deadman_buttons']:
        raise ParameterError(f'parameter {prefix}.deadman_buttons = []: one or more are needed')
    mapping = _built(f'{prefix}.*', build)
    if mapping.joints != len(values['joints']):
        name = f'{prefix}.axis' if mapping.mixing == 'none' else f'{prefix}.mixing'
        raise ParameterError(
            f'parameter {name} = {values[name]!r}: makes {mapping.joints} joints, joints has '
            f'{len(values["joints"])}: {", ".join(values["joints"])}; correct either'
        )
    return mapping


def joint_limits(values: Mapping[str, Any]) -> list[JointLimit]:
    """Return the limits of each joint, in order."""
    return [
        JointLimit(
            magnitude=values[f'joint.{name}.max'],
            together=values['interface'] == 'velocity',
            **_of(values, f'joint.{name}', 'acceleration', 'deceleration', 'group', 'jerk'),
        )
        for name in values['joints']
    ]


def soft_ends(values: Mapping[str, Any]) -> dict[int, SoftEnds]:
    """Return the soft ends, by the joint's place. :raises ParameterError: one has no sense."""
    ends = {}
    for n, name in enumerate(values['joints']):
        prefix = f'joint.{name}'
        least, most = values[f'{prefix}.position_min'], values[f'{prefix}.position_max']
        zone, fastest = values[f'{prefix}.slow_zone'], values[f'{prefix}.max']
        if least == most:
            if least or zone:
                raise ParameterError(f'{prefix}.*: give position_min, position_max and slow_zone')
            continue
        needed = fastest**2 / values[f'{prefix}.deceleration']
        if zone < needed:
            raise ParameterError(
                f'parameter {prefix}.slow_zone = {zone:g}: the joint cannot slow down in it; '
                f'max² / deceleration is {needed:.3g} rad'
            )
        if not values['feedback.topic']:
            raise ParameterError(
                f'parameter {prefix}.position_max: is not used; only feedback.topic needs it'
            )
        ends[n] = _built(f'{prefix}.*', partial(SoftEnds, least, most, zone, fastest))
    return ends


def operator_buttons(values: Mapping[str, Any], operator: str) -> dict[str, int]:
    """Return the index in Joy of each button with a name. :raises ParameterError: none is that."""
    parameter, found = f'operator.{operator}.buttons', {}
    for text in names_of(values, parameter):
        match = _BUTTON.fullmatch(text)
        if match is None or int(match[2]) > MOST_BUTTONS or match[1] in found:
            raise ParameterError(
                f"parameter {parameter}: {text!r} is not name=index, such as 'horn=4', or twice"
            )
        found[match[1]] = int(match[2])
    return found


def rest_period(values: Mapping[str, Any]) -> float:
    """Return the seconds between two decisions at rest, where heartbeats alone are due."""
    period, heartbeat = (1.0 / float(values[name]) for name in ('rate', 'heartbeat_rate'))
    return max(period, min(period + _REST_TIME, 2.0 * period, heartbeat))


def check(values: Mapping[str, Any], resolved: Callable[[str], str]) -> None:
    """
    Refuse contradictory values.

    :param resolved: gives the full name of a topic, by the node's namespace and remappings.
    :raises ParameterError: with the parameter's name.
    """
    lists = ('estop_sources', 'operators', 'speed_limits')
    for prefix, list_name in zip(('estop', 'operator', 'speed_limit'), lists, strict=True):
        for name in names_of(values, list_name):
            if not values[f'{prefix}.{name}.topic']:
                raise ParameterError(
                    f'parameter {prefix}.{name}.topic is empty: give the topic of {name!r}'
                )
    _check_topics(values, resolved)
    if len(set(values['joints'])) < len(values['joints']) or '' in values['joints']:
        raise ParameterError(
            f'parameter joints = {values["joints"]}: names must be there and differ'
        )
    if values['output'] != 'joints':
        _check_twist(values)
    if values['interface'] == 'effort':
        _check_effort(values)
    _check_unused(values)
    _check_proofs(values, resolved)
    twist = values['autonomy.type'] != 'JointState'
    sideways = values['output'] != 'joints' and len(values['joints']) == 3
    if values['autonomy.topic'] and twist and len(values['joints']) != 2 and not sideways:
        raise ParameterError('parameter autonomy.type: Twist needs two joints, left and right')
    if rest_period(values) >= values['stall_limit']:
        raise ParameterError(
            f'parameter stall_limit: must be longer than {rest_period(values):.3g} s, which at '
            'rest is from one decision to the next'
        )
    for name in ('clear_time', 'neutral_time'):
        if values[name] < 3.0 / values['rate']:
            raise ParameterError(f'parameter {name}: must be three periods of rate or more')
    mux_config(values)
    limits = joint_limits(values)
    soft_ends(values)
    for name in names_of(values, 'operators'):
        reach = joy_mapping(values, name).reach
        for joint, limit, most in zip(values['joints'], limits, reach, strict=True):
            if most > limit.magnitude:
                raise ParameterError(
                    f'parameter operator.{name}.scale: {most} is above joint.{joint}.max, '
                    f'which is {limit.magnitude}'
                )


def _check_twist(values: Mapping[str, Any]) -> None:
    """Refuse what a twist cannot say."""
    mixings = {f'operator.{name}.mixing': 'none' for name in names_of(values, 'operators')}
    three = ['linear', 'lateral', 'angular']
    joints = three if values['joints'] == three else ['linear', 'angular']
    needed = {'joints': joints, 'interface': 'velocity', 'feedback.topic': '', **mixings}
    for name, value in needed.items():
        if values[name] != value:
            raise ParameterError(
                f'parameter {name} = {values[name]!r}: output {values["output"]} needs {value!r}'
            )


def _check_effort(values: Mapping[str, Any]) -> None:
    """Refuse speeds beside torques: one does not become the other by another unit."""
    speeds = {
        'autonomy.type': bool(values['autonomy.topic'])
        and values['autonomy.type'] != 'JointState',
        'feedback.topic': bool(values['feedback.topic']),
        'speed_limits': bool(names_of(values, 'speed_limits')),
    }
    for name in names_of(values, 'estop_sources'):
        speeds[f'estop.{name}.stop_category'] = values[f'estop.{name}.stop_category'] == 1
    for name, given in speeds.items():
        if given:
            raise ParameterError(
                f"parameter interface = 'effort': {name} = {values[name]!r} is about speeds and "
                "needs 'velocity'"
            )


def _check_unused(values: Mapping[str, Any]) -> None:
    """Refuse what was given and would have no effect."""
    output, kind = values['output'], values['autonomy.type']
    planned, measured = bool(values['autonomy.topic']), bool(values['feedback.topic'])
    wheels = planned and output == 'joints' and kind != 'JointState'
    users = {
        'frame_id': (output == 'twist_stamped', 'output twist_stamped has one'),
        'autonomy.type': (planned, 'autonomy.topic needs it'),
        'autonomy.timeout': (planned, 'autonomy.topic needs it'),
        'autonomy.wheel_separation': (wheels, 'a Twist of autonomy with output joints needs it'),
        'autonomy.wheel_radius': (wheels, 'a Twist of autonomy with output joints needs it'),
    }
    tells = (bool(telling_drives(values)), 'drive_enabled_topic needs it')
    users |= {f'drive_enabled_{name}': tells for name in ('timeout', 'proof', 'age_limit')}
    for name in values:
        if name.startswith('feedback.') and name != 'feedback.topic':
            users[name] = (measured, 'feedback.topic needs it')
    for name in names_of(values, 'estop_sources'):
        owned = values[f'estop.{name}.counts'] == 'when_owner'
        users[f'estop.{name}.operator'] = (owned, 'counts when_owner needs it')
    proofs: dict[str, bool] = {}  # by the limit of their age, whether any are heard
    for each in provable(values):
        heard = values[each.policy] != 'none' and values[each.topic].endswith(ENDINGS[each.kind])
        limit = f'{each.policy.removesuffix("proof")}age_limit'
        proofs[limit] = proofs.get(limit, False) or heard
    users |= {name: (heard, 'proofs of its node need it') for name, heard in proofs.items()}
    defaults = {each.name: each.default for each in parameter_table(values)}
    for name, (used, user) in users.items():
        if not used and values[name] != defaults[name]:
            raise ParameterError(f'parameter {name} = {values[name]!r}: is not used; only {user}')


def _check_proofs(values: Mapping[str, Any], resolved: Callable[[str], str]) -> None:
    """Refuse to wait for proofs where nobody would look for any, or could ask for them."""
    for each in provable(values):
        topic, ending = values[each.topic], ENDINGS[each.kind]
        if values[each.policy] == 'required' and not topic.endswith(ending):
            raise ParameterError(
                f"parameter {each.policy} = 'required': {topic!r} does not end with {ending}: "
                'there is no ~/proof beside it'
            )
        full = resolved(topic)
        if values[each.policy] != 'none' and full.endswith(ending):
            challenge = f'{full.removesuffix(ending)}/challenge'
            _full(f'parameter {each.topic} = {topic!r}, whose ~/challenge is', challenge, resolved)


def _outputs(values: Mapping[str, Any]) -> Iterator[str]:
    yield from ('~/estop', '~/enable', '~/state', '~/status', '~/proof')
    yield '~/command' if values['output'] == 'joints' else '~/cmd_vel'
    for topic, names in (('~/stop_demand', 'estop_sources'), ('~/joy', 'operators')):
        for name in names_of(values, names):
            if name.isascii() and name.isidentifier():  # else it is refused as a name
                yield f'{topic}/{name}'
    operators = names_of(values, 'operators')
    yield from {f'~/button/{b}' for name in operators for b in operator_buttons(values, name)}


def _full(what: str, topic: str, resolved: Callable[[str], str]) -> str:
    try:
        return resolved(topic)
    except RuntimeError as error:  # rcl's own; all else that it refuses has been checked
        raise ParameterError(
            f'{what}: too long, a topic with its namespace has 247 characters at most'
        ) from error


def _check_topics(values: Mapping[str, Any], resolved: Callable[[str], str]) -> None:
    """
    Refuse one topic for two inputs, and an input from this mux itself.

    Which of the two it is for would be ambiguous; a mux that hears itself hears nobody else.
    """
    users = {
        _full(topic, topic, resolved): f'{topic}, which this node says'
        for topic in _outputs(values)
    }
    for name, topic in values.items():
        if not name.endswith(('.topic', '_topic')) or not topic:
            continue
        given = f'parameter {name} = {topic!r}'
        user = users.setdefault(_full(given, topic, resolved), name)
        if user != name:
            raise ParameterError(f'{given}: is also that of {user}')
    for name in names_of(values, 'estop_sources'):
        topic, own = (f'estop.{name}.{what}' for what in ('topic', 'own_topic'))
        given = values[own]
        if not given or given != DEFAULTS.get(own):
            continue
        if resolved(given).rpartition('/')[0] != resolved(values[topic]).rpartition('/')[0]:
            raise ParameterError(
                f'parameter {own} = {given!r}: {topic} is of another node; give its '
                "own_estop, or ''"
            )


def _source(values: Mapping[str, Any], name: str) -> EStopSource:
    prefix = f'estop.{name}'
    return EStopSource(
        name,
        operator=values[f'{prefix}.operator'] or None,
        own_topic=bool(values[f'{prefix}.own_topic']),
        **_of(values, prefix, *_OF_SOURCE),
    )


def _drives(values: Mapping[str, Any]) -> tuple[str, ...]:
    found = telling_drives(values)
    if len(found) > 1 and '' in found:
        raise ValueError(f"drive_enabled_topic must be '', as {enabled_topic(found[1])} is given")
    return found


def _built(what: str, build: Callable[[], _T]) -> _T:
    try:
        return build()
    except ValueError as error:
        raise ParameterError(f'{what}: {error}') from error
