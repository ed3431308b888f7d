# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The layout for Foxglove and the perspective for rqt: whole, and of which topics."""

from __future__ import annotations

import ast
from collections.abc import Iterator
import json
from pathlib import Path
from typing import Any

LAYOUTS = Path(__file__).resolve().parents[2] / 'layouts'


def foxglove() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((LAYOUTS / 'foxglove.json').read_text())
    return found


def plugin_manager() -> dict[str, Any]:
    content = json.loads((LAYOUTS / 'rugged_teleop.perspective').read_text())
    found: dict[str, Any] = content['groups']['pluginmanager']
    return found


def value_of(key: dict[str, str]) -> Any:
    """Return what rqt reads."""
    assert key['type'] == 'repr'
    return ast.literal_eval(key['repr'])


def named() -> Iterator[tuple[str, str]]:
    """Yield each topic that the files name, and the field of it; empty: all of it."""
    for panel in foxglove()['configById'].values():
        paths = [path['value'] for path in panel.get('paths', ())]
        for path in [*paths, panel.get('topicPath'), panel.get('topicToRender')]:
            if path:
                topic, _, field = path.partition('.')
                yield topic, field
    for group in plugin_manager()['groups'].values():
        for path in value_of(group['groups']['plugin']['keys']['topics']):
            topic, _, field = path.rpartition('/')
            yield topic, field


def leaves(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
        return
    assert layout['direction'] in ('row', 'column')
    yield from leaves(layout['first'])
    yield from leaves(layout['second'])


def test_layout_shows_each_panel_once() -> None:
    content = foxglove()
    assert sorted(leaves(content['layout'])) == sorted(content['configById'])


def test_perspective_runs_the_plots_that_it_has_topics_for() -> None:
    manager = plugin_manager()
    running = value_of(manager['keys']['running-plugins'])
    expected = {f'plugin__rqt_plot__Plot__{number}' for number in running['rqt_plot/Plot']}
    assert manager['groups'].keys() == expected


def test_both_have_state_or_stops_sticks_commands_and_speed() -> None:
    for topic in ('/safety_mux/estop', '/fort_vsc_bridge/joy', '/safety_mux/command'):
        assert sum(name == topic for name, _ in named()) >= 2, topic
