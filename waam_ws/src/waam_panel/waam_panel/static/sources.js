// What can be believed. Every value on the page lies in an element with data-from: the sections of the stream that it
// comes from (sources.py says which node and topic that is; 'panel' is the panel itself). Old is shown as old; what
// never came is a dash anyway.
let stale = {}, ages = {};

export function hear(frame) { stale = frame.stale; ages = frame.ages; }

// Why a section cannot be believed, '' = it can.
export const why = (section) => stale[section] || stale.panel || '';
// A section, or undefined while it cannot be believed.
export const known = (sections, name) => (why(name) ? undefined : sections[name]);

// s since the newest message of a section, 0 = not known.
export const ageOf = (section) => ages[section] ?? 0;

export function ago(section) {
  const s = ages[section];
  return s === undefined ? '' : s < 120 ? `${Math.round(s)} s` : s < 7200 ? `${Math.round(s / 60)} min` : `${Math.round(s / 3600)} h`;
}

export function mark() {
  for (const e of document.querySelectorAll('[data-from]')) {
    const from = e.dataset.from.split(' ').find((name) => why(name) && (ago(name) || ago('panel')));
    e.classList.toggle('stale', Boolean(from));
    if (from) { e.title = why(from); e.dataset.age = `old ${ago(from) || ago('panel')}`; } else if (e.dataset.age) { e.title = ''; e.dataset.age = ''; }
  }
}
