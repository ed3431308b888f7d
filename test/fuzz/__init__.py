"""Hostile inputs, guided by what they reach: ``make fuzz`` runs millions, ``make test`` a few."""

from __future__ import annotations

from test.fuzz.campaign import Target
from test.fuzz.devices import SESSIONS
from test.fuzz.files import FILES
from test.fuzz.messages import MESSAGES
from test.fuzz.onlookers import ONLOOKERS
from test.fuzz.parsers import PARSERS

TARGETS: dict[str, Target] = {
    target.name: target for target in (*PARSERS, *SESSIONS, *FILES, *MESSAGES, *ONLOOKERS)
}
