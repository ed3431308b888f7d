// The status page: what is heard of the machine.

import { add, draw, restart } from './chart.js';
import { download, offer } from './control.js';
import { live, newest, seconds } from './live.js';
import { show } from './view.js';

const calm = matchMedia('(prefers-reduced-motion: reduce)');

let control = false;
let drawnAt = 0;

function start(message) {
  restart(message.history);
  control = message.control;
}

function render() {
  show(newest, download);
  if (control) offer(newest, () => newest);
  if (seconds() - drawnAt >= (calm.matches ? 1 : 0.09)) {
    drawnAt = seconds();
    draw(newest);
  }
}

live(start, (message) => add(message.now, message.sample), render);
