// The guided trial: one step at a time. What decides is the engine; here it is shown and answered.

import { post } from './control.js';
import { $, chip, each, make, mark, say } from './dom.js';
import { live, newest } from './live.js';

// This tab, to others: one acts, the others watch.
const hand = sessionStorage.getItem('hand') ?? String(crypto.getRandomValues(new Uint32Array(1))[0]);
sessionStorage.setItem('hand', hand);

const WORDS = {
  run: 'Begin', done: 'Done', again: 'Repeat', on: 'Go on', answer: 'Answer', skip: 'Skip', leave: 'Leave',
};
const TONES = { passed: 'good', failed: 'stop', accepted: 'warn', skipped: 'warn', 'not run': 'idle' };
const STATES = {
  begin: () => 'Begin when you are ready.',
  look: (trial) => `Looking for: ${trial.expected}`,
  accept: () => 'Is this accepted? Write why. With nothing written, it is not.',
  failed: () => 'It failed. Repeat it, or go on.',
  prompt: () => 'Nothing is seen of this: say when it is done.',
  ended: (trial) => trial.text,
};

function render() {
  const { trial } = newest;
  const acts = ['', hand].includes(trial.hand);
  say($('place'), trial.place ? `Step ${trial.place} of ${trial.of}: ${trial.step}` : '');
  say($('title'), trial.state === 'ended' ? 'The end' : trial.title);
  $('moves').hidden = !trial.moves;
  const todo = trial.todo.map((text) => (trial.simulated ? `${text} (the simulation does it)` : text));
  each($('todo'), todo, (text) => text, (text) => make('li', '', text), () => {});
  say($('expected'), STATES[trial.state]?.(trial) ?? '');
  say($('seen'), trial.state === 'ended' ? '' : `Seen: ${trial.seen}`);
  each($('problems'), trial.problems ?? [], (text) => text, (text) => make('li', '', text), () => {});
  ask(trial, acts);
  each($('records'), [...trial.records].reverse(), (record) => record.name, recordLine, fillRecord);
  const last = trial.records.at(-1);
  say($('alert'), [last && `${last.result}: ${last.title}.`, trial.title, $('expected').textContent].join(' '));
  document.title = `${trial.step || 'Trial'} · rugged_teleop`;
}

// The form is new with each question, so that no text of an earlier one is sent.
function ask(trial, acts) {
  const writes = trial.kinds.includes('skip') || (trial.kinds.includes('answer') && !trial.choices.length);
  $('form').hidden = !acts || !trial.kinds.length;
  $('watching').hidden = acts || trial.state === 'ended';
  $('text').hidden = !writes;
  say($('question'), trial.question || (trial.kinds.includes('skip') ? 'Why it is skipped, if it is:' : ''));
  if ($('form').dataset.number !== String(trial.number)) $('text').value = '';
  mark($('form'), 'number', trial.number);
  const choices = trial.kinds.includes('answer') && trial.choices.length ? trial.choices : [];
  const kinds = choices.length ? trial.kinds.filter((kind) => kind !== 'answer') : trial.kinds;
  const buttons = [
    ...choices.map((text) => ({ kind: 'answer', text, label: text })),
    ...kinds.map((kind) => ({ kind, label: WORDS[kind] })),
  ];
  each($('buttons'), buttons, ({ kind, text }) => `${trial.number} ${kind} ${text ?? ''}`, (button) => {
    const element = make('button', ['skip', 'leave'].includes(button.kind) ? '' : 'main', button.label);
    // Enter in the text is the first button; none but the answer is meant by it.
    element.type = button.kind === 'answer' ? 'submit' : 'button';
    element.addEventListener('click', (event) => {
      event.preventDefault();
      send(trial.number, button.kind, button.text ?? $('text').value);
    });
    return element;
  }, () => {});
}

async function send(number, kind, text) {
  const { ok, answer } = await post('answer', { hand, number, kind, text, seen: newest.now });
  say($('answer'), ok ? '' : answer);
}

function recordLine() {
  return make('li', '', make('span', 'chip'), make('span', 'text'), make('span', 'reason'));
}

function fillRecord(line, record) {
  chip(line.querySelector('.chip'), TONES[record.result], record.result);
  say(line.querySelector('.text'), record.title);
  const text = record.result === 'passed' ? [] : [record.text];
  say(line.querySelector('.reason'), [...text, ...record.numbers].join('; '));
}

$('form').addEventListener('submit', (event) => event.preventDefault());
$('over').addEventListener('click', () => send(newest.trial.number, 'take over', ''));
live(() => {}, () => {}, render);
