// What the page may do: nothing without the token and a confirmation.

import { $, each, make, mark, say } from './dom.js';
import { ACTIONS } from './words.js';

// The token comes behind the # of the address, which no server and no log ever sees.
let token = decodeURIComponent(location.hash.slice(1)) || sessionStorage.getItem('token') || '';
keep(token);

function keep(text) {
  token = text;
  sessionStorage.setItem('token', token);
  if (location.hash) history.replaceState(null, '', location.pathname);
}

export const tokenText = () => token;

export function askToken(then) {
  const form = $('token');
  form.hidden = false;
  $('token-text').focus();
  form.onsubmit = (event) => {
    event.preventDefault();
    keep($('token-text').value.trim());
    form.hidden = true;
    then();
  };
}

const headers = () => ({ Authorization: `Bearer ${token}`, 'Content-Type': 'application/json' });

export async function download(name) {
  const answer = await fetch(`recordings/${encodeURIComponent(name)}`, { headers: headers() });
  if (!answer.ok) return say($('alert'), await answer.text());
  const link = make('a');
  link.href = URL.createObjectURL(await answer.blob());
  link.download = name;
  link.click();
  return setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

function actionsFor(mux) {
  const names = mux.state === 'STOPPED' ? ['reset'] : [];
  if (mux.autonomy && mux.state === 'READY') names.push('select autonomy');
  if (mux.autonomy && mux.owner === 'autonomy') names.push('deselect autonomy');
  return [...names, 'trip'];
}

// Buttons in each banner, where the server allows control. `newest` returns the newest snapshot.
export function offer(snapshot, newest) {
  recall(snapshot);
  for (const place of document.querySelectorAll('.banner .buttons')) {
    const mux = snapshot.muxes.find(({ name }) => name === place.dataset.mux);
    each(place, mux ? actionsFor(mux) : [], (name) => name, (name) => {
      const button = make('button', name === 'trip' ? 'trip' : '', ACTIONS[name].title);
      button.type = 'button';
      button.addEventListener('click', () => confirm(name, place.dataset.mux, newest));
      return button;
    }, () => {});
  }
}

// Who reads a question does not see what happens meanwhile: a reset may be that of another stop.
function recall(snapshot) {
  const dialog = $('confirm');
  if (!dialog.open || dialog.dataset.action === 'trip' || dialog.dataset.event === lastOf(snapshot)) return;
  dialog.close();
  say($('answer'), 'not done: something has changed meanwhile; look again');
}

const lastOf = (snapshot) => String(snapshot.events[0]?.number);

function confirm(action, mux, newest) {
  const dialog = $('confirm');
  mark(dialog, 'action', action);
  mark(dialog, 'event', lastOf(newest()));
  say($('confirm-title'), `${ACTIONS[action].title}?`);
  say($('confirm-text'), ACTIONS[action].text);
  say($('confirm-yes'), ACTIONS[action].title);
  // Not by the event close: that of an earlier question may come late.
  dialog.firstElementChild.onsubmit = (event) => event.submitter.value === 'yes' && send(action, mux, newest().now);
  dialog.showModal();
  $('confirm-no').focus();
}

// Ask for something; return whether it was done, and the answer.
export async function post(path, wish) {
  try {
    const answer = await fetch(path, { method: 'POST', headers: headers(), body: JSON.stringify(wish) });
    if (answer.status === 401) askToken(() => {});
    return { ok: answer.ok, answer: answer.ok ? (await answer.json()).answer : await answer.text() };
  } catch {
    return { ok: false, answer: 'not done: the page is not reached' };
  }
}

async function send(action, mux, seen) {
  say($('answer'), (await post('control', { action, mux, seen, confirmed: true })).answer);
}
