// Alarms: the newest one not acknowledged in the banner, all of them with what to do, and the table of all codes.
import { $, element, post, text } from './api.js';

let top = null;
const KINDS = ['anomaly', 'job', 'condition', 'controller']; // the most specific last: its line says most
const over = (a) => !a.active && (a.kind === 'condition' || a.kind === 'controller');
const weight = (a) => (over(a) ? 1 : a.severity); // what is over is only a warning
const rank = (a) => (a.active ? 100 : 0) + 10 * weight(a) + KINDS.indexOf(a.kind);
const name = (a) => `${a.kind === 'controller' ? 'E' : a.kind === 'job' ? 'job ' : ''}${a.code}`;

export function showAlarms(list) {
  const open = list.filter((a) => !a.acknowledged);
  top = open.reduce((worst, a) => (!worst || rank(a) > rank(worst) ? a : worst), null);
  $('banner').hidden = !top;
  $('banner').classList.toggle('bad', Boolean(top && weight(top) >= 2));
  if (top) {
    text('banner-title', `${name(top)} ${top.title}`);
    text('banner-text', `${top.text || top.cause} → ${top.action}`);
  }
  $('alarm-count').hidden = !open.length;
  text('alarm-count', String(open.length));
  $('alarm-list').replaceChildren(...(list.length ? list.map(entry) : [element('p', 'No alarms since the panel started.', 'note')]));
}

function entry(a) {
  const box = element('div', '', `alarm s${a.severity}${a.acknowledged ? ' done' : ''}`);
  const times = a.count > 1 ? `, ${a.count} times` : '';
  const when = new Date(a.time * 1000).toLocaleTimeString();
  box.append(element('b', `${when}  ${name(a)}  ${a.title}${a.active ? ' (still on)' : ''}${times}`));
  if (!a.acknowledged) {
    const button = element('button', 'Acknowledge');
    button.addEventListener('click', () => post('acknowledge', { id: a.id }, { quiet: true }));
    box.append(button);
  }
  box.append(element('p', `${a.text ? `${a.text}. ` : ''}${a.cause}`), element('p', a.action, 'todo'));
  return box;
}

export function acknowledgeTop() { if (top) post('acknowledge', { id: top.id }, { quiet: true }); }

export function makeTable(tables) {
  const table = element('table');
  const row = (cells, tag) => { const r = element('tr'); r.append(...cells.map((c) => element(tag, c))); return r; };
  table.append(row(['code', 'what', 'cause', 'what to do'], 'th'));
  for (const [kind, codes] of Object.entries(tables)) {
    for (const [code, a] of Object.entries(codes)) table.append(row([`${kind} ${code}`, a.title, a.cause, a.action], 'td'));
  }
  $('alarm-table').replaceChildren(table);
}

export function bindAlarms(openPage) {
  $('banner-ack').addEventListener('click', acknowledgeTop);
  $('banner-more').addEventListener('click', () => openPage('alarms'));
  $('ack-all').addEventListener('click', () => post('acknowledge', { id: null }));
  $('show-table').addEventListener('click', () => { $('alarm-table').hidden = !$('alarm-table').hidden; });
}
