// What can be believed. Every value on the page lies in an element with data-from: the sections of the stream that it
// comes from (sources.py says which node and topic that is; 'panel' is the panel itself). Old is shown as old.
let stale = {}, ages = {};

export function hear(frame) { stale = frame.stale; ages = frame.ages; }

// Why a section cannot be believed, '' = it can.
export const why = (section) => stale[section] || stale.panel || '';
// A section, or undefined while it cannot be believed.
export const known = (sections, name) => (why(name) ? undefined : sections[name]);

export function ago(section) {
  const s = ages[section];
  return s === undefined ? '' : s < 120 ? `${Math.round(s)} s` : s < 7200 ? `${Math.round(s / 60)} min` : `${Math.round(s / 3600)} h`;
}

export function mark() {
  for (const e of document.querySelectorAll('[data-from]')) {
    const names = e.dataset.from.split(' '), reason = names.map(why).find(Boolean) || '';
    e.classList.toggle('stale', Boolean(reason));
    if (reason) { e.title = reason; e.dataset.age = `old ${ago(names.find(why))}`; } else if (e.dataset.age) { e.title = ''; e.dataset.age = ''; }
  }
}
