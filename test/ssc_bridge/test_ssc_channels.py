# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the inputs and outputs of an SSC may be, as docs/devices/ssc.md lists it."""

import math
from typing import Any

import pytest

from ssc_bridge.channels import AxisInput, ButtonInput, Failsafe, Servo

PULSE = {'failsafe': Failsafe.PULSE}


def test_button_counts_the_thresholds_that_the_pulse_is_above() -> None:
    button = ButtonInput('gear', 5, (1300, 1700))
    assert [button.value(us) for us in (1300, 1301, 1700, 1701)] == [0, 1, 1, 2]
    turned = ButtonInput('gear', 5, (1300, 1700), reversed=True)
    assert [turned.value(us) for us in (1300, 1301, 1700, 1701)] == [2, 1, 1, 0]


ORDER = r'button\.x\.thresholds_us = .*each greater'


@pytest.mark.parametrize(
    ('kind', 'given', 'text'),
    [
        *((AxisInput, {'min_us': us}, 'min_us') for us in (0, 1500)),
        (AxisInput, {'max_us': 1500}, 'min_us'),
        *((AxisInput, {'deadband': band}, 'deadband') for band in (1.0, math.nan)),
        *((AxisInput, {'channel': number}, 'channel = ') for number in (0, 17)),
        *((ButtonInput, {'channel': number}, r'button\.x\.channel') for number in (0, 17)),
        *((ButtonInput, {'thresholds_us': us}, ORDER) for us in ((), (1700, 1300), (1500, 1500))),
    ],
)
def test_pulse_input_that_cannot_be_is_rejected(
    kind: Any, given: dict[str, Any], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        kind(**{'name': 'x', 'channel': 2, **given})


@pytest.mark.parametrize(
    'given',
    [
        {**PULSE, 'min_us': 1500, 'centre_us': 1500, 'failsafe_us': 1500},
        {**PULSE, 'centre_us': 2000, 'max_us': 2000, 'failsafe_us': 2000},
        {'min_us': 1600, 'centre_us': 1700, 'failsafe': Failsafe.HOLD},
        {'rate_us_per_s': 0.5},
    ],
)
def test_servo_may_be_at_its_limits(given: dict[str, Any]) -> None:
    servo = Servo(name='pan', channel=1, **given)
    assert servo.centre_us == given.get('centre_us', 1500)


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ({'channel': 0}, r'servo\.pan\.channel'),
        ({'channel': 24}, r'servo\.pan\.channel'),
        ({'min_us': 0}, r'servo\.pan'),
        ({'max_us': 32001}, r'servo\.pan'),
        ({'max_us': 1400}, 'rising numbers'),
        ({'min_us': 1501, 'centre_us': 1500}, 'rising numbers'),
        ({'rate_us_per_s': math.nan}, r'servo\.pan'),
        ({**PULSE, 'failsafe_us': 2001}, r'servo\.pan'),
        ({**PULSE, 'failsafe_us': 0}, r'servo\.pan'),
        ({'rate_us_per_s': 0.0}, 'rate_us_per_s must be above 0'),
        ({**PULSE, 'min_us': 1200, 'failsafe_us': 1199}, 'failsafe_us = 1199: must be within'),
        *(
            ({'failsafe': failsafe, 'failsafe_us': 1200}, 'failsafe_us = 1200: is not used')
            for failsafe in (Failsafe.HOLD, Failsafe.RELEASE)
        ),
    ],
)
def test_servo_that_cannot_be_is_rejected(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Servo(**{'name': 'pan', 'channel': 1, **given})


def test_output_without_a_name_may_have_any_pulse() -> None:
    servo = Servo.unnamed(7, Failsafe.RELEASE)
    assert [servo.limited(us) for us in (0.0, 0.5, 1.0, 40000.0)] == [0.0, 1.0, 1.0, 32000.0]
