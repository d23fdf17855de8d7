// Alarms: the newest one not acknowledged in the banner, all of them with what to do, and the table of all codes.
import { $, day, element, makeTable, post, tableRow, text } from './api.js';

let top = null;
const KEPT = 200; // as the panel keeps
const alarms = new Map();
const weight = (a) => (!a.active && a.history ? 1 : a.severity);
const name = (a) => (a.kind === 'controller' ? `E${a.code} ` : a.kind === 'job' ? `job ${a.code}: ` : '') + a.title;
const when = (a) => day(a.time);

export function clearAlarms() { alarms.clear(); draw(null); }

// changed: alarms that are new or not as they were; id: of the one for the banner, null = none.
export function showAlarms(changed, id) {
  for (const a of changed) alarms.set(a.id, a);
  if (changed.length || id !== (top && top.id)) draw(id);
}

function draw(id) {
  const list = [...alarms.values()].sort((a, b) => b.id - a.id);
  for (const a of list.splice(KEPT)) alarms.delete(a.id);
  top = alarms.get(id) || null;
  $('banner').hidden = !top;
  $('banner').classList.toggle('bad', Boolean(top && weight(top) >= 2));
  if (top) {
    text('banner-title', name(top));
    text('banner-when', when(top));
    text('banner-text', `${top.text || top.cause} → ${top.action}`);
  }
  const open = list.filter((a) => !a.acknowledged && !a.history);
  $('alarm-count').hidden = !open.length;
  text('alarm-count', String(open.length));
  $('alarm-list').replaceChildren(...(list.length ? list.map(entry) : [element('p', 'No alarms since the panel started.', 'note')]));
}

function entry(a) {
  const box = element('div', '', `alarm s${a.severity}${a.acknowledged ? ' done' : ''}`);
  const times = a.count > 1 ? `, ${a.count} times` : '';
  const state = a.active ? ' (still on)' : a.history ? ' (of a job before)' : '';
  box.append(element('b', `${when(a)}  ${name(a)}${state}${times}`));
  if (!a.acknowledged) {
    const button = element('button', 'Acknowledge');
    button.addEventListener('click', () => post('acknowledge', { id: a.id }, { quiet: true }));
    box.append(button);
  }
  box.append(element('p', `${a.text ? `${a.text}. ` : ''}${a.cause}`), element('p', a.action, 'todo'));
  return box;
}

export function acknowledgeTop() { if (top) post('acknowledge', { id: top.id }, { quiet: true }); }

export function showTable(tables) {
  const lines = Object.entries(tables).flatMap(([kind, codes]) => Object.entries(codes).map(([code, a]) => tableRow([`${kind} ${code}`, a.title, a.cause, a.action])));
  $('alarm-table').replaceChildren(makeTable(['code', 'what', 'cause', 'what to do'], lines));
}

export function bindAlarms(openPage) {
  $('banner-ack').addEventListener('click', acknowledgeTop);
  $('banner-more').addEventListener('click', () => openPage('alarms'));
  $('ack-all').addEventListener('click', () => post('acknowledge', { id: null }));
  $('show-table').addEventListener('click', () => { $('alarm-table').hidden = !$('alarm-table').hidden; });
}
