// What each state means, for people.

export const STATES = {
  STOPPED: { tone: 'stop', title: 'Stopped', text: () => 'No motion is let through.' },
  READY: { tone: 'info', title: 'Ready', text: () => 'Nobody has control. No motion is let through.' },
  ACTIVE: { tone: 'good', title: 'Active', text: (mux) => `${mux.owner} has control. The machine may move.` },
  STOPPING: { tone: 'warn', title: 'Stopping', text: () => 'The machine slows down on a ramp.' },
  silent: { tone: 'idle', title: 'Not heard', text: () => 'The safety mux is silent. Take the machine for one that may move.' },
};

export const stateOf = (mux) => STATES[mux.state] ?? STATES.silent;

export const ESTOPS = {
  stop: ['stop', 'demands a stop'],
  clear: ['good', 'clear'],
  silent: ['idle', 'silent'],
};

export function linkOf(bridge) {
  if (bridge.link_up === null) return ['idle', 'link not heard'];
  return bridge.link_up ? ['good', 'link up'] : ['stop', 'link down'];
}

export function conditionTone(condition) {
  if (['stop', 'stale', 'old', 'silent', 'invalid'].includes(condition)) return 'stop';
  return ['in use', 'not enabled', 'moving'].includes(condition) ? 'info' : 'good';
}

export const ACTIONS = {
  reset: {
    title: 'Reset',
    text: 'Look at the machine. Is nobody in its danger zone? A reset moves nothing; after it, the deadman gives control.',
  },
  trip: { title: 'Trip', text: 'Stop the machine, and ask all devices to stop, until a reset.' },
  'select autonomy': {
    title: 'Give autonomy control',
    text: 'Look at the machine. Is nobody in its danger zone? Autonomy moves it from now on.',
  },
  'deselect autonomy': { title: 'Take control from autonomy', text: 'The machine slows down and stands.' },
};

export function size(bytes) {
  return bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

export function seconds(text) {
  return Number.isNaN(Number(text)) ? text : `${(1000 * text).toFixed(0)} ms`;
}

export function time(seconds) {
  return new Date(seconds * 1000).toLocaleTimeString([], { hour12: false, timeZoneName: 'short' });
}
