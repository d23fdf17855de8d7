// All cells at a glance and the queue of this one: asked for once a second, drawn anew where something has changed.
import { $, day, duration, element, get, post, stop, tableRow, text } from './api.js';
import { applyTheme } from './theme.js';

const WAITING = 'waiting', RELEASED = 'released', RUNNING = 'running';
const ranks = { view: 1, operate: 2, maintain: 3 };
let role = 0, drawn = '';

applyTheme();

function card(c, here) {
  const box = element('article', '', `card ${c.state}`), head = element('h2', c.name);
  head.append(element('span', c.state === 'silent' ? `silent for ${duration(c.age)}` : c.state));
  box.append(head);
  if (c.state === 'up') {
    const machine = c.connected ? `${c.machine}${c.armed ? ', ARMED' : ''}` : 'NOT CONNECTED';
    const layers = c.layers && c.progress < 1 ? ` ${c.layer}/${c.layers}, ${Math.round(100 * c.progress)} %, left ${duration(c.time_left)}` : '';
    if (c.severity >= 2 || !c.connected) box.classList.add('bad'); else if (c.severity || c.job_state === 'PAUSED') box.classList.add('warn');
    box.append(element('p', `${c.job_state || '–'}${layers}`, 'big'), element('p', c.job || 'no job'), element('p', `machine: ${machine}${c.simulated ? ' (simulated)' : ''}`));
    if (c.alarm) box.append(element('p', `! ${c.alarm}`));
  }
  const queue = Object.entries(c.queue).map(([state, n]) => `${n} ${state}`).join(', ');
  box.append(element('p', `queue: ${queue || 'empty'}${c.next ? `, next ${c.next}` : ''}`));
  if (c.state === 'up' && c.page && c.name !== here) {
    const link = element('a', 'Open');
    link.href = c.page;
    box.append(link);
  }
  return box;
}

async function steer(name, data) { await post(name, data); look(); }

function button(label, run, style = '') {
  const b = element('button', label, style);
  b.disabled = role < ranks.operate;
  b.addEventListener('click', run);
  return b;
}

function acts(item, place, count) {
  const cell = element('td', '', 'acts'), id = item.id;
  if (item.state === WAITING) {
    const release = () => confirm(`Does ${item.part} lie on the table, and is the cell clear?`) && steer('queue_release', { id });
    cell.append(button('Release', release, 'go'));
    if (place > 1) cell.append(button('Up', () => steer('queue_move', { id, place: place - 1 })));
    if (place < count) cell.append(button('Down', () => steer('queue_move', { id, place: place + 1 })));
  }
  if (item.state === RELEASED) cell.append(button('Hold', () => steer('queue_hold', { id }), 'hold'));
  if (item.state !== RUNNING) cell.append(button('Remove', () => confirm(`Take item ${id} out?`) && steer('queue_remove', { id })));
  return cell;
}

function rows(queue) {
  const waiting = queue.items.filter((i) => i.state === WAITING).map((i) => i.id), count = waiting.length;
  return queue.items.map((item) => {
    const open = [WAITING, RELEASED, RUNNING].includes(item.state);
    const state = element('td', item.state), by = item.released_by ? `${item.by}, released by ${item.released_by}` : item.by;
    state.append(element('span', item.note || item.job, 'note'));
    const cells = [item.id, `${item.part} ${item.material}`, state, by, acts(item, waiting.indexOf(item.id) + 1, count)];
    return tableRow(cells, 'td', open ? item.state : 'ended');
  });
}

async function look() {
  const found = await get('/api/cells');
  $('gone').hidden = Boolean(found);
  document.body.classList.toggle('lost', !found);
  if (!found) return;
  text('here', found.here); text('stop-name', found.here);
  text('count', `(${found.queue.count} open)`);
  $('cards').replaceChildren(...found.cells.map((c) => card(c, found.here)));
  const now = JSON.stringify(found.queue) + role;
  if (now !== drawn) { drawn = now; $('queue').replaceChildren(...rows(found.queue)); }
}

async function log() {
  const found = await get('/api/audit');
  if (!found) return;
  text('log-verdict', found.problems.length ? `BROKEN: ${found.problems[0]}` : `${found.entries} entries, unbroken`);
  $('log').replaceChildren(...found.newest.reverse().map((e) => {
    const values = Object.entries(e.data).map(([k, v]) => `${k}=${v}`).join(', ');
    return tableRow([day(e.utc), `${e.who} (${e.via})`, e.what, e.outcome, [values, e.note].filter(Boolean).join('; ')]);
  }));
}

async function me() {
  const who = await get('/api/me');
  if (!who) return;
  role = ranks[who.role];
  text('me', `${who.who}: ${who.role}`);
  $('log-box').hidden = role < ranks.maintain;
  if (role >= ranks.maintain) { await log(); setInterval(log, 10000); }
}

$('stop-form').addEventListener('submit', (e) => { e.preventDefault(); stop(); });
document.addEventListener('keydown', (e) => { if (e.key === 'Escape' && e.shiftKey) { e.preventDefault(); stop(); } });
$('notify-test').addEventListener('click', () => post('notify_test', {}, { patience: 60000 }));
look();
me().then(look);
setInterval(look, 1000);
