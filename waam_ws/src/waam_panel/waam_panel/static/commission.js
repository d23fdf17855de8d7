// The page Commissioning: steps and what they found, what is asked now, and answers. What is asked is waam commission.
import { $, bindUpload, day, element, fill, get, makeTable, post, tableRow, text } from './api.js';

const MARKS = { passed: '✓', failed: '✗', 'out of date': '!', 'not there': '–', 'by hand': '–', 'not done': '○' };
const CALM_MS = 700; // a second click on what was asked before answers nothing
const CLASSES = { passed: 'good', failed: 'bad', 'out of date': 'old' };
const wanted = new Map(); // steps that somebody has opened or closed by hand
let book = null, why = '', run = null, version = -1, number = -1, opened = '';

// ---- the book

export async function readCommission() {
  const found = await get('/api/commission');
  if (found) { book = found.ok ? found : book; why = found.ok ? '' : found.message; }
  showBook();
}

// from the stream, with every frame; active: the page is open
export function showCommission(said, active) {
  run = said || null;
  if (!run || !active) return;
  if (run.version !== version) { version = run.version; readCommission(); }
  const key = JSON.stringify([run.running, run.at, run.ended]);
  if (key !== opened) { opened = key; showBook(); }
  showAsked(); showLines();
}

const stepOf = (name) => (book ? book.steps.find((s) => s.name === name) : undefined);

function showBook() {
  const at = run && run.running ? run.at : '', going = Boolean(run && run.running);
  $('c-end').hidden = !going;
  $('c-start').hidden = going;
  $('c-start').disabled = !book || !book.at;
  if (!book) { text('c-head', why || 'Looking …'); return; }
  const absent = book.steps.filter((s) => s.state === 'not there').map((s) => s.name);
  text('c-head', why || `${book.cell}: ${book.passed} of ${book.of} steps passed${absent.length ? `, not there: ${absent.join(', ')}` : ''}`);
  text('c-start', book.at ? (book.passed ? `Go on with ${book.at}` : `Start with ${book.at}`) : 'No step is due');
  const part = stepOf('part');
  $('c-report').hidden = !(part && part.report);
  if (part && part.report) $('c-report').href = part.report;
  for (const id of ['c-page', 'c-file']) $(id).hidden = false;
  $('c-steps').replaceChildren(...book.steps.map((s) => stepItem(s, at, wanted.get(s.name) ?? (s.name === at || (!going && s.state === 'failed')))));
  // where the list has a bar of its own; else the question would leave the screen
  if (window.matchMedia('(min-width:901px)').matches) document.querySelector('#c-steps details[data-at]')?.scrollIntoView({ block: 'nearest' });
}

function stepItem(s, at, open) {
  const item = element('li'), box = element('details'), head = element('summary');
  box.open = open;
  if (s.name === (at || book.at)) box.dataset.at = '';
  head.addEventListener('click', () => wanted.set(s.name, !box.open));
  const state = s.name === at ? 'now' : s.state, when = s.date && s.name !== at ? ` ${day(Date.parse(s.date) / 1000).slice(0, 16)}` : '';
  head.append(element('b', `${s.name === at ? '▶' : MARKS[s.state]} ${s.name}`), element('span', `${state}${when}`, s.name === at ? 'now' : CLASSES[s.state] || ''), element('small', s.title));
  box.append(head, ...aboutStep(s), ...foundBy(s));
  item.append(box);
  return item;
}

// what it takes, and the button that runs it
function aboutStep(s) {
  if (!s.built) return [element('p', 'Done by hand and never counted as passed: docs/real_cell.md.', 'note')];
  const moves = s.moves ? (s.powered ? 'Axes or wire move, and a current flows.' : 'Axes or wire move.') : s.powered ? 'Nothing moves; a current flows.' : 'Nothing moves, no current flows.';
  const lines = [moves, s.needs ? `At hand: ${s.needs}.` : '', s.after.length ? `Stands on: ${s.after.join(', ')}.` : ''].filter(Boolean);
  const parts = [element('p', lines.join(' '), 'note')];
  if (s.closed.length) return [...parts, element('p', `Not yet: ${s.closed.join(', ')}.`, 'note')];
  if (!run || run.running) return parts;
  const again = element('button', s.state === 'not done' ? `Run only ${s.name}` : `Run ${s.name} once more`);
  again.addEventListener('click', () => start(s.name));
  return [...parts, again];
}

function foundBy(s) {
  if (!s.date) return [];
  const parts = [element('p', s.text, s.state === 'failed' ? 'stopped' : '')];
  if (s.mend) parts.push(element('p', `What can be done: ${s.mend}. Then go on.`, 'todo'));
  if (s.old) parts.push(element('p', `Out of date: ${s.old}.`, 'note'));
  if (s.checks.length) parts.push(makeTable(['found', 'value', 'limits', ''], s.checks.map(([name, value, limits, good]) => tableRow([name, value, limits, good ? '✓' : '✗ beyond'], 'td', good ? '' : 'bad'))));
  const said = Object.entries(s.answers).map(([id, answer]) => `${id.split('.')[1]}: ${answer.split('/').pop()}`).join('; ');
  if (said) parts.push(element('p', `The operator said: ${said}`, 'note'));
  for (const name of s.pictures) parts.push(picture(name, s));
  if (s.report) { const a = element('a', 'Report of its job'); a.href = s.report; a.target = '_blank'; a.rel = 'noopener'; parts.push(a); }
  return parts;
}

function picture(name, s) {
  const image = element('img');
  image.src = `/commission/${encodeURIComponent(name)}?${encodeURIComponent(s.date)}`; image.alt = `evidence of ${s.name}: ${s.text}`; image.loading = 'lazy';
  return image;
}

// ---- what is asked now

function showAsked() {
  const asked = run.asked, now = asked ? asked.number : run.running ? 0 : -2;
  if (now === number) return;
  number = now;
  $('c-asked').hidden = !asked;
  text('c-doing', asked ? '' : run.running ? 'The cell is at work. Wait.' : '');
  if (!asked) return;
  $('c-asked').dataset.number = asked.number; $('c-asked').dataset.id = asked.ask || asked.do;
  const step = stepOf((asked.ask || asked.do).split('.')[0]);
  text('c-step', step ? `${step.name}: ${step.title}` : '');
  text('c-text', asked.text); text('c-wrong', asked.wrong ? `That was no answer: ${asked.wrong}.` : '');
  text('c-how', asked.do && !asked.wait ? `Goes on when the cell sees it; waits ${Math.round(asked.seconds / 60)} minutes.` : asked.file ? 'A part of this list, or upload its mesh (STL, PLY; mm).' : '');
  $('c-file-field').hidden = !asked.file;
  if (asked.file) parts();
  $('c-answers').replaceChildren(...controls(asked));
  alive(false); setTimeout(() => { if (number === asked.number) alive(true); }, CALM_MS);
  $('c-asked').scrollIntoView({ block: 'nearest' });
}

async function parts(chosen) {
  const found = await get('/api/choices');
  if (found) fill($('c-part'), [['', 'choose'], ...found.parts.map((p) => [p.name, p.name])], chosen);
}

function controls(asked) {
  if (asked.do) return asked.wait ? [button('Done', () => '', 'go')] : [];
  const words = asked.words.map((w) => button(w, () => w, w === 'yes' ? 'go' : ''));
  if (asked.file) return [button('Begin with this part', () => $('c-part').value || null, 'go'), ...words];
  if (words.length) return words;
  const fields = Array.from({ length: asked.count }, (_, i) => numberField(asked, i));
  const read = () => { const given = fields.map((f) => f.querySelector('input').value.trim()); return given.every(Boolean) ? given : null; };
  return [...fields, button('Enter', read, 'go')];
}

function numberField(asked, i) {
  const label = element('label', `${asked.count > 1 ? `${i + 1}.: ` : ''}${asked.unit}${asked.low === null ? '' : `, ${asked.low} to ${asked.high}`}`), input = element('input');
  input.inputMode = 'decimal'; input.id = `c-number-${i}`; input.autocomplete = 'off';
  label.append(input);
  return label;
}

function button(label, read, style) {
  const b = element('button', label[0].toUpperCase() + label.slice(1), `big ${style}`), mine = run.asked.number;
  b.type = style === 'go' ? 'submit' : 'button';
  const send = async () => {
    const answer = read();
    if (answer === null) { text('c-wrong', 'Something is missing.'); return; }
    alive(false);
    const told = await post('commission/answer', { number: mine, answer }, { quiet: true });
    if (!told.ok) { text('c-wrong', told.message); alive(true); }
  };
  b.addEventListener('click', (e) => { e.preventDefault(); send(); });
  return b;
}

const alive = (yes) => document.querySelectorAll('#c-answers button').forEach((b) => { b.disabled = !yes; });

function showLines() {
  const lines = run.lines;
  text('c-lines', lines.join('\n'));
  $('c-lines').hidden = !lines.length;
  const failed = run.ended && stepOf(run.at), bad = Boolean(run.ended && run.ended !== 'done');
  $('c-ended').hidden = !run.ended;
  $('c-ended').classList.toggle('bad', bad);
  text('c-ended', !run.ended ? '' : failed && failed.state === 'failed' && run.ended.startsWith('to mend') ? `Stopped at ${failed.name}: ${failed.text}. What can be done: ${failed.mend}. Then go on.`
    : bad ? `Stopped: ${run.ended}` : 'Done.');
}

// ---- commands

const start = (step) => post('commission/start', step ? { step } : {}, { quiet: true });

export function bindCommission() {
  $('c-start').addEventListener('click', () => start(''));
  $('c-end').addEventListener('click', () => post('commission/end'));
  bindUpload('c-upload', 'parts', (name) => parts(name));
}
