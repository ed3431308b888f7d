# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the output waits for and is scaled by, as a table: drives, measured joints, speed limits.

A row is a rule and the story that shows it; stage/mux_story.py says how a story is written.
"""

import pytest

from stage.mux_story import play, stories

AWAITED = 'in drive; ready; drive disabled; 0.26 s; low drive; '

DRIVES = {
    'a slow drive gets zero and then a ramp from rest': AWAITED
    + """0.1 s at rest; is ACTIVE low; {0.02|0.1|0.5|0.99} s at rest; drive enabled;
        drive enabled!; step; at 0 0; 0.5 s; at 1 0.5""",
    'one that is not enabled is told': AWAITED
    + """2 s at rest; is ACTIVE low; says operator 'low' waits for the drive to be enabled;
        says it says that it is not""",
    'one that fell silent is told': """in drive; ready; drive silent; 0.26 s; low drive;
        2 s at rest; is ACTIVE low; says operator 'low' waits for the drive to be enabled;
        says the drive is stale: last heard""",
    'one that never says anything has no such topic': """in drive; drive silent; active low;
        finds the drive: silent; drive disabled!; tick; at 0 0; 0.5 s at rest""",
    'it counts once its topic is in doubt': """in drive; drive silent; active low; invalid drive;
        tick; at 0 0; says waits for the drive to be enabled: the drive is invalid: a test""",
    'one that drops out gets zero and then a ramp from rest': """in drive; active low;
        drive disabled; drive disabled!; tick; at 0 0; 0.5 s at rest; is ACTIVE low;
        finds the drive: not enabled; drive enabled; 0.1 s; finds the drive: enabled; 0.5 s;
        at 1 0.5""",
    'a drop out between ticks is one': """in drive; active low; lists nothing; drive disabled!;
        drive enabled!; says waits for the drive to be enabled: the drive was not enabled; tick;
        at 0 0; step; at 0 0; 0.5 s; at 1 0.5""",
    'a gap is a drop out': """in drive; with stall_limit=1.0 drive_timeout=0.15; active low;
        jump 0.18; send; tick; is ACTIVE low; at 0 0""",
    'its word is stale at its timeout': """in drive; active low; send; drive silent; 0.25- s;
        at 1 0.5; step; at 0 0""",
    'two publishers are no word': """in drive; active low; invalid drive; 0.5 s; at 0 0;
        says the drive is invalid: a test; valid drive; 0.5 s; at 1 0.5""",
    'a drop out ends a ramp': """in {drive; active low|joints and drive; active low; joints stuck};
        soft stop!; tick; is STOPPING; drive disabled!; tick; is STOPPED""",
    'while it is awaited there is nothing to ramp': AWAITED
    + '0.2 s; soft stop!; tick; is STOPPED',
    'a takeover meanwhile moves nothing': AWAITED
    + """0.7 s at rest; high back; 0.2 s at rest; is ACTIVE high; drive enabled; 0.5 s;
        at -1 -0.5""",
    'others follow its owner meanwhile': AWAITED + '0.3 s at rest; follows low',
    'who is overruled meanwhile loses control': AWAITED + '0.2 s; high off; 0.07 s; is READY',
    'a freeze forgets its word': """in drive; active low; drive silent; jump 0.15; tick;
        is STOPPED; finds the drive: silent""",
    'without one the ramp waits for nothing': """ready; low held; 0.1 s; low drive; 0.3 s;
        at 1 0.5; drives unknown""",
    **{
        f'what {name} loses both lose': f"""in two drives; active low; {name} disabled!;
        {name} enabled!; says waits for drive '{name}' to be enabled; drives enabled;
        {name} disabled!; drives disabled; {name} enabled!; tick; at 0 0; is ACTIVE low; step;
        at 0 0; 0.5 s; at 1 0.5"""
        for name in ('front', 'rear')
    },
    'one with a name is waited for unheard': """in two drives; drive silent; ready; low drive;
        1 s at rest; is ACTIVE low; says drive 'front' is silent: never heard, limit 250 ms: start
        its node; front enabled!; says waits for drive 'rear' to be enabled""",
}

JOINTS = {
    # Zero is reached when the joints stand.
    'a takeover waits for standstill': """in joints; active {low|autonomy}; joints follow 4;
        high back; send; 0.15 s; is ACTIVE high; at 0 0; says passes through zero first;
        says waiting for standstill, left at 0.; 0.5 s; at -1 -0.5""",
    'an overruled owner keeps control until standstill': """in joints; active low;
        joints follow 4; high off; send; 0.13 s; is ACTIVE low; at 0 0; says moved its sticks;
        says waiting for standstill, left at 0.; 0.2 s; is READY""",
    'a ramp ends at standstill': """in joints; active low; joints follow 4; soft stop!; tick;
        is STOPPING; says stopping on a ramp; says ramping, left at 1.0 rad/s; 0.15 s; is STOPPING;
        at 0 0; says waiting for standstill, left at 0.; 0.15 s; is STOPPED;
        reason the ramp has ended, after: """,
    'a ramp of one joint says what is left': """in joints; ready; not says standstill; low left;
        0.3 s; soft stop!; tick; says ramping, left at 1.0 rad/s""",
    'a ramp ends at stop_time whatever they do': """in patient joints; active low; joints stuck;
        soft stop!; tick; 0.5- s; is STOPPING; step; is STOPPED;
        reason the ramp has ended, left at 1.0 rad/s, after: """,
    'at zero command joints in motion are no cut': """in joints; active low; joints follow 4;
        high back; send; 0.15 s; at 0 0; soft stop!; tick; is STOPPING""",
    'without feedback nothing is awaited': 'active low; high back; 0.35 s; at -1 -0.5',
    # Motion that nobody asked for.
    'a deadman pressed again gives no more time': 'in joints; with stop_time=1.0; active low; '
    'joints stuck; low rest; 0.45 s; low held; 0.15 s; is ACTIVE low; '
    + 'low rest; 0.45 s; low held; 0.15 s; ' * 2
    + 'is STOPPED; asked all',
    'creeping on as control ends is a stop': """in joints and drive; active low;
        joints run 0.55 0.55; high off; drive disabled; 1 s; is STOPPED; asked all""",
    'creeping on at zero command is one after stop_time': """in joints; active low;
        joints run 0.55 0.55; high {off|held}; send; 0.5 s; is ACTIVE; 0.2 s; is STOPPED;
        asked all""",
    'creeping while the owner keeps control is none': """in joints and drive; active low;
        joints run 0.55 0.55; drive {enabled|disabled}; low held; 1 s; is ACTIVE low; at 0 0""",
    'who does not stop when told stops all devices': """in joints; active low; joints stuck;
        low rest; send; tick; is READY; 0.125 s; says waiting for standstill: left at 1.0 rad/s;
        0.375- s; is READY; asked nobody; step; is STOPPED; asked all; causes motion;
        reason the joints do not stand 500 ms after control: left at 1.0 rad/s; 1 s; reset no;
        joints follow 100; 1 s; asked nobody; reset""",
    'no refused reset ends a trip meanwhile': """in joints and own; active low; joints stuck; trip;
        low rest; always stop; 1 s; reset no; reply the joints do not stand;
        not reply the trip is ended; joints follow 100; 1 s; asked all; reset no;
        reply the trip is ended""",
    'who stands in time is no stop': """in joints; active low; joints follow 2.5; low rest; 1 s;
        is READY""",
    'who is not seen to stand after a stop is one': """in joints; active low; joints stuck;
        joints {heard|silent}; always stop!; tick; 0.5- s; asked nobody; step; asked all;
        says the joints do not stand 500 ms after control: ; joints follow 100; joints heard;
        0.1 s; asked nobody""",
    'a standstill from before is none': """in {joints|slow joints}; joints stuck; ready; low drive;
        0.0625 s; joints silent; 0.1 s; not at 0 0; low rest; send; tick; is READY;
        says waiting for standstill: not measured since; 0.5 s; asked all;
        says the joints do not stand 500 ms after control: ; joints heard; 0.1 s; asked nobody""",
    'one from before ends neither takeover nor ramp': """in slow joints; joints stuck; ready;
        select; 0.1 s; joints silent; autonomy go; 0.2 s; at 1 0.5; {high back; 0.3 s;
        is ACTIVE high; at 0 0; says waiting for standstill, not measured since; joints heard;
        0.2 s; at -1 -0.5|soft stop; 0.3 s; is STOPPING; at 0 0;
        says waiting for standstill, not measured since; joints heard; 0.1 s; is STOPPED}""",
    'they are judged when somebody asks': """in patient joints; with clear_time=0.125; active low;
        joints stuck; low rest; {always stop!; always clear!; low rest!; tick; 0.5- s;
        jump 0.0078125; reset no|send; tick; 0.5- s; jump 0.0078125; select no};
        reply the joints do not stand 500 ms after control""",
    'too fast for overspeed_time is a stop': """in joints; active low; joints run 1.0 1.1; 0.2 s;
        is ACTIVE low; 0.02 s; is STOPPED;
        reason joint 'right' runs at 1.1 rad/s, asked for 0.5""",
    'the other way is too fast': 'in joints; active low; joints run 1.0 -0.6; 0.25 s; is STOPPED',
    'for an instant it is none': 'in joints; active low; '
    + 'joints run 2.0 0.5; 0.19 s; joints run 1.0 0.5; step; ' * 5
    + 'is ACTIVE low',
    'lagging behind a ramp is none': """in joints; active low; joints follow 5; low back; 1 s;
        at -1 -0.5""",
    'moving by itself while nobody has control is one': """in joints; ready; joints run 0
        {-0.59; 1.2 s; is READY; asked nobody|-0.61; 0.2 s; is READY; 1 s; is STOPPED; asked all;
        reason joint 'right' runs at -0.6 rad/s, asked for 0.0}""",
    'creeping where nobody had control is none': """in joints; joints run 0.3 0; ready; 1 s;
        is READY""",
    'moving when the mux starts prevents a reset': """in joints; joints run 3 0; 1 s; reset no;
        says joint 'left' runs at 3.0 rad/s, asked for 0.0""",
    # Feedback that is lost.
    'silence in motion stops': """in joints; active low; joints silent; 0.234375 s; is ACTIVE low;
        0.03 s; is STOPPED; reason the feedback is stale: last heard 25""",
    'so does what has no number for each joint': """in joints; active low;
        joints say {nan 0|0 inf|0|}; joints say 1 0.5; tick; is STOPPED;
        reason the feedback is invalid: """,
    'so do two publishers': 'in joints; active low; invalid joints; tick; is STOPPED',
    'lost on a ramp it cuts': """in joints; active low; soft stop!; tick; is STOPPING; joints bad;
        tick; is STOPPED""",
    'without it nobody gets control': """in joints; ready; joints silent; 0.4 s; is READY;
        says the feedback is stale; select no; reply the feedback is stale; low drive; 1 s;
        is READY; joints heard; 1 s; is READY""",
    'without it a reset succeeds': 'in joints; joints silent; 1 s; reset',
    'a clock that jumps before standstill stops all': """in joints; active low; low rest;
        joints stuck; 0.1 s; jump {3600|-3600}; tick; asked all""",
}

LIMITS = {
    'a slow zone is ramped into and left': """in limits; active low; zone 0.25; 0.5 s;
        at 0.25 0.125; is ACTIVE low; slowed speed limit 'zone' allows 25 %;
        finds speed limit 'zone': 25 %; zone 1; 0.5 s; at 1 0.5; slowed nothing""",
    'the least counts': """in limits; active low;
        {zone 0.3; key 0.7|zone 0.7; key 0.3|zone 0.3; key 0.3}; 0.5 s; at 0.3 0.15""",
    'what is beyond the maximum is reduced first': """in limits; active low; zone 0.5; low beyond;
        0.5 s; at 0.5 -0.25""",
    'silent or senseless it is its lowest': """in limits; active low;
        zone {nan|inf|-0.01|1.01|silent}; 0.5 s; at 0.2 0.1;
        slowed speed limit 'zone' allows 20 %: speed limit 'zone' is""",
    'never heard it is its lowest': 'in limits; zone silent; ready; low drive; 0.5 s; at 0.2 0.1',
    'it is stale at its timeout': """in limits; active low; send; zone silent; 0.25- s; at 1 0.5;
        0.02 s; not at 1 0.5""",
    'silence never raises it': """in limits; active low; zone 0.1; 0.5 s; zone {silent|nan}; 1 s;
        at 0.1 0.05""",
    'zero holds the joints and says so': """in limits; active low;
        {zone 0; 0.5 s; lists speed limit 'zone' allows 0 %
        |key 0; 0.5 s; lists speed limit 'key' allows 0 %}; at 0 0; is ACTIVE low""",
    'it makes no sense from its message on': """in limits; active low; zone nan!;
        slowed speed limit 'zone' is invalid: it is nan""",
    'two publishers are none': 'in limits; active low; invalid zone; 0.5 s; at 0.2 0.1',
    'it is no stop and delays none': """in limits; active low; zone 0.5; 0.5 s; soft stop!; tick;
        is STOPPING; zone 1; 0.11 s; is STOPPED""",
}


@stories(DRIVES | JOINTS | LIMITS)
def test_rule(story: str) -> None:
    play(story)


@pytest.mark.parametrize('world', ['drive', 'joints', 'limits'])
def test_story_is_checked(world: str) -> None:
    with pytest.raises(AssertionError, match='--> is READY: it is not'):
        play(f'in {world}; active low; is READY')
