// Requests to the panel. Every command carries the anti-forgery value that stands in the page.
const csrf = document.querySelector('meta[name=csrf]').content;
export const $ = (id) => document.getElementById(id);

let hide = 0;
export function toast(text, bad = false) {
  const box = $('toast');
  box.textContent = text;
  box.className = bad ? 'on bad' : 'on';
  clearTimeout(hide);
  hide = setTimeout(() => { box.className = ''; }, bad ? 6000 : 2500);
}

async function send(path, options) {
  const stop = new AbortController();
  const timer = setTimeout(() => stop.abort(), options.patience || 20000);
  try {
    const answer = await fetch(path, { credentials: 'same-origin', ...options, signal: stop.signal });
    return await answer.json();
  } catch (e) {
    return { ok: false, message: e.name === 'AbortError' ? 'no answer' : 'the panel cannot be reached' };
  } finally { clearTimeout(timer); }
}

// A command; says what came of it unless `quiet`. Resolves to the answer, never rejects.
export async function post(name, data = {}, { quiet = false, patience = 20000 } = {}) {
  const answer = await send(`/api/${name}`, {
    method: 'POST', body: JSON.stringify(data), patience,
    headers: { 'Content-Type': 'application/json', 'X-Waam-Csrf': csrf },
  });
  if (!answer.ok) toast(answer.message, true);
  else if (!quiet) toast(answer.message);
  return answer;
}

// STOP goes two ways at once: to the panel, and past it to a process with a port of its own. One that stops is enough.
function postStop() {
  const port = Number(document.querySelector('meta[name=stop-port]')?.content);
  const ways = [send('/api/stop', { method: 'POST', patience: 8000, headers: { 'X-Waam-Csrf': csrf } })];
  if (port) ways.push(send(`//${location.hostname}:${port}/api/stop`, { method: 'POST', patience: 8000, credentials: 'include' }));
  const stopped = (way) => way.then((answer) => (answer.ok ? answer : Promise.reject(answer)));
  return Promise.any(ways.map(stopped)).catch((e) => e.errors[0]);
}
export async function stop() {
  const answer = await postStop();
  if (answer.ok) toast(answer.message);
  else toast(`STOP: ${answer.message}. Use the emergency stop button.`, true);
}

// A field that takes a file: sends it, says what came of it, and calls `done` with the name that it got.
export function bindUpload(id, path, done) {
  $(id).addEventListener('change', async (e) => {
    const file = e.target.files[0];
    if (!file) return;
    const answer = await send(`/api/${path}?name=${encodeURIComponent(file.name)}`, { method: 'POST', body: file, headers: { 'X-Waam-Csrf': csrf }, patience: 120000 });
    toast(answer.message, !answer.ok);
    e.target.value = '';
    if (answer.ok) done(answer.name);
  });
}

export async function get(path) {
  try {
    const answer = await fetch(path, { credentials: 'same-origin' });
    return answer.ok ? await answer.json() : null;
  } catch { return null; }
}

export const text = (id, value) => { const e = $(id); if (e.textContent !== value) e.textContent = value; };
export const fixed = (v, digits) => (v === null || v === undefined ? '–' : v.toFixed(digits));
export function element(tag, content = '', style = '') {
  const e = document.createElement(tag);
  e.textContent = content;
  if (style) e.className = style;
  return e;
}
// A row of cells; what is no element becomes the text of one.
export function tableRow(cells, tag = 'td', style = '') {
  const r = element('tr', '', style);
  r.append(...cells.map((c) => (c instanceof Node && ['TD', 'TH'].includes(c.tagName) ? c : element(tag, String(c)))));
  return r;
}
export function makeTable(heads, lines) {
  const table = element('table');
  table.append(tableRow(heads, 'th'), ...lines);
  return table;
}
export function reportLink(address) {
  const a = element('a', 'Report');
  a.href = address; a.target = '_blank'; a.rel = 'noopener';
  return a;
}
// Choices of a field: [value, label], or labels that are their own values; what was chosen stays where it can.
export function fill(select, choices, chosen = select.value) {
  select.replaceChildren(...choices.map((c) => { const [value, label] = Array.isArray(c) ? c : [c, c], o = element('option', label); o.value = value; return o; }));
  if ([...select.options].some((o) => o.value === chosen)) select.value = chosen;
}
// Rows of name, value and, where it is not that of the table, the section that the value comes from (see sources.js).
export function rows(table, triples) {
  table.replaceChildren(...triples.map(([a, b, from]) => {
    const r = element('tr');
    r.append(element('th', a), element('td', b));
    if (from) r.dataset.from = from;
    return r;
  }));
}
// Date and time of a UTC in s, in the time of this device: 2026-11-28 14:05:12.
export function day(utc) {
  const two = (n) => String(n).padStart(2, '0'), d = new Date(utc * 1000);
  return `${d.getFullYear()}-${two(d.getMonth() + 1)}-${two(d.getDate())} ${two(d.getHours())}:${two(d.getMinutes())}:${two(d.getSeconds())}`;
}
// Time that is left, s, as 12:34 or 1:02:34.
export function countdown(seconds) {
  const two = (n) => String(n).padStart(2, '0'), s = Math.max(0, Math.round(seconds)), h = Math.floor(s / 3600);
  return h ? `${h}:${two(Math.floor(s / 60) % 60)}:${two(s % 60)}` : `${Math.floor(s / 60)}:${two(s % 60)}`;
}
export function duration(seconds) {
  if (seconds === null || seconds === undefined) return '–';
  const m = Math.round(seconds / 60);
  return m < 60 ? `${m} min` : `${Math.floor(m / 60)} h ${String(m % 60).padStart(2, '0')} min`;
}
