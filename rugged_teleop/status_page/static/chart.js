// Strip charts of the last minute on plain canvas: one chart, several lines, what is missing is a gap.

import { $, each, make, say } from './dom.js';

const SPAN = 60; // s
const DASHES = [[], [7, 4], [2, 3], [10, 3, 2, 3]]; // so that colour is not all that tells lines apart
const HEIGHT = 120; // px

const colourOf = (index) => (index + Math.floor(index / 4)) % 4;

let samples = [];

export function restart(history) {
  samples = history;
}

export function add(now, sample) {
  if (samples.length && now <= samples.at(-1)[0]) return;
  samples.push([now, sample]);
  while (samples[0][0] < now - SPAN) samples.shift();
}

// What is drawn: of each remote its axes, of each joint what is commanded and what is measured.
function charts(snapshot) {
  const sticks = snapshot.bridges.filter((bridge) => bridge.remote && bridge.axes.length).map((bridge) => ({
    title: `Sticks of ${bridge.title}`,
    name: `axis|${bridge.name}`,
    least: 1,
    lines: bridge.axes.map((_, i) => ({ label: `axis ${i}`, key: `axis|${bridge.name}|${i}` })),
  }));
  const joints = snapshot.muxes.flatMap((mux) => mux.joints.map((joint) => ({
    title: `${joint}, rad/s`,
    name: `command|${joint}|${mux.name}`,
    least: 1,
    lines: [
      { label: 'commanded', key: `command|${joint}|${mux.name}` },
      ...snapshot.bridges.filter((bridge) => bridge.actuates && bridge.joints.includes(joint))
        .map((bridge) => ({ label: 'measured', key: `speed|${joint}|${bridge.name}` })),
    ],
  })));
  return [...joints, ...sticks];
}

export function draw(snapshot) {
  const style = getComputedStyle(document.documentElement);
  const colours = [1, 2, 3, 4].map((i) => style.getPropertyValue(`--line-${i}`).trim());
  const grid = style.getPropertyValue('--grid').trim();
  each($('charts'), charts(snapshot), (chart) => chart.name, () => {
    const canvas = make('canvas');
    canvas.setAttribute('role', 'img');
    return make('figure', '', make('figcaption'), canvas, make('p', 'legend'));
  }, (figure, chart) => {
    const canvas = figure.querySelector('canvas');
    say(figure.querySelector('figcaption'), chart.title);
    legend(figure.querySelector('.legend'), chart, snapshot);
    const label = `${chart.title}, last ${SPAN} seconds; the newest numbers stand below`;
    if (canvas.getAttribute('aria-label') !== label) canvas.setAttribute('aria-label', label);
    paint(canvas, chart, snapshot.now, colours, grid);
  });
}

function legend(element, chart, snapshot) {
  each(element, chart.lines, (line) => line.key, () => make('span', '', make('i'), make('span')), (item, line) => {
    const index = chart.lines.indexOf(line);
    item.firstChild.className = `key line-${colourOf(index) + 1} dash-${(index % 4) + 1}`;
    const value = snapshot.sample[line.key];
    say(item.lastChild, `${line.label} ${value === undefined ? 'silent' : value.toFixed(2)}`);
  });
}

function paint(canvas, chart, now, colours, grid) {
  const scale = window.devicePixelRatio || 1;
  const width = canvas.clientWidth;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== HEIGHT * scale) {
    canvas.width = Math.round(width * scale);
    canvas.height = HEIGHT * scale;
  }
  const pen = canvas.getContext('2d');
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, width, HEIGHT);
  const most = limit(chart);
  const x = (at) => width - ((now - at) / SPAN) * width;
  const y = (value) => HEIGHT / 2 - (value / most) * (HEIGHT / 2 - 6);
  pen.strokeStyle = grid;
  pen.lineWidth = 1;
  pen.setLineDash([]);
  pen.beginPath();
  for (let second = 0; second <= SPAN; second += 10) {
    pen.moveTo(x(now - second), 0);
    pen.lineTo(x(now - second), HEIGHT);
  }
  for (const level of [-most, 0, most]) {
    pen.moveTo(0, y(level));
    pen.lineTo(width, y(level));
  }
  pen.stroke();
  pen.fillStyle = getComputedStyle(canvas).color;
  pen.font = '11px system-ui, sans-serif';
  pen.fillText(`+${most}`, 4, 16);
  pen.fillText(`−${most}`, 4, HEIGHT - 9);
  chart.lines.forEach((line, index) => {
    pen.strokeStyle = colours[colourOf(index)];
    pen.lineWidth = 1.8;
    pen.setLineDash(DASHES[index % 4]);
    trace(pen, line.key, x, y);
  });
}

function trace(pen, key, x, y) {
  let drawing = false;
  pen.beginPath();
  for (const [at, sample] of samples) {
    const value = sample[key];
    if (value === undefined) {
      drawing = false;
    } else {
      pen[drawing ? 'lineTo' : 'moveTo'](x(at), y(value));
      drawing = true;
    }
  }
  pen.stroke();
}

// The next of 1, 2, 5, 10, 20 … that nothing goes beyond.
function limit(chart) {
  let most = chart.least;
  for (const { key } of chart.lines) {
    for (const [, sample] of samples) most = Math.max(most, Math.abs(sample[key] ?? 0));
  }
  const power = 10 ** Math.floor(Math.log10(most));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= most * 0.999);
}
