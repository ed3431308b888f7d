# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mux's rules as one table: what stops, what resets, who gets control and how it ends.

A row is a rule and the story that shows it; stage/mux_story.py says how a story is written.
"""

from collections.abc import Callable
import itertools
import math

import pytest

from safety_mux.owners import Run
from safety_mux.protocol import Decision, State
from stage.mux_story import play, SAMPLES, stories, Story

STOPS = {
    # Rule 1: an e-stop source is clear only if it is fresh, says false, and its QoS matches.
    'a source never heard is a stop': """always silent; 2 s; is STOPPED; reset no;
        says e-stop source 'always' is silent: never heard, limit 250 ms""",
    'a source is stale at its timeout': """active low; send; always silent; 0.25- s; is ACTIVE;
        step; is STOPPED; reason e-stop source 'always' is stale: last heard""",
    'true stops with the next tick': """active low; always stop!; tick; is STOPPED;
        reason e-stop source 'always' demands a stop""",
    'a stop that came and went between ticks is one': """active low; always stop!; always clear!;
        tick; is STOPPED""",
    'a gap between ticks is one': """with stall_limit=1.0; active low; jump 0.3; send; tick;
        is STOPPED; reason was stale: last heard 3""",
    'an invalid source stops': """active low; invalid always; tick; is STOPPED; 1 s; reset no;
        says e-stop source 'always' is invalid: a test; low rest; valid always; 0.6 s; reset""",
    # Of an operator: when_owner.
    'it counts for its operator alone': 'remote {stop|silent}; active low; 0.5 s; is ACTIVE low',
    'it keeps its operator from acquiring': """ready; remote stop; 0.1 s;
        says operator 'high' cannot take control: e-stop source 'remote' demands; high drive;
        0.5 s; is READY""",
    'its end gives no control without a rest after it': """
        {remote stop|remote silent|invalid remote}; {ready|active low|active autonomy}; 0.75 s;
        valid remote; remote clear; send; {0|0.125|0.25} s; high back; 1 s never high; is READY;
        high rest; 0.4 s; high back; 0.07 s; is ACTIVE high""",
    'its operator is told to wait only once it is clear': """ready; remote stop; 0.5 s;
        not says operator 'high' has; remote clear; 0.125 s;
        says operator 'high' has been neutral for""",
    'it stops its owner': 'active high; remote stop!; tick; is STOPPED',
    'it stops although the release overtakes it': """active high; high rest; 0.1 s; is READY;
        remote stop!; tick; is STOPPED""",
    'it counts for its timeout after control': """active high; high rest; send; tick; is READY;
        {0.25- s; remote stop!; tick; is STOPPED
        |0.25 s; remote stop!; tick; is READY; remote stop; 0.5 s; is READY}""",
    'it does although another drove meanwhile': """active high; high rest; 0.06 s; low drive;
        0.06 s; is ACTIVE low; low rest; 0.06 s; is READY; remote stop!; tick; is STOPPED""",
    'it is demanded of the others as long': """active high; remote stop; remote stop!; 0.2 s;
        asked always soft; 0.2 s; asked nobody""",
    'a source that counts always is named once': """in owned; always stop; 1 s;
        lists stopped 1000 ms ago: the mux has started / e-stop source 'always' demands a stop: see
        /diagnostics of its node / waiting for reset: call ~/reset""",
    # Rule 2: stop beats everything.
    'a stop in the tick of a reset ends it': '0.6 s; reset; soft stop!; tick; is STOPPED',
    'a reset in the tick of a stop loses': """active low; always stop!; reset no; tick;
        is STOPPED""",
    # Rule 8: time.
    'a frozen process stops and forgets': """active low;
        jump {0.11|3600|-0.5|-3600}; send; tick; is STOPPED; reset no;
        reason this process was frozen; says e-stop source 'always' is silent: never heard""",
    'a gap of stall_limit is no freeze': """with stall_limit=0.125; active low;
        {jump 0.125; send; tick; is ACTIVE|jump 0.1328125; send; tick; is STOPPED}""",
    'a service after a freeze does not overtake the tick': """ready; jump 1; send; select no; tick;
        is STOPPED""",
    # Rule 9: malformed input.
    'a senseless demand of the owner stops': """active low; low {short|long|nan|inf}!; tick;
        is STOPPED; reason operator 'low' is invalid: it""",
    'it does although a good one follows': """active low; low bad!; low drive!; tick; is STOPPED;
        reason a test""",
    'one of somebody else stops nothing': """active low; high bad!; autonomy bad!; tick;
        is ACTIVE low""",
    'a second publisher of the owner stops': """
        {active low; invalid low|active autonomy; invalid autonomy}; tick; is STOPPED;
        reason a test""",
    'a senseless command of autonomy stops': """active autonomy;
        {autonomy bad!; says autonomy is invalid: a test|autonomy inf!; says is not finite
        |autonomy huge!; says is beyond|autonomy large!; says is beyond}; send; tick;
        is STOPPED""",
    # Rule 10: stop category 1.
    'category 0 cuts a ramp': """active low; soft stop!; tick; is STOPPING; always stop!; tick;
        is STOPPED""",
    'category 0 beats category 1': 'active low; soft stop!; always stop!; tick; is STOPPED',
    'a release cuts a ramp': """active low; soft stop!; tick; low rest!; tick; is STOPPED;
        reason operator 'low' released its deadman""",
    'a stop taken back still ends stopped': """active low; soft stop!; tick; is STOPPING;
        soft clear!; tick; is STOPPING; {1 s; is STOPPED; reason the ramp has ended
        |low rest!; tick; is STOPPED; reason deadman on the ramp of: e-stop source 'soft'}""",
    'at zero there is nothing to ramp': """active low; low held; 0.3 s; soft stop!; tick;
        is STOPPED; not reason ramp""",
    'without an owner there is nothing to ramp': """ready; soft stop!; tick; is STOPPED;
        reason nobody had control""",
    'a trace of rounding ends in time': """with stop_time=0.0390625; active low; soft stop!; tick;
        is STOPPING; 0.0390625 s; is STOPPED""",
    'a torque that is to end is zero at once': """in torques; active low;
        {high off!; tick; is READY|high drive!; tick; is ACTIVE high; at 0 0}""",
    # Hold and trip.
    'a hold lasts': """active low; low rest; hold; 1 s; is STOPPED; reset no; reply a test; unhold;
        0.6 s; reset""",
    'a trip is latched until a reset': """active low; low rest; trip; tick; is STOPPED; 2 s;
        is STOPPED; asked all; says a trip is active until ~/end_trip is called, or a reset;
        ready; tick; asked nobody""",
    'an ended trip asks nobody and stays latched': """active low; low rest; trip; 0.49 s;
        end trip no; reply not ended: a trip lasts 500 ms or longer; 0.02 s; end trip; tick;
        is STOPPED; asked nobody; end trip no; reply no trip is active; 1 s; is STOPPED; reset""",
    'a trip is ended from clear_time on': 'ready; trip; {0.5- s; end trip no|0.5 s; end trip}',
    'a trip after a trip lasts as long': """active low; trip; 1 s; trip; end trip no; 0.4 s;
        asked all""",
    'the first stop is kept but for a trip or a freeze': """active low; always stop; 0.5 s;
        reason 'always' demands; soft stop; 0.5 s; not reason 'soft'; trip; tick;
        reason ~/trip was called; 0.5 s; jump 0.15; tick; reason frozen""",
    # What a source demands by itself is asked of all others, never its echo.
    'nobody is asked to stop once all were heard': """in own topics; asked all; send; tick;
        asked nobody""",
    'who does not count asks nobody': """in own remote; remote silent; remote own silent;
        high silent; ready; asked nobody; not says asked to stop""",
    'a silent topic may be a demand': """in own topics; send; tick;
        {always own silent|always silent}; 0.25- s; asked nobody; step; asked other remote""",
    'what was said before a freeze does not count': """in own topics; send; tick; asked nobody;
        jump 0.15; tick; always own silent; send; tick; asked other remote""",
    'a blip is asked of the others once': """in own topics; 0.1 s; asked nobody; always own stop!;
        always own clear!; tick; asked other remote; tick; asked nobody""",
}

RESETS = {
    # Rule 3: a reset is an edge.
    'every start is stopped': 'is STOPPED; 5 s; is STOPPED',
    'before clear_time it is refused and not queued': """active low; low rest; always stop!; tick;
        0.2 s; reset no; reply of 500 ms; 2 s; is STOPPED; reset""",
    'clear_time begins with the last stop': """1 s; always stop!; tick; send; step;
        {0.5- s; reset no|0.5 s; reset}""",
    'clear_time begins with the first messages': 'step; {0.5- s; reset no|0.5 s; reset}',
    'a blip begins it anew': '0.45 s; always stop!; always clear!; 0.4 s; reset no',
    'none of it is over when a stop ends': """always stop; 1 s; always clear!; clear no; reset no;
        reply not reset: all stops have been clear for 0 ms of 500 ms""",
    'a fresh operator has to be at neutral': """high {off|held|half|drive}; 1 s; reset no;
        reply operator 'high' is not at neutral""",
    'who is not there is not asked': 'high silent; 1 s; reset',
    'who makes no sense is not at neutral': """high short; 1 s; reset no;
        says operator 'high' is invalid: it has a demand for 1 joints, not 2""",
    'a held or repeated one does nothing': 'always stop; 0.5 s; '
    + '0.1 s; reset no; ' * 10
    + 'always clear; '
    + '0.1 s; reset no; ' * 30
    + 'reply held or repeated; 0.6 s; reset',
    'one counts clear_time after a refused one': """low off; 1 s; reset no; low rest;
        {0.5- s; reset no|0.5 s; reset}""",
    'who is refused resets again': 'active low; '
    + 'low rest; always stop; 1 s; reset no; always clear; 0.6 s; reset; 0.1 s; ' * 3,
    'what is not stopped is not reset': """
        {ready; reset no; tick; is READY|active low; reset no; tick; at 1 0.5}""",
    # Resets in vain are those of a script.
    'one in vain has to be followed by reset_silence': """ready; reset no; always stop!;
        {5- s; is STOPPED; reset no|5 s; is STOPPED; reset}""",
    'a late one resets nothing and is not in vain': """1 s; late no; reply not reset: it may have
        waited; reset""",
    'a late one is told as late, however soon': """always stop; 1 s; reset no; 0.1 s; late no;
        reply not reset: it may have waited""",
    'a late one in READY is in vain': """ready; late no; always stop!; 1 s; reset no;
        reply resets have been called since before the stop""",
    'a late one keeps a line in vain going': """ready; reset no; always stop!; 5 s; late no; 1 s;
        reset no; reply resets have been called since before the stop""",
    'one refused for something else ends the line': """ready; reset no; always stop!; low off; 5 s;
        reset no; reply not at neutral; low rest; 0.5 s; reset""",
    # Devices that stop for a trip are its echo.
    'a refused one ends a trip of which the echo is left': """in own topics; ready; trip; tick;
        always stop; other stop; remote stop; {0.5- s; reset no; not reply the trip is ended;
        tripped|0.5 s; reset no; reply not reset: the trip is ended; not tripped}""",
    'it ends none that anything else prevents': """in own topics; ready; trip; tick; always stop;
        other stop; {always own stop; 1 s|low off; 1 s|hold; 1 s|1 s; jump 0.15}; reset no;
        tripped""",
    'it ends none before its tick': """in own topics; with stall_limit=1.0; always stop; 1 s; trip;
        jump 0.625; send; reset no; tripped""",
    'without a trip none is spoken of': 'always stop; 1 s; reset no; not reply trip; not tripped',
}

OWNERS = {
    # Rule 4: a reset moves nothing; motion needs a new acquire.
    'a reset moves nothing': '0.6 s; reset; 5 s disabled; is READY',
    'two samples are no rest': """with neutral_time=0.25; 0.6 s; reset; low silent; low rest!;
        {0.3|0.26|0.25|0.1} s; low rest!; 0.01 s; low drive!; 0.01 s; is READY""",
    'the deadman counts from neutral_time on': """with neutral_time=0.3125; 1 s; reset; tick;
        low silent; low rest!; 0.1953125 s; low rest!; {0.1171875- s; low rest!; low held!; tick;
        is READY|0.1171875 s; low rest!; low held!; tick; is ACTIVE low}""",
    'one pressed too early is forgotten': """0.6 s; reset; 0.2 s; low drive; 2 s; is READY;
        says operator 'low' held its deadman before it could count: release it""",
    'silence is not neutral': """low silent; ready; 2 s; low rest!; 0.2 s; low drive; 0.5 s;
        is READY""",
    'a stick off neutral begins the rest anew': """ready; low off; 0.1 s;
        says operator 'low' has not been neutral; low drive; 1 s; is READY""",
    'two buttons may come one after the other': """ready; low half; 0.1 s; low drive; 0.1 s;
        is ACTIVE low""",
    'half a deadman is no rest': """ready; low off; 0.1 s; low half; 2 s; low rest; 0.1 s;
        low drive; 0.5 s; is READY""",
    'half a deadman let go of begins a new rest': """ready; low half; 0.125 s; low rest; 0.125 s;
        low half; 0.0625 s; says operator 'low' has not been neutral since; low drive; 0.5 s;
        is READY""",
    'who is invalid does not rest': """ready; invalid low; 1 s; valid low; low drive; 0.5 s;
        is READY""",
    'a press before a malformed message does not count': """ready; low drive!; low bad!;
        low drive!; tick; is READY""",
    'a refused press does not count later': """ready; remote stop; 0.125 s; high held; 0.125 s;
        remote clear; 0.125 s; high drive; 0.5 s; is READY""",
    'a fault that is over stops nobody': """0.5 s;
        {low bad!; 1 s; active low; 1 s; is ACTIVE low
        |high bad!; 1 s; active high; 1 s; is ACTIVE high}""",
    'a deadman held all along gets control once': """active low; 0.5 s; is ACTIVE low; low rest;
        0.1 s; low drive; 1 s; is READY""",
    # Rule 5: what was asked before a stop is forgotten.
    'a deadman held through stop and reset moves nothing': """active low; always stop!; tick; 1 s;
        reset no; low silent; 1 s; reset; low drive; 2 s; is READY""",
    'the first output is zero and ramps from there': """active low; always stop!; tick; is STOPPED;
        low rest; ready; low drive; low drive!; tick; is ACTIVE low; at 0 0; step;
        at 0.078 0.039""",
    'a stop ends the selection of autonomy': """active autonomy; always stop!; tick; ready; 1 s;
        is READY""",
    'a stop ends a rest': """ready; finds operator 'low': rested; soft stop!; tick;
        finds operator 'low': at rest""",
    # Rule 6: a lost owner stops the machine.
    'a silent owner stops and hands over to nobody': """{active low; low silent
        |active high; high silent|active autonomy; autonomy silent}; 0.4 s; is STOPPED;
        reason the owner was lost""",
    'an owner with a gap between ticks is lost': """in quick; with stall_limit=1.0; active low;
        jump 0.2; send; tick; is STOPPED; reason the owner was lost""",
    'a release is zero at once and hands over to nobody': """active low; low rest!; low drive!;
        tick; is READY; 1 s; is READY""",
    # Rule 7: takeover.
    'a takeover is told': "active low; high drive; 0.125 s; reason operator 'high' took over",
    'its release does not hand back': 'active low; high drive; 0.7 s; high rest; 1 s; is READY',
    'a lower one takes over from nobody': """active high; low drive; 1 s; is ACTIVE high; low rest;
        0.5 s; low held; 0.5 s; is ACTIVE high; low off; 0.5 s; is ACTIVE high""",
    'a takeover needs hold_time': """ready; low drive; send; tick; is ACTIVE low;
        {0.5- s; high back!; tick; is ACTIVE low|0.5 s; high back!; tick; is ACTIVE high}""",
    'an early one ends control and is not queued': """ready; low drive; 0.2 s; high drive; 2 s;
        is READY; reason less than 500 ms after a change of owner; high rest; 0.5 s; high drive;
        0.1 s; is ACTIVE high""",
    'hold_time keeps nobody from what is free': """ready; low drive!; tick; is ACTIVE low;
        reason operator 'low' took control; low rest!; tick; is READY; high drive!; tick;
        is ACTIVE high""",
    'a stick after a press that did not count takes nothing': """ready; low drive; 0.2 s;
        high held; 2 s; high drive; 1 s; is READY""",
    'who comes back with its deadman pressed ends control': """ready; high drive; 0.1 s;
        high silent; 1 s; ready; low drive; 0.7 s; is ACTIVE low; high drive; 0.5 s; is READY""",
    'so does one after malformed messages': """ready; high off; 0.1 s; high {drive|held}; 0.1 s;
        high silent; 0.1 s; high bad; 0.5 s; low drive; 0.7 s; is ACTIVE low; high {drive|held};
        0.5 s; is READY; reason operator 'high' pressed its deadman before it could count""",
    'a stick that stays off neutral ends nothing': """ready; high off; 0.5 s; low drive; 0.7 s;
        {high bad!|step}; 0.5 s; is ACTIVE low; high drive; 0.5 s; is READY;
        reason operator 'high' pressed its deadman before it could count;
        says operator 'high' held its deadman before it could count: release it""",
    'a higher one without effect ends control on a ramp': """active {low|autonomy};
        invalid remote; {high off; high off!; 0.03 s; says operator 'high' moved its sticks
        |high held; high held!; 0.03 s; says 'high' pressed its deadman, which did not count
        |high drive; high drive!; 0.03 s; says 'high' pressed its deadman, which did not count};
        says is losing control: ; is ACTIVE; not at 1 0.5; 0.2 s; is READY; 2 s; is READY""",
    'a blip does, too': 'active low; high {off|drive}!; high rest!; 0.3 s; is READY',
    'one in the tick of the selection does, too': """ready; select; low {off|drive}!; tick;
        is READY""",
    'a takeover that counts wins over that ramp': """active autonomy; high off!; step; low drive;
        0.06 s; is ACTIVE low; 1 s; at 1 0.5""",
    'a stop on that ramp latches': """active low; high off!; 0.03 s; is ACTIVE low;
        {always stop!; tick; is STOPPED|soft stop!; tick; is STOPPING}; 1 s; is STOPPED""",
    'who has two publishers only ends control': """active low; invalid high; 1 s; is ACTIVE low;
        high drive; 1 s; is READY""",
    'half a deadman ends no control': """active low; high half; 1 s; is ACTIVE low; high drive;
        0.1 s; is ACTIVE high""",
    'a stick off neutral before a freeze counts anew': """ready; high off; 0.125 s; high silent;
        jump 0.15; tick; says operator 'high' is silent: never heard; active low; high off; 0.5 s;
        is READY""",
    'others follow while what the owner asks for counts': """ready; follows nobody; low drive;
        0.5 s; follows low; {high off; send; tick; is ACTIVE low|soft stop!; tick;
        is STOPPING low|always stop!; tick|low silent; 0.4 s|low off; send; tick};
        follows nobody""",
    'they follow a new owner at once': """active low; high drive; send; tick; is ACTIVE high;
        not at 0 0; follows high""",
    # Autonomy.
    'a person takes over from autonomy at once': """ready; select; 0.05 s; low drive; 0.1 s;
        is ACTIVE low; low rest; 1 s; is READY""",
    'autonomy needs commands of zero first': """ready; autonomy go; 0.2 s; select no;
        reply autonomy has asked for zero for 0 ms of 300 ms""",
    'silent or senseless it is not selected': 'ready; autonomy {silent|nan}; 0.5 s; select no',
    'invalid it does not rest': """1 s; reset; tick; 0.2 s; {autonomy bad!|autonomy nan!
        |invalid autonomy; 0.5 s; select no; reply a test; valid autonomy}; 0.2 s; select no;
        reply has asked for zero for; 0.3 s; select""",
    'silence within its timeout is no rest': """in slow autonomy; autonomy silent; ready;
        autonomy zero!; {4 s; autonomy zero!; 4 s; autonomy zero!; select no
        |0.26 s; autonomy zero!; 0.26 s; autonomy zero!; select no
        |0.2 s; autonomy zero!; 0.2 s; autonomy zero!; select}""",
    'its rest ends with silence as long': """in slow autonomy; ready; autonomy zero!;
        autonomy silent; {0.25- s; select|0.25 s; select no; reply silence is no rest;
        says silence is no rest; autonomy zero!; 0.1 s; select no}""",
    'it is selected in READY and not queued': """0.6 s; select no; ready; 1 s; is READY""",
    'it is not selected in the tick of the reset': '2 s; reset; select no; 1 s; select',
    'it is not selected while a deadman is held': """ready; low off; 0.1 s; low held; 0.1 s;
        select no""",
    'it is not selected again in control': 'active autonomy; autonomy zero; 0.5 s; select no',
    'zero that it asked for in control is no rest': """ready; select; 1 s;
        {deselect|low drive!; tick; is ACTIVE low; low rest!}; tick; is READY; select no;
        reply has asked for zero for""",
    'stop and deselect leave no ramp': """active autonomy; soft stop!; deselect; tick; is STOPPED;
        reason autonomy was deselected""",
    'deselected it is zero at once': 'active autonomy; deselect; tick; is READY',
    'where there is none it is not selected': 'with autonomy=null; ready; select no',
}

WORDS = {
    # Rule 12: the full answer.
    'a fresh mux names everything': """says e-stop source 'always' is silent: never heard;
        says e-stop source 'soft' is silent: never heard;
        says operator 'low' is silent: never heard; says autonomy is silent: never heard;
        says waiting for reset: call ~/reset""",
    'what is missing for a reset and nothing else': """reason the mux has started; always stop;
        1 s; lists stopped 1000 ms ago: the mux has started / e-stop source 'always' demands a
        stop: see /diagnostics of its node / waiting for reset: call ~/reset; always clear; 0.25 s;
        first stopped 1250 ms ago; says all stops have been clear for; 1 s; clear yes; reset;
        reply reset: READY""",
    'the way to motion': """0.3 s; says all stops have been clear for; 0.4 s; reset; 0.2 s;
        says operator 'low' has been neutral for; 0.3 s;
        says press the deadman of 'low' to take control; says call ~/select_autonomy; low held;
        0.2 s; says operator 'low' has control and asks for zero; low drive; 0.2 s; lists nothing;
        soft stop!; tick; says stopping on a ramp""",
    'the reason is said where it is not all there': """ready; always stop; {soft stop; send; tick;
        0.125 s; first ends ago; always clear; 0.125 s; first 'always' demands a stop; soft clear;
        0.125 s; first 'always' demands a stop|send; tick; soft stop; 0.125 s; first ends ago;
        always clear; 0.125 s; first 'always' demands a stop}""",
    'why an owner stands still': """active low; low left; 0.25 s; lists nothing; high held; send;
        tick; says 'high' takes control: the output passes through zero first; 0.25 s;
        lists operator 'high' has control and asks for zero""",
    'the first tick in control': """ready; low drive!; tick; is ACTIVE low; at 0 0;
        says 'low' takes control""",
    'an own topic that is silent': """in own alone; with operators=[]; always own silent; 1 s;
        says own e-stop of e-stop source 'always': never heard; always own clear!;
        not says own e-stop""",
    'none that there is not': 'always silent; 1 s; not says own e-stop',
    'by whom an owner is overruled': """active low; high off; send; tick;
        lists operator 'low' is losing control: operator 'high' moved its sticks""",
    'all that a press lacked': """active low; remote stop; 0.125 s; high drive; 0.5 s;
        reason before it could count; reason e-stop source 'remote' demands a stop;
        not reason hold""",
    'the stop that a press came with': """active low; remote stop!; high drive!; tick;
        says which did not count: e-stop source 'remote' demands a stop""",
    'what its node says of a device': """always stop; 0.5 s; explain always pull the button;
        says e-stop source 'always' demands a stop: pull the button; explain always;
        says demands a stop: see /diagnostics""",
    # In fields.
    'the cause of a stop and the condition of its source': """active low;
        {always stop; 0.4 s; finds e-stop source 'always': stop
        |always silent; 0.4 s; finds e-stop source 'always': stale
        |invalid always; 0.4 s; finds e-stop source 'always': invalid};
        causes e-stop source 'always'; finds e-stop source 'soft': clear; clear no""",
    'the cause that is no source': """active high; {high silent; 0.4 s; causes operator 'high'
        |trip; 0.4 s; causes trip|hold; 0.4 s; causes hold|jump 0.2; 0.4 s; causes stall}""",
    'the cause of a ramp outlasts it': """active low; soft stop; send; tick; is STOPPING; clear no;
        0.6 s; is STOPPED; causes e-stop source 'soft'""",
    'what an operator does': """ready; {low off; 0.4 s; finds operator 'low': in use
        |low held; 0.4 s; finds operator 'low': in use
        |low rest; 0.4 s; finds operator 'low': rested
        |low silent; 0.4 s; finds operator 'low': stale}""",
    'a rest that is too short': "active low; low rest; 0.1 s; finds operator 'low': at rest",
    'what autonomy does': """ready; 0.4 s; finds autonomy: rested; autonomy go; 0.1 s;
        finds autonomy: in use; autonomy zero; 0.1 s; finds autonomy: at rest""",
}


@stories(STOPS | RESETS | OWNERS | WORDS)
def test_rule(story: str) -> None:
    play(story)


# What is not a story.


@pytest.mark.parametrize('doing', ['drive', 'back'])
def test_takeover_passes_through_zero(doing: str) -> None:
    story, values = play('active low'), list[float]()
    story.samples['high'] = SAMPLES[doing]
    story.run(0.5, lambda decision: values.append(decision.demand[0]))
    assert 0.0 in values
    assert abs(values[-1]) == 1.0


def test_category_1_ramps_to_zero_in_time_and_then_disables() -> None:
    story, seen = play('with stop_time=0.0625; active low; soft stop!'), list[Decision]()
    story.run(0.125, seen.append)
    ramp = [each for each in seen if each.state is State.STOPPING]
    assert 0 < len(ramp) * story.step < 0.0625
    values = [each.demand[0] for each in ramp]
    assert values == sorted(values, reverse=True)
    assert all(each.state is State.STOPPED for each in seen[len(ramp) :])
    assert "the ramp has ended, after: e-stop source 'soft'" in story.reason()


@pytest.mark.parametrize('period', [0.6, 1.0, 4.0])
def test_script_that_resets_for_ever_arms_once(period: float) -> None:
    story, accepted = play('0.6 s'), []
    for stops in range(4):
        for step in ('always stop', '0.2 s', 'always clear'):
            story.take_step(step)
        for _ in range(round(20.0 / period)):
            story.run(period)
            accepted += [stops] * story.reset().ok
    assert accepted == [0]
    assert 'so none counts until there was none for 5000 ms' in story.reset().message
    story.run(4.9)
    assert 'resets have been called since before the stop' in story.why()
    story.run(0.2)
    assert 'resets have been called' not in story.why()
    assert story.reset().ok


def test_clear_since_is_the_first_tick_without_a_stop() -> None:
    story = play('1 s; always stop!; tick')
    assert story.arbiter.clear_since == -math.inf
    story.take_step('send')
    story.take_step('step')
    clear = story.now
    story.run(0.25)
    assert story.arbiter.clear_since == clear


def test_first_call_of_all_may_be_a_reset() -> None:
    assert not play('tick').reset().ok


def test_what_one_arbiter_alone_has_is_taken_over_by_none() -> None:
    one, other = play('in drive; tick'), play('in limits; tick')
    for each, before in ((one, other), (other, one)):
        each.arbiter.continue_from(before.arbiter, each.now)
    assert one.ready().decision.state is other.ready().decision.state is State.READY


def test_fields_say_whether_a_reset_counts() -> None:
    story, counted = play('with clear_time=0.25; tick'), []
    for stop, doing in 3 * tuple(itertools.product((True, False), ('rest', 'held', '', 'rest'))):
        story.estops['always'], story.samples['low'] = stop, SAMPLES.get(doing)
        story.run(0.3)  # clear_time is over, and a reset is not repeated
        status = story.arbiter.status(story.now)
        expected = status.stops_clear and status.operators_at_rest
        counted.append(status.state is State.STOPPED and expected)
        if status.state is State.STOPPED:
            assert story.reset().ok is counted[-1]
    assert set(counted) == {True, False}


@pytest.mark.parametrize(('later', 'length'), [(0.75 - 1 / 64, 0.75 - 1 / 64), (0.75, 0.0)])
def test_rest_is_broken_by_a_silence_of_neutral_time(later: float, length: float) -> None:
    rest = Run(0.5)
    for now in (0.0, 0.25, later):
        rest.extend(now)
    assert rest.length == length


@pytest.mark.parametrize(
    'say',
    [
        lambda story: story.arbiter.autonomy_command((0.0, 0.0), story.now),
        lambda story: story.arbiter.drive_enabled('', True, story.now),
        lambda story: story.arbiter.measured((0.0, 0.0), story.now),
    ],
)
def test_input_that_is_not_configured_has_no_message(say: Callable[[Story], None]) -> None:
    with pytest.raises(KeyError):
        say(play('with autonomy=null; tick'))
