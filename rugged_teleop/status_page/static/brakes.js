// How long each joint took to stand, stop by stop, beside what was commissioned at that speed.

import { $, each, make, mark, say } from './dom.js';

const WIDTH = 20; // units of a stop
const HEIGHT = 100;
const SVG = 'http://www.w3.org/2000/svg';

export function brakes(joints) {
  each($('stops'), joints, ({ joint }) => joint, ({ joint }) => {
    const plot = document.createElementNS(SVG, 'svg');
    plot.setAttribute('preserveAspectRatio', 'none');
    plot.setAttribute('role', 'img');
    plot.setAttribute('aria-label', `Stops of ${joint}; the newest stands below`);
    return make('figure', 'stops', make('figcaption', '', `Stops of ${joint}`), plot, make('p', 'legend'));
  }, (figure, { points }) => {
    const text = JSON.stringify(points);
    if (figure.dataset.points === text) return;
    mark(figure, 'points', text);
    draw(figure.querySelector('svg'), points);
    const [speed, time, commissioned] = points.at(-1);
    const took = time === null ? 'did not stand' : `${time.toFixed(2)} s`;
    const meant = commissioned === null ? '' : `, commissioned ${commissioned.toFixed(2)}`;
    say(figure.querySelector('.legend'), `${took} from ${speed.toFixed(1)} rad/s${meant}`);
  });
}

// A bar is the time of a stop; a line across it the commissioned one. Who did not stand has all of it.
function draw(plot, points) {
  const most = Math.max(0.01, ...points.flat().filter((_, index) => index % 3));
  plot.setAttribute('viewBox', `0 0 ${Math.max(10, points.length) * WIDTH} ${HEIGHT}`);
  plot.replaceChildren(...points.flatMap(([, time, commissioned], index) => {
    const high = ((time ?? most) / most) * HEIGHT;
    const bar = box(index * WIDTH + 3, HEIGHT - high, WIDTH - 6, high, time === null ? 'bar never' : 'bar');
    if (commissioned === null) return [bar];
    return [bar, box(index * WIDTH, HEIGHT - (commissioned / most) * HEIGHT - 1, WIDTH, 3, 'meant')];
  }));
}

function box(x, y, width, height, name) {
  const element = document.createElementNS(SVG, 'rect');
  for (const [key, value] of Object.entries({ x, y, width, height, class: name })) element.setAttribute(key, value);
  return element;
}
