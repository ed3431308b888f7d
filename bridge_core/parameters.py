# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Parameters as data: name, default, meaning, unit and range stand in one place.

From the same table come the declaration in ROS, the check before any port opens, the error in one
line, and, by ``make reference``, the annotated files of config/ and the tables of docs/.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
import difflib
import itertools
import math
import re
from typing import Any

# ROS declares these by itself; nobody else may use an unknown name.
_OF_ROS = ('use_sim_time', 'start_type_description_service')
Value = Any  # bool, int, float, str, or a list of one of the last three


class ParameterError(ValueError):
    """
    A parameter is unknown, of the wrong type, out of range, or contradicts another one.

    ``node`` is the full name of the node that it is of, where that is known.
    """

    node = ''


@dataclass(frozen=True)
class Parameter:
    """
    One parameter. Its type is that of the default; an int is accepted where a float is meant, and
    a single value where a list is.

    :param description: first what it does, then why.
    :param minimum: smallest allowed number, included (of every element, for a list).
    :param choices: the allowed strings; empty allows any.
    :param above: the number must be greater than this, for ranges that exclude their lower end.
    :param check: raises ValueError with what is allowed, for what a range cannot say.
    :param runtime: may be changed while the node is active.
    :param fixed: may be changed by a restart only, for what construction is built upon.
    :param section: a heading in the annotated file, above this and the ones that follow.
    :param hex_digits: shown in hexadecimal; the default with so many digits.
    """

    name: str
    default: Value
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    choices: tuple[str, ...] = ()
    check: Callable[[Any], None] | None = None
    runtime: bool = False
    fixed: bool = False
    section: str = ''
    hex_digits: int = 0

    def validate(self, value: Value) -> Value:
        """Return the value in the parameter's own type. :raises ParameterError: not allowed."""
        many = isinstance(self.default, list)
        items = value if many and isinstance(value, list | tuple) else [value]
        kind = type((self.default or [''])[0] if many else self.default)
        checked = [self._validate_item(item, kind, value) for item in items]
        if len(checked) > 1 and '' in checked:
            text = f"parameter {self.name} = {value!r}: '' is none, and stands alone"
            raise ParameterError(text)
        result = checked if many else checked[0]
        if self.check is not None:
            try:
                self.check(result)
            except ValueError as error:
                raise ParameterError(f'parameter {self.name} = {value!r}: {error}') from error
        return result

    def _validate_item(self, item: Value, kind: type[Any], value: Value) -> Value:
        if kind is float and type(item) is int:
            item = float(item)
        if type(item) is not kind:
            raise self.error(value)
        if type(item) in (int, float) and not self._in_range(item):
            raise self.error(value)
        if self.choices and item not in self.choices:
            raise self.error(value)
        return item

    def _in_range(self, number: float) -> bool:
        return (
            math.isfinite(number)
            and (self.minimum is None or number >= self.minimum)
            and (self.maximum is None or number <= self.maximum)
            and (self.above is None or number > self.above)
        )

    def error(self, value: Value) -> ParameterError:
        """Make the error that says what is allowed instead of ``value``."""
        return ParameterError(f'parameter {self.name} = {value!r}: allowed is {self.allowed}')

    @property
    def allowed(self) -> str:
        """The allowed values in words, such as 'a number from 0.02 to 10 s'."""
        if self.choices:
            text = 'one of ' + ', '.join(repr(choice) for choice in self.choices)
            return f'a list, each {text}' if isinstance(self.default, list) else text
        sample = (self.default or [''])[0] if isinstance(self.default, list) else self.default
        words = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a string'}
        text = words[type(sample)]
        if self.above is not None:
            text += f' above {self._number(self.above)}'
        if self.minimum is not None:
            text += f' from {self._number(self.minimum)}'
        if self.maximum is not None:
            text += f' to {self._number(self.maximum)}'
        if self.unit and type(sample) in (int, float):
            text += f' {self.unit}' if text[-1].isdigit() else f' in {self.unit}'
        return f'a list, each {text}' if isinstance(self.default, list) else text

    def _number(self, number: float) -> str:
        return f'0x{int(number):X}' if self.hex_digits else f'{number:.12g}'

    def named(self, name: str, default: Value = None) -> 'Parameter':
        """Return a copy under another name, for what repeats per source, joint or axis."""
        return replace(self, name=name, default=self.default if default is None else default)


def with_named(
    general: Iterable[Parameter],
    groups: Iterable[tuple[str, str, Sequence[Parameter]]],
    given: Mapping[str, Value],
    defaults: Mapping[str, Value],
) -> tuple[Parameter, ...]:
    """
    Return all parameters; what a given (or default) list names follows that list.

    Such a list is fixed: a running node has no parameters of a name that is new.

    :param groups: each a list's name, the prefix of what it names, and the parameters of each.
    :param defaults: by full name, such as 'joint.left.max', where they are not the group's own.
    :raises ParameterError: a list that is none.
    """
    named = {list_name: (prefix, parameters) for list_name, prefix, parameters in groups}
    table: dict[str, Parameter] = {}
    for parameter in general:
        if parameter.name not in named:
            table[parameter.name] = parameter
            continue
        table[parameter.name] = replace(parameter, fixed=True)
        prefix, members = named[parameter.name]
        names = given.get(parameter.name, parameter.default)
        if isinstance(names, str) and ',' in names:
            raise ParameterError(
                f'parameter {parameter.name} = {names!r}: is one name; for a list write [{names}]'
            )
        names = parameter.validate(names)
        for name, member in itertools.product(filter(None, names), members):
            full = f'{prefix}.{name}.{member.name}'
            table[full] = member.named(full, defaults.get(full))
    return tuple(table.values())


def full_topic(node: str, topic: str) -> str:
    """Return a topic's full name. :param node: the full name of the node that is given it."""
    if topic.startswith('/'):
        return topic
    return node + topic[1:] if topic.startswith('~/') else f'{node.rpartition("/")[0]}/{topic}'


def names_of(values: Mapping[str, Value], list_name: str) -> list[str]:
    """Return the names in a list; an empty one, as in [""], names nothing."""
    return [name for name in values[list_name] if name]


_TOPIC = re.compile(r'(~/|/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*', re.ASCII)


def check_topic(name: str) -> None:
    """Let an empty string pass, or a name that ROS takes for a topic. :raises ValueError: else."""
    if name and not _TOPIC.fullmatch(name):
        raise ValueError('allowed is a topic name: words of letters, digits and _, with / between')


def is_ros_parameter(name: str) -> bool:
    """Tell whether every node has this parameter, whatever its table says."""
    return name in _OF_ROS


def resolve(parameters: Iterable[Parameter], given: Mapping[str, Value]) -> dict[str, Value]:
    """
    Return every parameter's value: the given one, checked, or else the default.

    :raises ParameterError: for the first that is not allowed, or that no parameter is named after.
    """
    table = {parameter.name: parameter for parameter in parameters}
    for name in given:
        if name not in table:
            near = difflib.get_close_matches(name, table, n=1)
            hint = f'; did you mean {near[0]}?' if near else ''
            raise ParameterError(f'parameter {name}: there is no such parameter{hint}')
    return {
        name: parameter.validate(given.get(name, parameter.default))
        for name, parameter in table.items()
    }


def proofs(
    who: str, beside: str, limit: float, *, prefix: str = '', **options: Any
) -> tuple[Parameter, Parameter]:
    """
    Return the parameters for a node that may prove how old its words are.

    :param who: the node, in words. :param beside: the topic that its ~/proof stands beside.
    :param limit: default, s. :param options: of the first parameter.
    """
    return (
        Parameter(
            f'{prefix}proof',
            'auto',
            f'Whether {who} has to prove how old its words are (~/proof beside {beside}). '
            'auto: once it did; required: always.',
            choices=('auto', 'required', 'none'),
            **options,
        ),
        Parameter(
            f'{prefix}age_limit',
            limit,
            'Oldest that proven words may be, round trip included.',
            unit='s',
            minimum=0.15,  # three challenges
            maximum=10.0,
        ),
    )


def line_age_limit(description: str) -> Parameter:
    """Return the parameter of how late may be what comes over a line that may queue; 0: off."""

    def check(value: float) -> None:
        if 0.0 < value < 0.2:
            raise ValueError('allowed is 0.2 to 10 s, or 0 for off')

    return Parameter(
        'line_age_limit',
        0.5,
        description,
        unit='s',
        minimum=0.0,
        maximum=10.0,
        check=check,
    )


MANAGED_PARAMETERS = (
    Parameter(
        'autostart',
        True,
        'Configure and activate without a lifecycle manager.',
        section='common: docs/common.md',
    ),
    Parameter(
        'rt_priority',
        0,
        'SCHED_FIFO priority of all threads of the process, its memory locked; of several nodes '
        'in a process the highest counts. 0: off. See docs/common.md.',
        minimum=0,
        maximum=98,
        fixed=True,
    ),
)
BRIDGE_PARAMETERS = (
    *MANAGED_PARAMETERS,
    Parameter(
        'hardware_id',
        '',
        "The device's name in diagnostics. Empty: its port, channel, group or PIN.",
    ),
    Parameter(
        'frame_id', '', "frame_id in the headers of published messages. Empty: the node's name."
    ),
    Parameter(
        'estop_rate',
        20.0,
        'How often ~/estop is repeated. The timeout of each listener (0.25 s at the mux) should '
        'be three periods or more.',
        unit='Hz',
        minimum=5.0,
        maximum=200.0,
        fixed=True,
    ),
    Parameter(
        'reconnect_period',
        1.0,
        'Longest wait between two tries to open a lost port; it doubles from 0.1 s.',
        unit='s',
        minimum=0.1,
        maximum=2.0,
        fixed=True,
    ),
    Parameter(
        'publish_raw',
        False,
        'Publish ~/raw/received and ~/raw/sent.',
        fixed=True,
    ),
)
# What bridges have whose wire has a process of its own.
ACTUATOR_PARAMETERS = (
    *BRIDGE_PARAMETERS,
    Parameter(
        'wire_rt_priority',
        0,
        'Of actuators: the priority of the process at the port alone. 0: rt_priority.',
        minimum=0,
        maximum=98,
        fixed=True,
    ),
    *proofs(
        'the node of ~/estop_in',
        '~/estop',
        0.25,
        fixed=True,
        section='old news: docs/decisions/0040-proofs-of-age.md',
    ),
)
# What several bridges with sticks have alike.
DEADBAND = Parameter(
    'deadband',
    0.0,
    'Deflection up to which an axis is 0 in ~/joy, of 1. The mux has its own.',
    minimum=0.0,
    maximum=0.5,
)
TOLERATE_FAULTY_AXES = Parameter(
    'tolerate_faulty_axes',
    False,
    'False: one broken, absent or out-of-range control makes all of ~/joy neutral. True: it alone '
    'is 0.',
)
