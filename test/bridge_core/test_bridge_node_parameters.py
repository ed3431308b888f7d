# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bad parameter, however it is given, ends a node before any port is opened."""

import math
from pathlib import Path
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.parameter import Parameter as RosParameter

from bridge_core.parameters import ParameterError
from stage.rig import NodeProcess, Observer, Pty
from stage.toy_bridge import make_toy, toy_process

# In this process, before anything is opened. Each way to be wrong is in test_parameters.py.


BAD: dict[str, tuple[dict[str, Any], str]] = {
    'unknown name': ({'prot': '/dev/x'}, 'parameter prot: there is no such parameter; did you'),
    'QoS override': ({'qos_overrides./x.publisher.depth': 7}, 'parameter qos_overrides./x.pub'),
    'contradiction': ({'low': 2.0}, 'parameters low = 2.0 and high = 1.0: low must be below'),
}


@pytest.mark.parametrize('case', BAD)
def test_bad_parameter_names_itself_its_value_and_what_is_allowed(
    context: Context, case: str
) -> None:
    parameters, text = BAD[case]
    with pytest.raises(ParameterError) as caught:
        make_toy(context, **parameters)
    assert str(caught.value).startswith(text)


def test_good_parameters_keep_their_types(context: Context) -> None:
    node = make_toy(context, estop_rate=30, scales=[1, 2], names=['a', 'b'], port='5', count=9)
    try:
        values = node.values
        assert (values['estop_rate'], values['scales']) == (30.0, [1.0, 2.0])
        assert type(values['estop_rate']) is float
        assert values['names'] == ['a', 'b']
        description = node.describe_parameter('estop_rate')
        assert description.description
        assert description.floating_point_range[0].from_value == 5.0
        assert 'Hz' in description.additional_constraints
    finally:
        node.destroy_node()


def test_list_of_an_inactive_node_is_changed_and_never_deleted(context: Context) -> None:
    node = make_toy(context)
    try:
        (deleted,) = node.set_parameters([RosParameter('names')])
        assert not deleted.successful
        assert deleted.reason == 'parameter names = None: allowed is a list, each a string'
        assert node.values['names'] == node.get_parameter('names').value == ['x']
        empty = RosParameter('names', RosParameter.Type.STRING_ARRAY, [])
        assert node.set_parameters([empty])[0].successful
        assert node.values['names'] == []
    finally:
        node.destroy_node()


# Parameters, as a process: one line and exit status 2.


def refused(*arguments: str, **parameters: Any) -> list[str]:
    with NodeProcess('stage.toy_bridge', parameters, arguments=arguments) as node:
        assert node.wait() == 2, node.output
        assert 'Traceback' not in node.output
        return node.output.splitlines()


def test_empty_list_is_a_list_and_no_crash() -> None:
    with toy_process('/dev/nothing', names=[], scales=[]) as node:
        node.wait_output('cannot open')
        assert node.end() == 0


def test_bad_value_in_a_file_is_told_like_any_other(tmp_path: Path) -> None:
    path = tmp_path / 'toy.yaml'
    path.write_text('toy_bridge:\n  ros__parameters:\n    count: many\n')
    (line,) = refused('--params-file', str(path))
    assert line == "rugged_teleop: parameter count = 'many': allowed is a whole number from 1 to 9"


def test_parameters_are_fixed_while_active_and_free_while_inactive(
    pty: Pty, observer: Observer
) -> None:
    with toy_process(pty.path) as node:
        node.wait_output('device opened')

        def set_parameter(name: str, value: Any) -> tuple[bool, str]:
            return observer.set_parameter('/toy_bridge', name, value)

        good, reason = set_parameter('count', 5)
        assert not good
        assert reason == 'parameter count: deactivate the node to change it'
        assert set_parameter('gain', 2.0)[0]  # one that says so
        assert not set_parameter('gain', math.nan)[0]
        assert observer.change_state('/toy_bridge', 'deactivate')
        assert set_parameter('count', 5) == (True, '')
        assert not set_parameter('count', 50)[0]
        good, reason = set_parameter('low', 5.0)
        assert not good
        assert 'low must be below high' in reason
        # The port itself can be changed, and is used from the next activation on.
        other = Pty(pty.path.with_name('other'))
        assert set_parameter('port', str(other.path))[0]
        assert observer.change_state('/toy_bridge', 'activate')
        other.wait_received(b'h')
        other.unplug()
