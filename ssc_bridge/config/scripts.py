# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What ``ssc_config`` does in the menus: read the image, or write one, and say how the unit stands.

The menus obey single keys. The hex digit E is the key that erases: digits that go on after the
unit has stopped listening would do that. So they go one at a time, and the first word of the unit
ends them. The entry string, sent once too often, walks through the menus (c, i): so there is a
second between two of them. And whatever a key may have become on the way, a restore ends with a
restart of the unit and a look at what it has stored.
"""

from __future__ import annotations

from enum import Enum

from ssc_bridge.config.image import Image, ImageError, KNOWN_SIZE
from ssc_bridge.config.menus import (
    has_image,
    has_words,
    image_in,
    MenuError,
    never,
    readable,
    Screen,
    screen_of,
    Script,
    shows_menu,
    Step,
    talks,
    waits_for_image,
)

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
_REDRAW = b'R'  # in any menu (3)
_ENTER = b'\r'  # what a terminal sends at the end of a line; goes on where any key does

POWER_CYCLE = (
    'Switch the SSC off and on now. In configuration mode it drives no servos: make sure that '
    'nothing can move.'
)


class Standing(Enum):
    """What the SSC holds now, in words."""

    UNSEEN = 'No SSC was seen on this port; nothing was sent that changes what one has stored.'
    UNCHANGED = 'The SSC has the configuration stored that it had before.'
    LOADING = (
        'The SSC may hold a partial image in its working memory. It was not told to save it, so '
        'what it had stored should still be there: switch it off and on, then dump and compare.'
    )
    SAVING = (
        'The SSC was told to save the image, and nobody saw whether it did: it may have the old '
        'configuration stored, the new one or a damaged one. Do not rely on it: restore again.'
    )
    GARBLED = (
        'The SSC did not print its image when it was told to. If that key was garbled on the way, '
        'E for D, it has erased what it had stored: switch it off and on, then dump and compare, '
        'and restore if it drives nothing.'
    )
    SPOILT = (
        'The SSC has stored neither the new image nor the one before. Do not rely on it: restore '
        'again.'
    )
    STORED = 'The SSC has the new image stored; it was read back after a restart.'


_IN_MENUS = 'may be in configuration mode and drives no servos there: switch it off and on.'


class Maintenance:
    """
    One unit under maintenance; run one script of it in a Dialogue.

    :ivar standing: what it holds. :ivar in_menus: it may be in configuration mode.
    :ivar image: what it held at first; None until that was read.
    """

    def __init__(self) -> None:
        self.standing = Standing.UNSEEN
        self.in_menus = False
        self.image: Image | None = None
        self._seen_menus = False  # a menu has shown since it was last told to leave them

    @property
    def how_it_stands(self) -> str:
        """Where the unit was left, for whoever has to go on from there."""
        which = 'An SSC there' if self.standing is Standing.UNSEEN else 'It'
        return (
            f'{self.standing.value} {which} {_IN_MENUS}' if self.in_menus else self.standing.value
        )

    def dump(self) -> Script[Image]:
        """Read the image. :raises MenuError: could not."""
        image = yield from self._read_first()
        yield from self._finish()
        return image

    def restore(self, image: Image) -> Script[Image]:
        """
        Load an image, check it, save it, restart the unit and read it back.

        :raises MenuError: it failed; ``standing`` says what the unit holds then.
        """
        before = yield from self._read_first(like=image)
        failure: MenuError | None = None
        try:
            yield from self._load(image)
            yield from self._save()
        except MenuError as error:
            failure = error
        try:
            yield from self._judge(image, before)
        except MenuError as error:
            raise MenuError(f'{failure}; then {error}' if failure else str(error)) from error
        if failure is not None:
            raise failure
        if self.standing is not Standing.STORED:
            raise MenuError('after its restart the SSC does not hold what was saved')
        return image

    def _read_first(self, like: Image | None = None) -> Script[Image]:
        """Read what is stored. :raises MenuError: cannot, or it is not of a size with ``like``."""
        try:
            yield from self._open()
            self.image = yield from self._read()
            _check_kind(like or self.image, self.image)
        except MenuError as error:
            yield from self._give_up(error)
            raise
        return self.image

    def _judge(self, image: Image, before: Image) -> Script[None]:
        """Restart the unit, see what it has stored, and let it run. :raises MenuError: cannot."""
        try:
            yield from self._open()
            stored = yield from self._read()
        except MenuError as error:  # whoever interrupts it, wants to know all the same
            yield f'Trying again: {error}.'
            yield from self._open()
            stored = yield from self._read()
        known = {before.data: Standing.UNCHANGED, image.data: Standing.STORED}
        self.standing = known.get(stored.data, Standing.SPOILT)
        yield from self._finish()

    # -- in and out ------------------------------------------------------------------------------

    def _open(self) -> Script[None]:
        """Enter configuration mode afresh, so that the working memory is what is stored."""
        text = yield from self._probe()
        if text is not None:
            yield 'Restarting the SSC.'
            yield from self._leave(text)
            if (yield from self._call(RESTART_TRIES)):
                return
        yield POWER_CYCLE
        if not (yield from self._call(ENTRY_TRIES)):
            raise MenuError(
                f'no menu within {ENTRY_TRIES * ENTRY_PERIOD:.0f} s: is it the right port, was '
                'the SSC switched off and on, does a host send message 20 or 98 and lock it out?'
            )

    def _call(self, tries: int) -> Script[bool]:
        """
        Tell whether the main menu comes.

        A menu that cannot be read, for a bit was lost, must not be called again, but looked at.

        :raises MenuError: something else comes.
        """
        self.in_menus = True  # it may be from now on
        for _ in range(tries):
            text = yield Step(ENTRY, talks, ENTRY_PERIOD)
            if text is not None:
                shown = text if shows_menu(text) else (yield from self._probe())
                self._see(shown)
                if shown is None or screen_of(shown) is not Screen.MAIN:
                    raise MenuError('what answers on this port is not the main menu of an SSC')
                return True
        self.in_menus = False
        return False

    def _probe(self) -> Script[str | None]:
        """Return the menu that is open; None: none is."""
        for keys in (_REDRAW, _ENTER, _REDRAW):  # one may be lost on the way
            text = yield Step(keys, shows_menu, _PROBE)
            if text is not None:
                self._see(text)
                return text
        return None

    def _see(self, shown: str | None) -> None:
        """Note that a menu was shown; None: one that cannot be read, or other words."""
        self.in_menus = self._seen_menus = True
        of_an_ssc = shown is not None and screen_of(shown) is not Screen.OTHER
        if self.standing is Standing.UNSEEN and of_an_ssc:
            self.standing = Standing.UNCHANGED

    def _leave(self, text: str | None = None) -> Script[None]:
        """Leave by the main menu, which restarts the unit. :raises MenuError: it stays."""
        yield from self._walk_to(Screen.MAIN, text)
        self._seen_menus = False
        yield Step(b'X', never, _REST)
        if (yield Step(_REDRAW, shows_menu, _PROBE)) is not None:
            self._seen_menus = True
            raise MenuError('the SSC did not leave its menus')
        self.in_menus = False

    def _finish(self) -> Script[None]:
        """Leave, all work being done. :raises MenuError: it may have stayed in its menus."""
        try:
            yield from self._leave()
        except MenuError as error:
            yield from self._give_up(error)
            if self.in_menus:
                raise

    def _give_up(self, error: MenuError) -> Script[None]:
        """Leave, if that is to be had; ``in_menus`` tells it."""
        if not self.in_menus:
            return
        yield f'Leaving the menus: {error}.'
        try:
            text = yield from self._probe()
            self.in_menus = self._seen_menus
            if text is not None:
                yield from self._leave(text)
        except MenuError:
            return

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
            else:
                keys = _ENTER if turn % 2 else _REDRAW
            text = yield Step(keys, shows_menu, _ANSWER)
        raise MenuError(f'the {wanted.name.lower()} menu does not come')

    # -- images ----------------------------------------------------------------------------------

    def _read(self) -> Script[Image]:
        """
        Read the working memory, from any menu. :raises MenuError: no sound image comes.

        The sums may miss a lost line. So an image of another size than the manual's has to come
        twice alike.
        """
        yield from self._walk_to(Screen.CONFIG)
        fault = ''
        before: Image | None = None
        for _ in range(2):
            text = yield Step(b'D', has_image, _PRINT)
            if text is None:
                self.standing = Standing.GARBLED
                raise MenuError('the SSC does not print its image')
            yield from self._walk_to(Screen.CONFIG, text)
            try:
                image = image_in(text)
            except ImageError as error:
                fault = str(error)
                continue
            if image.has_known_layout or image == before:
                return image
            before, fault = image, f'{len(image.data)} bytes, not {KNOWN_SIZE}, came only once'
        raise MenuError(f'the SSC printed no sound image in two tries: {fault}')

    def _load(self, image: Image) -> Script[None]:
        """Put an image into the working memory. :raises MenuError: it is not there."""
        yield from self._walk_to(Screen.CONFIG)
        self.standing = Standing.LOADING
        if (yield Step(b'I', waits_for_image, _ANSWER)) is None:
            raise MenuError('the SSC does not ask for the image')
        said = yield from self._send(image)
        yield f'The SSC says: {said}'
        if (yield from self._read()) != image:
            raise MenuError(f'the SSC did not take the image as it was sent, and says: {said}')

    def _send(self, image: Image) -> Script[str]:
        """Send the digits; return what the unit says. :raises MenuError: it says it too early."""
        said, sent = None, 0
        for line in image.lines:
            for digit in (*line.encode(), *_ENTER):
                said = yield Step(bytes((digit,)), has_words, DIGIT_PERIOD)
                sent += bytes((digit,)).isalnum()
                if said is not None:
                    break
            yield f'{sent // 2} of {len(image.data)} bytes sent'
            if said is not None:
                break
        rest = yield Step(b'', has_words, _PRINT) if said is None else Step(b'', bool, _REST)
        text = readable((said or '') + (rest or '')) or 'nothing'
        if sent < 2 * len(image.data):
            raise MenuError(f'the SSC stopped listening and says: {text}')
        return text

    def _save(self) -> Script[None]:
        """Save the working memory."""
        yield 'Saving.'
        self.standing = Standing.SAVING
        text = yield Step(b'S', shows_menu, _PRINT)
        yield from self._walk_to(Screen.CONFIG, text)


def _check_kind(image: Image, before: Image) -> None:
    """:raises MenuError: the image cannot be of this unit."""
    if len(image.data) != len(before.data):
        raise MenuError(
            f"the image has {len(image.data)} bytes, the SSC's own {len(before.data)}: it is of "
            'another kind of unit'
        )
