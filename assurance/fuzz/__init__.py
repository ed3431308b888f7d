# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Hostile inputs, guided by what they reach: ``make fuzz`` runs millions, ``make test`` a few."""

from __future__ import annotations

from assurance.fuzz.campaign import Target
from assurance.fuzz.decoders import DECODERS
from assurance.fuzz.devices import SESSIONS
from assurance.fuzz.files import FILES
from assurance.fuzz.messages import MESSAGES
from assurance.fuzz.onlookers import ONLOOKERS
from assurance.fuzz.parsers import PARSERS

TARGETS: dict[str, Target] = {
    target.name: target
    for target in (*PARSERS, *DECODERS, *SESSIONS, *FILES, *MESSAGES, *ONLOOKERS)
}
