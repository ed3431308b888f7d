# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameter files of docs/recipes.md with a real mux, and what a twist_mux behind it has to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from signal import SIGCONT, SIGKILL, SIGSTOP
import time
from typing import Any

from geometry_msgs.msg import Twist, Vector3
from std_msgs.msg import Bool
import yaml

from stage.mux_talkers import MuxBench, sticks, TIMEOUT
from stage.rig import Observer, ROOT
from stage.talkers import Talker

RECIPES = ROOT / 'config' / 'recipes'


def file_of(recipe: str) -> Path:
    """Return its parameter file."""
    return RECIPES / f'{recipe}.yaml'


def parameters(recipe: str, node: str) -> Any:
    """Return the parameters of a node, as its file has them."""
    sections = yaml.safe_load(file_of(recipe).read_text(encoding='utf-8'))
    return sections[f'/**/{node}']['ros__parameters']


def bench(observer: Observer, recipe: str, *arguments: str, **options: Any) -> MuxBench:
    """Start a mux with the recipe's file, as a busy machine and talkers, who prove nothing, do."""
    given = parameters(recipe, 'safety_mux')
    options |= dict.fromkeys(('estop__fort__proof', 'operator__fort__proof'), 'auto')
    if 'drive' not in given['estop_sources']:
        options['estop__drive__timeout'] = None
    else:
        ages = ('estop__drive__age_limit', 'drive_enabled_age_limit')
        options |= dict.fromkeys(ages, TIMEOUT)
    options.setdefault('autonomy__topic', given.get('autonomy', {}).get('topic'))
    options.setdefault('drive_enabled_topic', given.get('drive_enabled_topic'))
    return MuxBench(
        observer, arguments=('--params-file', str(file_of(recipe)), *arguments), **options
    )


def twist(forward: float = 0.0, turn: float = 0.0) -> Twist:
    """Return a velocity (m/s, rad/s)."""
    return Twist(linear=Vector3(x=forward), angular=Vector3(z=turn))


def twist_mux_is_locked(
    observer: Observer, start: Callable[[str], AbstractContextManager[Any]]
) -> Iterator[str]:
    """
    Have a mux lock a twist_mux, by the recipe's file, and drive past it; tell each thing seen.

    :param start: starts a twist_mux in a namespace, with its output on ``base/cmd_vel`` there.
    """
    mux = bench(observer, 'twist_mux')
    mux.command = observer.record(Twist, f'{mux.name}/cmd_vel')
    base = observer.record(Twist, f'{mux.space}/base/cmd_vel')
    docking = Talker(observer, Twist, f'{mux.space}/docking/cmd_vel', twist(0.1), rate=20.0)

    def falls_silent(cause: float) -> str:
        since = time.monotonic()  # some of it may still be on its way
        mux.wait(lambda: time.monotonic() > max([since, *base.times]) + 0.3, 'silence')
        last = max([cause, *base.times]) - cause
        base.clear()
        observer.holds_for(lambda: not base.messages, 0.5, 'silence')
        return f'silence, {last:.2f} s after'

    def hears(expected: Twist, what: str) -> str:
        mux.wait(lambda: base.messages and base.last == expected, what)
        return what

    with start(mux.space):
        try:
            mux.wait(mux.is_stopped, 'STOPPED')
            yield f'STOPPED from the start: {falls_silent(time.monotonic())}'
            mux.ready()
            yield hears(twist(0.1), 'a reset opens it: docking')
            docking.pause()
            yield hears(twist(), 'docking is silent: the zero of the mux')
            mux.joy.message = sticks(deadman=True)
            mux.wait(lambda: mux.says('ACTIVE'), 'ACTIVE')
            mux.joy.message = sticks(1.0, deadman=True)
            yield hears(twist(0.5), 'the operator')
            docking.resume()
            yield hears(twist(0.1), 'docking, past the mux')
            cause = time.monotonic()
            mux.fort_estop.publisher.publish(Bool(data=True))
            mux.wait(mux.is_stopped, 'STOPPED')
            yield f'an e-stop: {falls_silent(cause)}'
            mux.joy.message = sticks()
            mux.ready()
            yield hears(twist(0.1), 'a reset opens it: docking')
            for number in (SIGSTOP, SIGKILL):
                mux.node.signal(number)
                yield f'{number.name} of the mux: {falls_silent(time.monotonic())}'
                if number == SIGSTOP:
                    mux.node.signal(SIGCONT)
                    mux.ready()
                    yield hears(twist(0.1), 'a reset opens it: docking')
        finally:
            docking.leave()
            mux.close()
