// Keys of the page. A letter is the one that is printed where the layout has Latin letters, else the one at its place
// (Ukrainian: the key of A arms). What is typed into a field stays there; only Shift+Esc, STOP, works everywhere.
const FIELDS = 'input, select, textarea, [contenteditable]:not([contenteditable="false"])';

// 'a', '1', 'Escape', 'ArrowLeft' ...: what a key means, whatever layout and Caps Lock say.
export function meaning(event) {
  if (/^[a-z]$/i.test(event.key)) return event.key.toLowerCase();
  const place = /^(?:Key([A-Z])|(?:Digit|Numpad)([0-9]))$/.exec(event.code);
  if (place && event.key.length === 1) return place[2] || place[1].toLowerCase();
  return event.key;
}

const leaves = (event) => { event.preventDefault(); event.target.blur(); };

// acts: { name: function } where name is a meaning, with 'shift+' before it. Nothing happens twice for a held key.
export function bindKeys(acts, stop) {
  document.addEventListener('keydown', (event) => {
    const name = meaning(event), again = event.repeat;
    if (event.isComposing || event.keyCode === 229 || event.ctrlKey || event.altKey || event.metaKey || event.getModifierState('AltGraph')) return;
    if (name === 'Escape' && event.shiftKey) { event.preventDefault(); if (!again) stop(); return; }
    if (event.target.closest && event.target.closest(FIELDS)) { if (name === 'Escape') leaves(event); return; }
    if (event.defaultPrevented || document.querySelector('dialog[open], [aria-modal="true"]')) return;
    if (again && event.target.closest && event.target.closest('button') && (name === 'Enter' || name === ' ')) { event.preventDefault(); return; }
    const act = acts[`${event.shiftKey ? 'shift+' : ''}${name}`];
    if (!act) return;
    if (name.length > 1) event.preventDefault(); // no scrolling, no leaving of full screen
    if (!again) act();
  });
}
