# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Remappings: one that renames nothing is refused, and no other."""

from collections.abc import Iterator
import contextlib
import gc
import re
from typing import Any

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions

from bridge_core.parameters import ParameterError
from bridge_core.remappings import check_remappings
from bridge_core.runner import run
from safety_mux.node import SafetyMux
from stage.spine import exit_of
from vm110_bridge.node import Vm110Bridge

FINE = (
    *('__node:=other', '__ns:=/left', 'safety_mux:__ns:=/left', '/fort_vsc_bridge/joy:=/joy'),
    *('~/estop:=/e', 'safety_mux:~/reset:=/r', '~/stop_demand/fort:=/d'),
    *(
        'esi_drive_bridge/estop:=/e',
        'rostopic://~/estop:=/e',
        'rosservice:///safety_mux/reset:=/r',
    ),
    *('~/change_state:=/c', '~/get_state:=/g', '~/transition_event:=/t', '/rosout:=/log'),
    *('~/get_parameters:=/p', '~/set_parameters_atomically:=/p', '~/get_type_description:=/y'),
    *('~/raw/sent:=/s', 'tf:=/tf', '/tf_static:=tf_static', '/clock:=/c'),
    *('safety_mux:__node:=other', 'esi_drive_bridge:__node:=drive'),
    'esi_drive_bridge:~/estop_in:=safety_mux/estop',  # of the stack, for a node that is renamed
)


@pytest.fixture
def arguments(request: pytest.FixtureRequest) -> Iterator[list[str]]:
    """Give a command line with the rule of the test, if any, which ROS has."""
    result = ['node', '--ros-args', *(('-r', request.param) if hasattr(request, 'param') else ())]
    rclpy.init(args=result, signal_handler_options=SignalHandlerOptions.NO)
    yield result
    rclpy.try_shutdown()
    gc.collect()  # nodes are in cycles, and would stay in the graph of the tests that follow


@contextlib.contextmanager
def made(*kinds: Any) -> Iterator[list[Any]]:
    """Give nodes of these kinds."""
    nodes = [kind() for kind in kinds]
    yield nodes
    for node in nodes:
        node.shut_down()
        node.destroy_node()


@pytest.mark.parametrize('arguments', FINE, indirect=True)
def test_rules_that_ros_follows_are_left_alone(arguments: list[str]) -> None:
    with made(SafetyMux) as nodes:
        check_remappings(nodes, arguments, ['esi_drive_bridge'])


@pytest.mark.parametrize(
    ('rule', 'hint'),
    [
        ('nothing:=/n', 'there is no nothing; see --help'),
        ('/left/nothing:=/n', 'there is no /left/nothing; see --help'),
        ('rosservice://~/nothing:=/n', 'there is no service ~/nothing; see --help'),
        ('rosservice://~/estop:=/n', 'there is no service ~/estop; see --help'),
        ('rostopic://~/reset:=/n', 'there is no topic ~/reset; see --help'),
        ('command:=/n', 'there is no command; did you mean ~/command?'),
        ('/safety_mux/comand:=/n', 'there is no /safety_mux/comand; did you mean ~/command?'),
        ('fort_bridge/joy:=/n', 'there is no fort_bridge/joy; did you mean /fort_vsc_bridge/joy?'),
        ('{home}/command:=/n', "shell has made {home} of ~: quote it, as in -r '~/command:=/n'"),
        ('safety_mx:__ns:=/left', 'there is no safety_mx; did you mean safety_mux?'),
    ],
)
@pytest.mark.usefixtures('arguments')
def test_rule_that_renames_nothing_is_refused(
    rule: str, hint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = '/home/robot'
    monkeypatch.setenv('HOME', home)
    with (
        made(SafetyMux) as nodes,
        pytest.raises(ParameterError, match=re.escape(hint.format(home=home))),
    ):
        check_remappings(nodes, ['-r', rule.format(home=home)])


@pytest.mark.usefixtures('arguments')
def test_rule_for_one_of_several_nodes_is_enough() -> None:
    with made(SafetyMux, Vm110Bridge) as nodes:
        check_remappings(nodes, ['-r', '~/reset:=/r', '-r', '~/hold_output:=/h'])
        with pytest.raises(ParameterError, match='there is no ~/reset; see --help'):
            check_remappings(nodes, ['--remap', 'vm110_bridge:~/reset:=/r'])
        with pytest.raises(ParameterError, match='no vm11_bridge; did you mean vm110_bridge'):
            check_remappings(nodes, ['-r', 'vm11_bridge:~/hold_output:=/h'])


def test_chain_that_would_not_be_wired_is_refused(capfd: Any) -> None:
    rule = '~/hold_ouput:=safety_mux/stop_demand/vm110'
    assert run([Vm110Bridge], ['node', '--ros-args', '-r', rule]) == 2
    line = f'rugged_teleop: -r {rule}: there is no ~/hold_ouput; did you mean ~/hold_output?'
    assert line in capfd.readouterr().err.splitlines()


def test_stack_takes_its_own_wiring_for_a_renamed_drive() -> None:
    """It goes on to the parameter that is refused."""
    status, error = exit_of(
        'rugged_teleop.stack',
        *('safety_mux', 'esi_drive_bridge', '--ros-args'),
        *('-r', 'esi_drive_bridge:__node:=drive', '-r', 'drive:~/comand:=/c'),
    )
    assert status == 2
    assert 'there is no ~/comand; did you mean ~/command?' in error
