// From a snapshot to the document.

import { brakes } from './brakes.js';
import { $, chip, each, make, mark, say } from './dom.js';
import { conditionTone, ESTOPS, linkOf, seconds, size, stateOf, time } from './words.js';

export function show(snapshot, download) {
  banners(snapshot);
  inhibits(snapshot);
  each($('remotes'), snapshot.bridges.filter((bridge) => bridge.remote), byName, bridgeCard, fillRemote);
  each($('muxes'), snapshot.muxes, byName, muxCard, fillMux);
  each($('actuators'), snapshot.bridges.filter((bridge) => bridge.actuates), byName, bridgeCard, fillActuator);
  each($('events'), snapshot.events, (event) => String(event.number), eventLine, fillEvent);
  $('memory-section').hidden = !snapshot.ledgers.length;
  each($('memory'), snapshot.ledgers, (ledger) => ledger.name, () => make('li', '', make('span', 'text'), make('span', 'warning')), fillLedger);
  brakes(snapshot.ledgers.flatMap((ledger) => ledger.stops));
  $('recordings-section').hidden = !snapshot.recordings.length;
  each($('recordings'), snapshot.recordings, byName, (item) => recordingLine(item, download), fillRecording);
  tell(snapshot);
}

const byName = (item) => item.name;

function banners(snapshot) {
  const items = snapshot.muxes.length
    ? snapshot.muxes
    : [{ name: '', state: 'silent', owner: 'none' }];
  each($('banners'), items, byName, (mux) => {
    const banner = make('div', 'banner');
    banner.append(make('span', 'sign'), make('strong', 'title'), make('span', 'text'), make('span', 'buttons'));
    banner.querySelector('.sign').setAttribute('aria-hidden', 'true');
    banner.querySelector('.buttons').dataset.mux = mux.name;
    return banner;
  }, (banner, mux) => {
    const state = stateOf(mux);
    const several = snapshot.muxes.length > 1 ? `${mux.name}: ` : '';
    mark(banner, 'tone', state.tone);
    say(banner.querySelector('.title'), several + state.title);
    say(banner.querySelector('.text'), state.text(mux));
  });
}

// The first reason of the last stop need not hold any more: it comes last.
const isPast = (item) => item.text.startsWith('stopped ');

function inhibits(snapshot) {
  const several = snapshot.muxes.length > 1;
  const items = snapshot.muxes.flatMap((mux) => [
    ...mux.inhibits.filter((item) => !isPast(item)).map((item) => ({ ...item, tone: 'inhibit' })),
    ...mux.warnings.map((item) => ({ ...item, tone: 'warning' })),
    ...mux.inhibits.filter(isPast).map((item) => ({ text: item.text, todo: '', tone: 'past' })),
    ...(mux.slowed ? [{ text: mux.slowed, todo: '', tone: 'warning' }] : []),
    ...(mux.last_reset ? [{ text: `last reset: ${mux.last_reset}`, todo: '', tone: 'warning' }] : []),
  ].map((item) => (several ? { ...item, text: `${mux.name}: ${item.text}` } : item)));
  if (!items.length) {
    const silent = !snapshot.muxes.length || snapshot.muxes.some((mux) => mux.state === 'silent');
    items.push(silent
      ? { text: 'The safety mux is not heard.', todo: 'Is it running, in this ROS domain? ros2 node list', tone: 'warning' }
      : { text: 'Nothing holds the machine back.', todo: '', tone: 'none' });
  }
  // Numbers change all the time; what stays the same is the same line.
  const seen = new Map();
  const key = (item) => {
    const name = item.text.replace(/[\d.]+/g, '#');
    seen.set(name, (seen.get(name) ?? 0) + 1);
    return `${name}|${seen.get(name)}`;
  };
  now(snapshot.muxes.flatMap((mux) => mux.now));
  each($('inhibits'), items, key, () => make('li', '', make('span', 'text'), make('span', 'todo')), (line, item) => {
    mark(line, 'tone', item.tone);
    say(line.querySelector('.text'), item.text);
    say(line.querySelector('.todo'), item.todo);
  });
}

// What to do at this moment, in few words; all the rest is behind it.
function now(items) {
  $('rest').hidden = !items.length;
  const place = items.length ? $('rest') : $('why');
  if ($('inhibits').parentElement !== place) place.append($('inhibits'));
  each($('now'), items, (item) => item.code + item.cause, () => make('li', '', make('strong', 'cause'), ' ', make('ol', 'steps')), (line, item) => {
    say(line.querySelector('.cause'), item.cause);
    each(line.querySelector('.steps'), item.steps, (step) => step, () => make('li'), say);
  });
}

function bridgeCard(bridge) {
  const card = make('article', 'card');
  card.setAttribute('role', 'listitem');
  const counters = make('details', 'counters', make('summary', '', 'Link counters'), make('table', '', make('tbody')));
  card.append(make('h3'), make('p', 'name', bridge.name), make('p', 'chips'), make('p', 'wire'), make('p', 'message'), make('p', 'link'), counters);
  for (const name of ['estop', 'linked']) {
    card.querySelector('.chips').append(make('span', name));
  }
  return card;
}

function fillBridge(card, bridge) {
  say(card.querySelector('h3'), bridge.title);
  mark(card, 'estop', bridge.estop);
  const [tone, words] = ESTOPS[bridge.estop];
  chip(card.querySelector('.estop'), tone, `e-stop ${words}`);
  chip(card.querySelector('.linked'), ...linkOf(bridge));
  say(card.querySelector('.message'), bridge.device.level ? bridge.device.message : '');
  const link = bridge.link.level && bridge.link.message !== bridge.device.message;
  say(card.querySelector('.link'), link ? bridge.link.message : '');
  const details = card.querySelector('details');
  if (details.open) {
    each(details.querySelector('tbody'), bridge.link.values, ([name]) => name, ([name]) => {
      const head = make('th', '', name);
      head.scope = 'row';
      return make('tr', '', head, make('td'));
    }, (row, [, value]) => say(row.lastChild, value));
  }
}

function fillRemote(card, bridge) {
  fillBridge(card, bridge);
  const live = bridge.link_up && bridge.operators.length > 0;
  mark(card, 'wire', bridge.owner ? 'owner' : live ? 'live' : 'dead');
  const operator = bridge.operators.map((name) => `operator '${name}'`).join(', ');
  say(card.querySelector('.wire'), bridge.owner ? `● has control (${operator})` : operator || 'no operator of a mux');
}

function fillActuator(card, bridge) {
  fillBridge(card, bridge);
  mark(card, 'wire', bridge.wired ? (bridge.link_up ? 'live' : 'dead') : 'none');
  say(card.querySelector('.wire'), bridge.wired ? 'stops with the mux' : '▲ does not listen to the stop of a mux');
}

function muxCard(mux) {
  const card = make('article', 'card mux', make('h3', '', 'Safety mux'), make('p', 'name', mux.name));
  card.setAttribute('role', 'listitem');
  const body = make('tbody');
  card.append(make('p', 'state chip'), make('p', 'owner'), make('p', 'link ages'), make('table', 'sources', make('caption', 'unseen', 'What the mux hears'), body));
  return card;
}

function fillMux(card, mux) {
  const state = stateOf(mux);
  mark(card, 'state', mux.state);
  chip(card.querySelector('.state'), state.tone, state.title);
  say(card.querySelector('.owner'), `owner: ${mux.owner}`);
  say(card.querySelector('.ages'), mux.from_button && `from button to wire: at most ${seconds(mux.from_button)}`);
  each(card.querySelector('tbody'), mux.sources, (source) => source.label, (source) => {
    const head = make('th', '', source.label);
    head.scope = 'row';
    return make('tr', '', head, make('td'));
  }, (row, source) => {
    const age = source.proven_age && ` (up to ${seconds(source.proven_age)} old)`;
    chip(row.lastChild, conditionTone(source.condition), source.condition + age);
  });
}

function eventLine(event) {
  return make('li', '', make('time'), make('span', 'text'), make('span', 'reason'));
}

const EVENT_SIGNS = { stop: '■', good: '✓', note: '●' };

function fillEvent(line, event) {
  mark(line, 'kind', event.kind);
  say(line.querySelector('time'), time(event.at));
  say(line.querySelector('.text'), `${EVENT_SIGNS[event.kind]} ${event.text}`);
  say(line.querySelector('.reason'), event.reason);
}

function recordingLine(item, download) {
  const button = make('button', 'plain', item.name);
  button.type = 'button';
  button.addEventListener('click', () => download(item.name));
  return make('li', '', button, ' ', make('span', 'size'));
}

function fillRecording(line, item) {
  say(line.querySelector('.size'), size(item.size));
}

function fillLedger(line, ledger) {
  say(line.querySelector('.text'), `last seen to work: ${ledger.worked}`);
  say(line.querySelector('.warning'), ledger.warning);
}

// For those who cannot see it: the state and the stops, when they change.
function tell(snapshot) {
  const states = snapshot.muxes.map((mux) => `${stateOf(mux).title}. ${stateOf(mux).text(mux)}`);
  const stops = snapshot.bridges
    .filter((bridge) => bridge.estop !== 'clear')
    .map((bridge) => `${bridge.title}: e-stop ${ESTOPS[bridge.estop][1]}.`);
  say($('alert'), [...states, ...stops].join(' '));
  document.title = `${states[0]?.split('.')[0] ?? 'No mux'} · rugged_teleop`;
}
