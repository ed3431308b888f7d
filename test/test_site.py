"""The site of ``make docs``: its navigation has every page, once."""

from collections import Counter
import runpy

from rugged_teleop.reference import ROOT


def test_every_page_is_in_the_navigation_once() -> None:
    pages = [*ROOT.glob('*.md'), *ROOT.glob('*.rst'), *(ROOT / 'docs').rglob('*.md')]
    names = {path.relative_to(ROOT).with_suffix('').as_posix() for path in pages}
    groups = runpy.run_path(str(ROOT / 'docs' / 'conf.py'))['contents']()
    listed = Counter(name for group in groups.values() for name in group)
    assert listed == Counter(names - {'README'}), 'NAVIGATION of docs/conf.py'
