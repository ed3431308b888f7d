// The connection: the newest snapshot is shown, and what is old is never shown as if it were new.

import { add, draw, restart } from './chart.js';
import { askToken, download, offer, tokenText } from './control.js';
import { $, chip, mark, say } from './dom.js';
import { show } from './view.js';

const LATE = 1.0; // s without news, or behind: do not trust what is shown
const AGAIN = 1000; // ms between two tries
const DRIFT = 5e-5; // s a snapshot, by which two clocks may differ in speed
const WRONG_TOKEN = 4401;
const calm = matchMedia('(prefers-reduced-motion: reduce)');

let newest = null;
let control = false;
let cameAt = 0; // s, of the newest snapshot, by this computer's steady clock
let least = Infinity; // its smallest distance from the server's clock
let drawnAt = 0;
let dirty = false;

const seconds = () => performance.now() / 1000;

function connect() {
  const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
  const socket = new WebSocket(`${scheme}://${location.host}/live`);
  socket.onopen = () => socket.send(tokenText());
  socket.onmessage = (event) => take(JSON.parse(event.data));
  socket.onclose = (event) => {
    if (event.code === WRONG_TOKEN) askToken(connect);
    else setTimeout(connect, AGAIN);
  };
}

function take(message) {
  if (message.history) {
    restart(message.history);
    control = message.control;
    least = Infinity;
    return;
  }
  newest = message;
  cameAt = seconds();
  least = Math.min(least + DRIFT, cameAt - message.now);
  add(message.now, message.sample);
  if (!dirty) requestAnimationFrame(render);
  dirty = true;
}

function render() {
  dirty = false;
  watch();
  show(newest, download);
  if (control) offer(newest, () => newest);
  if (seconds() - drawnAt >= (calm.matches ? 1 : 0.09)) {
    drawnAt = seconds();
    draw(newest);
  }
}

// Say how old it is what is shown. A page that hangs or lags looks like one that is lost.
function watch() {
  const age = newest ? seconds() - newest.now - least : 0;
  const lost = newest === null || age > LATE;
  const isShown = newest !== null && !lost;
  mark(document.body, 'lost', newest !== null && lost);
  $('lost').hidden = newest === null || !lost;
  $('banners').hidden = !isShown;
  const connection = $('connection');
  if (!lost) chip(connection, 'good', 'live');
  else if (newest) chip(connection, 'stop', 'connection lost');
  else chip(connection, 'idle', 'not connected');
  if (lost && newest) {
    document.title = 'Connection lost · rugged_teleop';
    say($('lost-text'), `What stands below is ${Math.round(age)} s old. Take the machine for one that may move.`);
    say($('alert'), 'Connection lost. Take the machine for one that may move.');
  }
}

setInterval(watch, 250);
connect();
