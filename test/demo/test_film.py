# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The film of the demo: each text is seen while it stood there, and each thing keeps its row."""

from xml.etree import ElementTree

from demo.film import shown, svg

NAME = '{http://www.w3.org/2000/svg}'


def test_text_is_seen_while_it_stood_there() -> None:
    stopped, active, motor = 'mux STOPPED', 'mux ACTIVE', 'motor A <'
    frames = [(0.0, [stopped, motor]), (0.5, [active, motor]), (2.0, [stopped, ''])]
    texts = ElementTree.fromstring(svg(frames, 3.0)).iter(f'{NAME}text')
    seen = {
        text.text: [(each.get('begin'), each.get('dur')) for each in text.iter(f'{NAME}set')]
        for text in texts
    }
    assert seen == {
        stopped: [('film.begin+0.00s', '0.50s'), ('film.begin+2.00s', '1.00s')],
        active: [('film.begin+0.50s', '1.50s')],
        motor: [('film.begin+0.00s', '2.00s')],
    }


def test_more_reasons_do_not_move_what_stands_below() -> None:
    def view(*reasons: str) -> list[str]:
        middle = ['mux      READY', *reasons, '', 'motor A  [', 'to drive  9a', '            A: 0']
        return [
            'page',
            '',
            'FORT     plugged in',
            *middle,
            'from drive',
            '>        ok',
            '',
            'keys',
        ]

    one, many = shown(view('         a')), shown(view(*9 * ['         b']))
    assert one.index('motor A  [') == many.index('motor A  [')
    assert [one[0], one[-1], len(one)] == ['FORT     plugged in', '>        ok', len(many)]
