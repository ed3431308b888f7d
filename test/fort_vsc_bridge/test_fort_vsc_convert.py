# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VSC's values as ROS messages."""

import math
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import KeyValue
from hypothesis import given, strategies as st
import pytest
from sensor_msgs.msg import BatteryState, JoyFeedback, NavSatStatus
from std_msgs.msg import String

from fort_vsc_bridge import convert
from fort_vsc_bridge.protocol.messages import RemoteStatus
from fort_vsc_bridge.protocol.values import Mode

STAMP = Time(sec=12, nanosec=34)


@pytest.mark.parametrize(
    ('axes', 'full', 'expected'),
    [
        ((-1023, 1023, 1023, 1023, -1023, -1023), 1023, [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]),
        ((0, 1023, 500, 0, -1023, -500), 1000, [0.0, 1.0, 0.5, 0.0, -1.0, -0.5]),  # it clips
        ((0,) * 6, 1023, [0.0] * 6),
    ],
)
def test_left_and_forward_are_positive_and_zero_is_no_negative_one(
    axes: Any, full: int, expected: list[float]
) -> None:
    pressed = (True, False, False, True, False, True, False, False)
    message = convert.joy(axes, pressed, STAMP, 'remote', axis_full_scale=full)
    assert str(list(message.axes)) == str(expected)
    assert list(message.buttons) == [1, 0, 0, 1, 0, 1, 0, 0]
    assert (message.header.stamp, message.header.frame_id) == (STAMP, 'remote')


@pytest.mark.parametrize(
    ('mode', 'text'), [(Mode.OPERATIONAL, 'Operational'), (0x33, 'Unknown (0x33)'), (None, 'None')]
)
def test_mode_in_words(mode: Any, text: str) -> None:
    assert convert.mode_string(mode).data == text


@pytest.mark.parametrize(
    ('percent', 'charging', 'status'),
    [
        (70, False, BatteryState.POWER_SUPPLY_STATUS_DISCHARGING),
        (70, True, BatteryState.POWER_SUPPLY_STATUS_CHARGING),
        (100, True, BatteryState.POWER_SUPPLY_STATUS_FULL),
        (None, True, BatteryState.POWER_SUPPLY_STATUS_CHARGING),  # of unknown level
    ],
)
def test_battery(percent: int | None, charging: bool, status: int) -> None:
    message = convert.battery_state(RemoteStatus(percent, charging, 2, 2), STAMP, 'remote')
    level = math.nan if percent is None else percent / 100
    assert message.percentage == pytest.approx(level, nan_ok=True)
    assert message.power_supply_status == status
    assert message.present
    assert math.isnan(message.voltage)
    unknown = convert.battery_state(None, STAMP, 'remote')
    assert not unknown.present
    assert math.isnan(unknown.percentage)


def test_user_values_in_text() -> None:
    message = convert.user_value(3, -7)
    assert (message.key, message.value) == ('3', '-7')
    assert convert.key_and_value(message) == (3, -7)
    assert convert.key_and_text(KeyValue(key='90', value='hi')) == (90, 'hi')


@pytest.mark.parametrize(
    ('key', 'value'),
    [
        *(('', '1'), ('x', '1'), ('1', ''), ('1', '1.5'), ('1', '1_2'), ('1_0', '1'), (' 1', '1')),
        *(('1', '\u0661'), ('\uff11', '1'), ('1', '0x1'), ('1', '+ 1')),
        *(('2147483648', '1'), ('1', '-2147483649')),
    ],
)
def test_request_that_is_no_number_of_32_bits_is_refused(key: str, value: str) -> None:
    words = 'from -2147483648 to 2147483647' if '21474' in key + value else 'whole number'
    with pytest.raises(ValueError, match=words):
        convert.key_and_value(KeyValue(key=key, value=value))


def test_text_that_fills_the_display_is_passed_on_and_no_longer_one() -> None:
    text = ('x' * 20 + '\r\n') * 4
    assert convert.display_text(String(data=text)) == (text,)
    with pytest.raises(ValueError, match='the text 89 characters'):
        convert.display_text(String(data=text + 'x'))


@pytest.mark.parametrize(
    ('number', 'intensity', 'sides'),
    [
        (0, 1.0, (True, False)),
        (1, 0.1, (False, True)),
        (0, 0.0, (False, False)),
        (1, 0.0, (False, False)),
    ],
)
def test_rumble(number: int, intensity: float, sides: tuple[bool, bool]) -> None:
    message = JoyFeedback(type=JoyFeedback.TYPE_RUMBLE, id=number, intensity=intensity)
    assert convert.rumble_sides(message) == sides


@pytest.mark.parametrize(
    ('kind', 'number', 'intensity'), [(0, 0, 1.0), (1, 2, 1.0), (1, 0, math.nan), (1, 0, 1.5)]
)
def test_bad_rumble_is_refused(kind: int, number: int, intensity: float) -> None:
    with pytest.raises(ValueError, match=r'not'):
        convert.rumble_sides(JoyFeedback(type=kind, id=number, intensity=intensity))


# -- NMEA 0183: sentences as printed in common references, checksums included ---------------------

GGA = '$GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,*76'
RMC = '$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A'
GSV = '$GPGSV,3,1,11,03,03,111,00,04,15,270,00,06,01,010,00,13,06,292,00*74'


def checked(body: str) -> str:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f'${body}*{total:02X}'


def fix(sentence: str) -> Any:
    return convert.nav_sat_fix(sentence, STAMP, 'remote')


@pytest.mark.parametrize(
    ('sentence', 'latitude', 'longitude', 'altitude'),
    [
        (GGA + '\r\n', 53 + 21.6802 / 60, -(6 + 30.3372 / 60), 61.7 + 55.2),
        (RMC, 48 + 7.038 / 60, 11 + 31 / 60, math.nan),
        *(  # without height or geoid separation
            (checked(f'GPGGA,1,5321.0,N,00630.0,W,1,8,1,{heights},M,,'), 53.35, -6.5, math.nan)
            for heights in ('61.7,M,', ',M,55.2', ',M,')
        ),
        (checked('GPRMC,1,A,0000.0000,N,00000.0000,E,,,,,'), 0.0, 0.0, math.nan),
        (checked('GPRMC,1,A,0030.0000,S,00030.0000,W,,,,,'), -0.5, -0.5, math.nan),
        (checked('GPRMC,1,A,9000.0000,N,18000.0000,E,,,,,'), 90.0, 180.0, math.nan),
        (checked('GPRMC,1,A,9000.0000,S,18000.0000,W,,,,,'), -90.0, -180.0, math.nan),
    ],
)
def test_position(sentence: str, latitude: float, longitude: float, altitude: float) -> None:
    message = fix(sentence)
    found = (message.latitude, message.longitude, message.altitude)
    assert found == pytest.approx((latitude, longitude, altitude), nan_ok=True)
    assert message.status.status == NavSatStatus.STATUS_FIX
    assert (message.header.stamp, message.header.frame_id) == (STAMP, 'remote')


@pytest.mark.parametrize(
    'body',
    [
        *('GPGGA,092750,,,,,0,00,,,M,,M,,', 'GPRMC,123519,V,,,,,,,230394,,'),
        *(  # estimated, manual, simulated, and what is none
            f'GPGGA,1,5321.6802,N,00630.3372,W,{quality},8,1,61.7,M,55.2,M,,'
            for quality in ('', '6', '7', '8', '9', 'x')
        ),
    ],
)
def test_no_fix_is_not_the_gulf_of_guinea(body: str) -> None:
    message = fix(checked(body))
    assert message.status.status == NavSatStatus.STATUS_NO_FIX
    assert math.isnan(message.latitude)
    assert math.isnan(message.longitude)


MODES = {  # as in GGA's quality: autonomous, differential, precise, RTK fixed and float
    'A': NavSatStatus.STATUS_FIX,
    'D': NavSatStatus.STATUS_SBAS_FIX,
    'P': NavSatStatus.STATUS_FIX,
    'R': NavSatStatus.STATUS_GBAS_FIX,
    'F': NavSatStatus.STATUS_GBAS_FIX,
    # Estimated, simulated, manual, not valid, and what is none.
    **dict.fromkeys(('E', 'S', 'M', 'N', 'X', ''), NavSatStatus.STATUS_NO_FIX),
}


@pytest.mark.parametrize(('mode', 'status'), MODES.items())
@pytest.mark.parametrize('position', ['4807.0380,N,01131.0000,E', '0000.0000,N,00000.0000,E'])
def test_mode_of_an_rmc_sentence_says_whether_it_is_a_fix(
    position: str, mode: str, status: int
) -> None:
    message = fix(checked(f'GPRMC,101112.00,A,{position},0.0,0.0,221126,,,{mode}'))
    assert message.status.status == status
    assert math.isnan(message.latitude) is (status == NavSatStatus.STATUS_NO_FIX)
    # Later editions of the standard have a navigational status behind the mode.
    later = fix(checked(f'GPRMC,101112.00,A,{position},0.0,0.0,221126,,,{mode},V'))
    assert later.status == message.status


@pytest.mark.parametrize(
    ('talker', 'service'),
    [
        ('GP', NavSatStatus.SERVICE_GPS),
        ('GL', NavSatStatus.SERVICE_GLONASS),
        ('GA', NavSatStatus.SERVICE_GALILEO),
        ('GB', NavSatStatus.SERVICE_COMPASS),
        ('BD', NavSatStatus.SERVICE_COMPASS),
    ],
)
def test_talker_names_the_service(talker: str, service: int) -> None:
    message = fix(checked(f'{talker}GGA,1,5321.6802,N,00630.3372,W,1,8,1,61.7,M,55.2,M,,'))
    assert message.status.service == service


BODY = GGA[1:-3]


@pytest.mark.parametrize(
    'sentence',
    [
        *('', '$', GSV),
        *(GGA[:-1], GGA[:-3], GGA[:-2] + '00', GGA[1:]),  # cut short, and another checksum
        GGA.replace('$', '!'),  # the checksum does not cover it
        GGA.replace('5321', '5322'),
        *(checked(body) for body in ('GPGGA', 'GPRMC,123519,A', BODY[: BODY.index(',8,')])),
        checked('PGRMC,A,218.8,100,6378137.000,298.257223563,,,,A,3,1,1,4,30'),
        *(
            checked(BODY.replace(sound, other))
            for sound, other in (
                *(('N', 'X'), ('5321.6802', ''), ('5321.6802', 'nan.0'), ('61.7', '1e9')),
                *(('5321.6802', '5360.0000'), ('5321.6802', '9100.0000'), ('5321', '-5321')),
                *(('5321.6802', '53-1.5'), ('5321', '-021'), ('5321', '521')),
                *(('5321.6802', '00530.5'), ('00630', '18030'), ('00630', '0630')),
                *(('GPGGA', 'GGA'), ('GPGGA', 'GPXGGA'), ('00630.3372', 'inf.0')),
            )
        ),
    ],
)
def test_unsound_or_other_sentence_gives_no_fix(sentence: str) -> None:
    assert fix(sentence) is None


@pytest.mark.parametrize(
    ('sentence', 'kind'),
    [
        *((GGA, 'GGA'), (RMC, 'RMC'), (GSV, 'GSV'), ('$GP', ''), ('', '')),
        *((wrong, '') for wrong in ('$GPGGA', '$GPGGAX,1', '!GPGGA,1', '$PGRMC,A')),
    ],
)
def test_sentence_type(sentence: str, kind: str) -> None:
    assert convert.nmea_type(sentence) == kind


@given(st.text(max_size=90) | st.text('$GPAR,MC*0123456789.-NSEW', max_size=90).map(checked))
def test_any_text_raises_nothing(text: str) -> None:
    fix(text)


@pytest.mark.parametrize(
    ('status', 'strength'),
    [
        (None, -1),
        (RemoteStatus(10, False, 0, 2), 0),
        (RemoteStatus(10, False, 2, 0), 2),
        (RemoteStatus(10, False, 3, 0), -1),
    ],
)
def test_radio_strength_is_what_the_vsc_perceives(status: Any, strength: int) -> None:
    assert convert.radio_strength(status).data == strength
