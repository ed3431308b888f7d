// Small helpers: nothing in the document is touched unless it changes.

export const $ = (id) => document.getElementById(id);

// An element of a tag, a class, and children that are elements or text.
export function make(tag, name = '', ...children) {
  const element = document.createElement(tag);
  if (name) element.className = name;
  element.append(...children);
  return element;
}

export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function mark(element, name, value) {
  const text = String(value);
  if (element.dataset[name] !== text) element.dataset[name] = text;
}

// Keep one child for each item, in their order. `create` makes a child, `update` fills it.
export function each(parent, items, key, create, update) {
  const known = new Map([...parent.children].map((child) => [child.dataset.key, child]));
  items.forEach((item, index) => {
    const name = key(item);
    let child = known.get(name);
    known.delete(name);
    if (!child) {
      child = create(item);
      child.dataset.key = name;
    }
    if (parent.children[index] !== child) parent.insertBefore(child, parent.children[index] ?? null);
    update(child, item);
  });
  for (const child of known.values()) child.remove();
}

// A word with a sign before it, so that colour never says anything alone.
const SIGNS = { good: '✓', stop: '■', warn: '▲', idle: '○', info: '●' };

export function chip(element, tone, text) {
  element.classList.add('chip');
  mark(element, 'tone', tone);
  say(element, `${SIGNS[tone]} ${text}`);
}
