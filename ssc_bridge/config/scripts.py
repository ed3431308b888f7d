"""
What ``ssc_config`` does in the menus: read the image, or write one, and say how the unit stands.

Two things are dangerous there. The menus obey single keys, and the hex digits E and C are keys: an
image that goes on after the unit has stopped listening would erase the memory. So digits go one at
a time, and the first word of the unit ends them. And the entry string, sent once too often, walks
through the menus (c, i): so it waits longer for an answer than a unit needs for one.
"""

from __future__ import annotations

from enum import Enum

from ssc_bridge.config.image import Image
from ssc_bridge.config.image import ImageError
from ssc_bridge.config.menus import has_image
from ssc_bridge.config.menus import has_words
from ssc_bridge.config.menus import image_in
from ssc_bridge.config.menus import MenuError
from ssc_bridge.config.menus import never
from ssc_bridge.config.menus import readable
from ssc_bridge.config.menus import Screen
from ssc_bridge.config.menus import screen_of
from ssc_bridge.config.menus import Script
from ssc_bridge.config.menus import shows_menu
from ssc_bridge.config.menus import Step
from ssc_bridge.config.menus import waits_for_image

ENTRY = b'ssconfig'  # 3: within 5 s of power-on
ENTRY_PERIOD = 1.0  # seconds, between two tries
ENTRY_TRIES = 60  # while the user switches off and on
RESTART_TRIES = 6  # after a restart of its own: the 5 s are over then
DIGIT_PERIOD = 0.02  # seconds; an image takes 9 s
_ANSWER = 1.0  # seconds for a menu to come
_PROBE = 0.7  # seconds for a menu that may be open already
_PRINT = 3.0  # seconds for an image, or for a verdict on one
_REST = 0.3  # seconds, for the end of a sentence
_WALK = 8  # keys from any menu to any other
_ENTER = '\r'  # what a terminal sends at the end of a line

POWER_CYCLE = (
    'Switch the SSC off and on now. In configuration mode it drives no servos: make sure that '
    'nothing can move.'
)


class Standing(Enum):
    """What the SSC holds now, in words."""

    UNCHANGED = 'The SSC has the configuration stored that it had before.'
    LOADING = (
        'The SSC may hold a partial image in its working memory. It was not told to save it, so '
        'what it had stored should still be there: switch it off and on, then dump and compare.'
    )
    SAVING = (
        'The SSC was told to save the image, and nobody saw whether it did: it may have the old '
        'configuration stored, the new one or a damaged one. Do not rely on it: restore again.'
    )
    SPOILT = (
        'The SSC has stored neither the new image nor the one before. Do not rely on it: restore '
        'again.'
    )
    STORED = 'The SSC has the new image stored; it was read back after a restart.'


_IN_MENUS = (
    ' It was in configuration mode when last heard, and drives no servos there: switch it off '
    'and on.'
)


class Maintenance:
    """
    One unit under maintenance; run one script of it in a Dialogue.

    :ivar standing: what it holds. :ivar in_menus: it is in configuration mode.
    :ivar image: what it held at first; None until that was read.
    """

    def __init__(self) -> None:
        self.standing = Standing.UNCHANGED
        self.in_menus = False
        self.image: Image | None = None

    @property
    def how_it_stands(self) -> str:
        """Where the unit was left, for whoever has to go on from there."""
        return self.standing.value + _IN_MENUS * self.in_menus

    def dump(self) -> Script[Image]:
        """Read the image. :raises MenuError: could not."""
        try:
            image = yield from self._read_first()
        except MenuError as error:
            yield from self._give_up(error)
            raise
        yield from self._leave()
        return image

    def restore(self, image: Image) -> Script[Image]:
        """
        Load an image, check it, save it, restart the unit and read it back.

        :raises MenuError: it failed; ``standing`` says what the unit holds then.
        """
        try:
            before = yield from self._read_first()
            _check_kind(image, before)
        except MenuError as error:
            yield from self._give_up(error)
            raise
        failure: MenuError | None = None
        try:
            yield from self._load(image)
            yield from self._save()
        except MenuError as error:
            failure = error
        yield from self._judge(image, before, failure)
        return image

    # -- in and out ------------------------------------------------------------------------------

    def _read_first(self) -> Script[Image]:
        """Enter configuration mode afresh, so that the working memory is what is stored; read."""
        if (yield Step(b'R', shows_menu, _PROBE)) is not None:
            self.in_menus = True
            yield 'It is in its menus already: restarting it.'
            yield from self._leave()
            yield from self._enter(RESTART_TRIES)
        else:
            yield POWER_CYCLE
            yield from self._enter(ENTRY_TRIES)
        self.image = yield from self._read()
        return self.image

    def _enter(self, tries: int) -> Script[None]:
        """Enter configuration mode. :raises MenuError: the main menu does not come."""
        for _ in range(tries):
            text = yield Step(ENTRY, shows_menu, ENTRY_PERIOD)
            if text is None:
                continue
            self.in_menus = True
            if screen_of(text) is not Screen.MAIN:
                raise MenuError('the SSC was called twice and went past its main menu')
            return
        raise MenuError(
            f'no menu within {tries * ENTRY_PERIOD:.0f} s: is it the right port, was the SSC '
            'switched off and on, is its lockout on (3.6) and a host sending message 20 or 98?'
        )

    def _leave(self) -> Script[None]:
        """Leave by the main menu, which restarts the unit. :raises MenuError: it stays."""
        yield from self._walk_to(Screen.MAIN)
        yield Step(b'X', never, _ANSWER)
        if (yield Step(b'R', shows_menu, _PROBE)) is not None:
            raise MenuError('the SSC did not leave its menus')
        self.in_menus = False

    def _give_up(self, error: MenuError) -> Script[None]:
        """Leave, if that is to be had."""
        if not self.in_menus:
            return
        yield f'Leaving the menus: {error}.'
        try:
            yield from self._leave()
        except MenuError:
            return  # ``in_menus`` tells it

    def _walk_to(self, wanted: Screen, text: str | None = None) -> Script[None]:
        """
        Press keys until a menu shows: none of them changes anything in any menu.

        :param text: what was shown last. :raises MenuError: it does not come.
        """
        for turn in range(_WALK):
            screen = None if text is None else screen_of(text)
            if screen is wanted:
                return
            if screen is Screen.MAIN:
                keys = b'C'
            elif screen in (Screen.CONFIG, Screen.OTHER):
                keys = b'0'  # the previous menu
            else:  # a key to go on, or to draw the menu anew
                keys = _ENTER.encode() if turn % 2 else b'R'
            text = yield Step(keys, shows_menu, _ANSWER)
        raise MenuError(f'the {wanted.name.lower()} menu does not come')

    # -- images ----------------------------------------------------------------------------------

    def _read(self) -> Script[Image]:
        """Read the working memory, from any menu. :raises MenuError: no sound image comes."""
        yield from self._walk_to(Screen.CONFIG)
        fault = ''
        for _ in range(2):
            text = yield Step(b'D', has_image, _PRINT)
            yield from self._walk_to(Screen.CONFIG, text)
            try:
                return image_in(text or '')
            except ImageError as error:
                fault = str(error)
        raise MenuError(f'the SSC printed no sound image in two tries: {fault}')

    def _load(self, image: Image) -> Script[None]:
        """Put an image into the working memory. :raises MenuError: it is not there."""
        yield from self._walk_to(Screen.CONFIG)
        self.standing = Standing.LOADING
        if (yield Step(b'I', waits_for_image, _ANSWER)) is None:
            raise MenuError('the SSC does not ask for the image')
        yield f'The SSC says: {readable((yield from self._send(image))) or "nothing"}'
        if (yield from self._read()) != image:
            raise MenuError('the SSC did not take the image as it was sent')

    def _send(self, image: Image) -> Script[str]:
        """Send the digits; return what the unit says. :raises MenuError: it says it too early."""
        signs = _ENTER.join((*image.lines, ''))
        said, sent = None, 0
        while said is None and sent < len(signs):
            said = yield Step(signs[sent].encode(), has_words, DIGIT_PERIOD)
            sent += 1
            if signs[sent - 1] == _ENTER:
                yield f'{len(bytes.fromhex(signs[:sent]))} of {len(image.data)} bytes sent'
        rest = yield Step(b'', has_words, _PRINT) if said is None else Step(b'', bool, _REST)
        said = (said or '') + (rest or '')
        if signs[sent:].strip():
            raise MenuError(f'the SSC stopped listening and says: {readable(said)}')
        return said

    def _save(self) -> Script[None]:
        """Save the working memory."""
        yield 'Saving.'
        self.standing = Standing.SAVING
        text = yield Step(b'S', shows_menu, _PRINT)
        yield from self._walk_to(Screen.CONFIG, text)

    def _judge(self, image: Image, before: Image, failure: MenuError | None) -> Script[None]:
        """Restart the unit, read what it has stored, and let it run."""
        try:
            yield from self._leave()
            yield 'Restarted; reading back what is stored.'
            yield from self._enter(RESTART_TRIES)
            stored = yield from self._read()
            known = {before.data: Standing.UNCHANGED, image.data: Standing.STORED}
            self.standing = known.get(stored.data, Standing.SPOILT)
            yield from self._leave()
        except MenuError as error:
            yield from self._give_up(error)
            raise MenuError(f'{failure}; then {error}' if failure else str(error)) from error
        if failure is not None:
            raise failure
        if self.standing is not Standing.STORED:
            raise MenuError('after its restart the SSC does not hold what was saved')


def _check_kind(image: Image, before: Image) -> None:
    """:raises MenuError: the image cannot be of this unit."""
    if len(image.data) != len(before.data):
        raise MenuError(
            f"the image has {len(image.data)} bytes, the SSC's own {len(before.data)}: it is of "
            'another kind of unit'
        )
