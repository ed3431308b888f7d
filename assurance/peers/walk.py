# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Have ros2cli, launch, joy_teleop and rosbridge use two simulated devices and the mux.

In a workspace with them and this package: ``. install/setup.bash``, then run this file with a
Python that has aiohttp. A line says what each peer did; the first that could not ends it with
status 1. Without rosbridge in the workspace the rest is tried.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import os
from pathlib import Path
import signal
import subprocess
import tempfile
import time

import aiohttp

PATIENCE = 120.0  # s, for a busy machine
BRIDGE_PORT = 9797
TRIP = ('/safety_mux/trip', 'std_srvs/srv/Trigger')
JOY_TELEOP = """
joy_teleop:
  ros__parameters:
    walk:
      type: topic
      interface_type: geometry_msgs/msg/Twist
      topic_name: peer_vel
      deadman_buttons: [0]
      axis_mappings: {linear-x: {axis: 1, scale: 0.5, offset: 0.0}}
"""


def ros2(*words: str) -> str:
    """Return what a command of ros2cli prints."""
    done = subprocess.run(['ros2', *words], capture_output=True, text=True, timeout=PATIENCE)
    return done.stdout + done.stderr


def expect(peer: str, text: str, *words: str) -> None:
    """Try a command of ros2cli until it prints this. :raises AssertionError: it never does."""
    end = time.monotonic() + PATIENCE
    while text not in (found := ros2(*words)):
        assert time.monotonic() < end, f'{peer}: no {text!r} in {found!r}'
    print(f'{peer}: ros2 {" ".join(words)}: {text}', flush=True)


@contextmanager
def running(*words: str) -> Iterator[subprocess.Popen[str]]:
    """Run a program until the end of the block, which ends it as Ctrl-C does."""
    out = subprocess.DEVNULL
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=out, stderr=out, text=True, start_new_session=True
    ) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)


def say(simulator: subprocess.Popen[str], *lines: str) -> None:
    """Give a simulator commands."""
    assert simulator.stdin is not None
    simulator.stdin.write(''.join(f'{line}\n' for line in lines))
    simulator.stdin.flush()


async def through_rosbridge() -> None:
    """Read the mux's state, trip it, and see that it has stopped."""
    url = f'ws://127.0.0.1:{BRIDGE_PORT}'
    state = {'op': 'subscribe', 'topic': '/safety_mux/state', 'type': 'std_msgs/msg/String'}
    trip = {'op': 'call_service', 'service': TRIP[0], 'type': TRIP[1]}
    states: list[str] = []
    async with aiohttp.ClientSession() as session, session.ws_connect(url) as socket:
        await socket.send_json(state)
        answer = None
        while not answer or states[-1] != 'STOPPED':
            heard = await socket.receive_json(timeout=PATIENCE)
            if heard['op'] == 'publish':
                states.append(heard['msg']['data'])
                if len(states) == 1:
                    await socket.send_json(trip)
            elif heard['op'] == 'service_response':
                answer = heard['values']
    print(f'rosbridge: {state["topic"]}: {states}; {TRIP[0]}: {answer}', flush=True)


def main() -> None:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        (folder / 'joy_teleop.yaml').write_text(JOY_TELEOP, encoding='utf-8')
        ports = {name: str(folder / name) for name in ('fort_vsc', 'esi_drive')}
        simulate = ('ros2', 'run', 'rugged_teleop', 'simulate')
        remote, _ = (
            stack.enter_context(running(*simulate, name, '--port', port))
            for name, port in ports.items()
        )
        share = ros2('pkg', 'prefix', '--share', 'rugged_teleop').strip()
        launched = stack.enter_context(
            running(
                *('ros2', 'launch', 'rugged_teleop', 'bringup.launch.py', 'recorder:=false'),
                *(f'{name}_port:={port}' for name, port in ports.items()),
                f'params_file:={share}/config/spine.yaml',
            )
        )
        for node in ('/fort_vsc_bridge', '/safety_mux', '/esi_drive_bridge'):
            expect('launch, ros2node', node, 'node', 'list')
            expect('ros2lifecycle', 'active', 'lifecycle', 'get', node)
        expect('ros2param', '100', 'param', 'get', '/safety_mux', 'rate')
        say(remote, 'mode operational')
        status = ('topic', 'echo', '--once', '--full-length', '/safety_mux/status')
        expect('ros2topic', 'STOPPED', *status)
        reset = ('service', 'call', '/safety_mux/reset', 'std_srvs/srv/Trigger')
        expect('ros2service', 'success=True', *reset)
        teleop = ('--ros-args', '--params-file', str(folder / 'joy_teleop.yaml'))
        stack.enter_context(
            running(
                *('ros2', 'run', 'joy_teleop', 'joy_teleop', *teleop),
                *('-r', 'joy:=fort_vsc_bridge/joy'),
            )
        )
        say(remote, 'button left_down 1', 'stick left_y 0.5')
        expect('joy_teleop', 'x: 0.2', 'topic', 'echo', '--once', '/peer_vel')
        if 'rosbridge_server' in ros2('pkg', 'list'):
            stack.enter_context(
                running(
                    *('ros2', 'run', 'rosbridge_server', 'rosbridge_websocket', '--ros-args'),
                    *('-p', f'port:={BRIDGE_PORT}', '-p', 'address:=127.0.0.1'),
                )
            )
            expect('rosbridge', '/rosbridge_websocket', 'node', 'list')
            asyncio.run(through_rosbridge())
        else:
            print('rosbridge: not here; ros2service trips the mux')
            expect('ros2service', 'success=True', 'service', 'call', *TRIP)
        expect('ros2topic', 'STOPPED', *status)
        os.killpg(launched.pid, signal.SIGINT)
        assert launched.wait(PATIENCE) == 0
        print('launch: Ctrl-C, and it ended with status 0')


if __name__ == '__main__':
    main()
