// Jogging. A click is one step; a held key asks for short pieces one after the other, so that losing the page, the
// network or the finger leaves the machine standing after a quarter of a second.
import { element, post } from './api.js';

const HELD_MS = 350, AGAIN_MS = 150;
let step = 1;

export function makeSteps(box, steps) {
  box.replaceChildren(...steps.map((mm) => {
    const b = element('button', `${mm} mm`);
    b.setAttribute('role', 'radio');
    b.addEventListener('click', () => choose(mm));
    b.dataset.step = mm;
    return b;
  }));
  function choose(mm) {
    step = mm;
    for (const b of box.children) {
      b.classList.toggle('on', Number(b.dataset.step) === mm);
      b.setAttribute('aria-checked', Number(b.dataset.step) === mm);
    }
  }
  choose(step);
}

const move = (key, held) => post('jog', { axis: key[0], direction: key[1] === '+' ? 1 : -1, step, held }, { quiet: true, patience: 3000 });
const wire = (mm, held) => post('jog_wire', { mm: held ? Math.sign(mm) * 5 : mm }, { quiet: true, patience: 3000 });

const held = new Set(); // how to let go of what is held
export function letGo() { for (const end of held) end(); }

// Press: after HELD_MS it is held and repeats; released before, it is one click.
function hold(button, act) {
  let timer = 0, repeats = false, down = false;
  async function again() {
    repeats = true;
    const answer = await act(true);
    if (down && answer.ok && !button.disabled) timer = setTimeout(again, AGAIN_MS);
  }
  const end = (click) => {
    if (!down) return;
    down = false;
    clearTimeout(timer);
    held.delete(drop);
    if (click && !repeats && !button.disabled) act(false);
  };
  const drop = () => end(false);
  button.addEventListener('pointerdown', (e) => {
    if (e.button || button.disabled) return;
    button.setPointerCapture(e.pointerId);
    down = true; repeats = false;
    held.add(drop);
    timer = setTimeout(again, HELD_MS);
  });
  button.addEventListener('pointerup', () => end(true));
  for (const name of ['pointercancel', 'lostpointercapture', 'blur']) button.addEventListener(name, drop);
  button.addEventListener('contextmenu', (e) => e.preventDefault());
  button.addEventListener('keydown', (e) => {
    if ((e.key === 'Enter' || e.key === ' ') && !e.repeat) { e.preventDefault(); act(false); }
  });
}

export function bindJog() {
  document.querySelectorAll('[data-jog]').forEach((b) => hold(b, (held) => move(b.dataset.jog, held)));
  window.addEventListener('blur', letGo); window.addEventListener('pagehide', letGo);
  document.addEventListener('visibilitychange', () => { if (document.hidden) letGo(); });
  document.querySelectorAll('[data-wire]').forEach((b) => hold(b, (held) => wire(Number(b.dataset.wire), held)));
}

const ARROWS = { ArrowLeft: 'x-', ArrowRight: 'x+', ArrowUp: 'y+', ArrowDown: 'y-', PageUp: 'z+', PageDown: 'z-' };
// One step a key: { name: function }, see keys.js.
export const jogKeys = () => Object.fromEntries(Object.entries(ARROWS).map(([key, way]) => [key, () => press(way)]));
function press(way) {
  if (!document.querySelector(`[data-jog="${way}"]`).disabled) move(way, false);
}
