# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The site of ``make docs``: its navigation has every page, once; its pictures stand alone."""

from collections import Counter
from pathlib import Path
import re
import runpy
from xml.etree import ElementTree

import pytest

from rugged_teleop.reference import ROOT
from test.repository.docs_rig import PAGES, text_of


def test_every_page_is_in_the_navigation_once() -> None:
    pages = [*ROOT.glob('*.md'), *ROOT.glob('*.rst'), *(ROOT / 'docs').rglob('*.md')]
    names = {path.relative_to(ROOT).with_suffix('').as_posix() for path in pages}
    groups = runpy.run_path(str(ROOT / 'conf.py'))['contents']()
    listed = Counter(name for group in groups.values() for name in group)
    assert listed == Counter(names - {'README'}), 'NAVIGATION of conf.py'


def anchors(text: str) -> set[str]:
    """Return what links may name behind #: each heading as the site has it."""
    headings = re.findall(r'^#+ (.+)$', text, re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', each.lower()).replace(' ', '-') for each in headings}


@pytest.mark.parametrize('page', PAGES)
def test_link_to_a_file_or_a_heading_leads_there(page: str) -> None:
    for path, anchor in re.findall(r'\]\((?!\w+:)([^)#\s]*)#?([^)\s]*)\)', text_of(page)):
        target = (ROOT / page).parent / path if path else ROOT / page
        assert target.exists(), path
        assert not anchor or anchor in anchors(target.read_text(encoding='utf-8')), (path, anchor)


PICTURES = sorted((ROOT / 'docs' / 'images').glob('*.svg'))


@pytest.mark.parametrize('picture', PICTURES, ids=lambda path: path.name)
def test_picture_is_on_a_page_has_words_and_needs_nothing_else(picture: Path) -> None:
    assert picture.stat().st_size <= 600_000
    tags = [element.tag.rpartition('}')[2] for element in ElementTree.parse(picture).iter()]
    assert {'title', 'desc'} <= set(tags)
    assert not {'script', 'image', 'foreignObject', 'a'} & set(tags)
    text = picture.read_text(encoding='utf-8')
    assert 'prefers-color-scheme: dark' in text
    assert re.findall(r'url\((?!#)|@import', text) == []
    pages = [*ROOT.glob('docs/*.md'), *ROOT.glob('docs/*/*.md')]
    assert any(f'images/{picture.name})' in page.read_text(encoding='utf-8') for page in pages)


@pytest.mark.parametrize('device', ['fort_vsc', 'ssc'])
def test_pins_of_a_picture_have_the_signals_of_the_page(device: str) -> None:
    page = (ROOT / 'docs' / 'devices' / f'{device}.md').read_text(encoding='utf-8')
    _, _, table = page.partition('| pin')
    rows = [row.split('|')[1:4] for row in table.partition('\n\n')[0].splitlines()[2:]]
    picture = (ROOT / 'docs' / 'images' / f'wiring_{device}.svg').read_text(encoding='utf-8')
    drawn = re.findall(r'class="pin"[^>]*>(\w+)</text>\n<text[^>]*>([^<]+)<', picture)
    assert len(drawn) >= 10
    for pin, signal in drawn:
        words = re.split('[ _]', signal.lower())
        cells = [' '.join(row).lower() for row in rows if pin in re.findall(r'\w+', row[0])]
        assert any(all(word in cell for word in words) for cell in cells), (pin, signal)
