// The connection: the newest snapshot is shown, and what is old is never shown as if it were new.

import { askToken, tokenText } from './control.js';
import { $, chip, mark, say } from './dom.js';

const LATE = 1.0; // s without news, or behind: do not trust what is shown
const AGAIN = 1000; // ms between two tries
const DRIFT = 5e-5; // s a snapshot, by which two clocks may differ in speed
const WRONG_TOKEN = 4401;

let least = Infinity; // the smallest distance from the server's clock

export let newest = null;
export const seconds = () => performance.now() / 1000;

// `start` takes the first message, `take` each snapshot, `render` draws the newest.
export function live(start, take, render) {
  let dirty = false;
  const onMessage = (message) => {
    if (message.history) {
      least = seconds() - message.now;
      start(message);
      return;
    }
    newest = message;
    least = Math.min(least + DRIFT, seconds() - message.now);
    take(message);
    if (!dirty) {
      requestAnimationFrame(() => {
        dirty = false;
        watch();
        render();
      });
    }
    dirty = true;
  };
  const connect = () => {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const socket = new WebSocket(`${scheme}://${location.host}/live`);
    socket.onopen = () => socket.send(tokenText());
    socket.onmessage = (event) => onMessage(JSON.parse(event.data));
    socket.onclose = (event) => {
      if (event.code === WRONG_TOKEN) askToken(connect);
      else setTimeout(connect, AGAIN);
    };
  };
  setInterval(watch, 250);
  connect();
}

// Say how old it is what is shown. A page that hangs or lags looks like one that is lost.
function watch() {
  if (newest?.trial?.state === 'ended') return;
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
