// G-code: choose or upload a program, its checks, its layers from above, load, start.
import { $, bindUpload, duration, element, fill, get, makeTable, post, tableRow, text } from './api.js';
import { keepForm } from './keep.js';
import { limit, readFields } from './numbers.js';
import { colour, prepare } from './plots.js';

const AXES = ['x', 'y', 'z'];
const MARKS = { good: '✓', warning: '!', bad: '✗', open: '–' };
let found = null, beads = [], asked = 0;

export async function programs() {
  const list = await get('/api/programs');
  if (!list) return;
  const named = (files) => files.map((f) => [f.name, `${f.name} (${f.kb} kB)`]);
  fill($('g-program'), list.programs.length ? named(list.programs) : [['', 'no program yet: upload one']]);
  fill($('g-nominal'), [['', 'none: monitor'], ...named(list.parts)]);
  fill($('g-dialect'), list.dialects);
  fill($('g-material'), list.materials);
  for (const axis of AXES) limit($(`g-${axis}`), [-list.shift_mm, list.shift_mm]);
  const first = !$('g-loop_mode').value;
  fill($('g-loop_mode'), list.loop_modes);
  if (first) $('g-loop_mode').value = 'monitor';
  keepForm($('gcode-form'));
}

// All fields, or null when a number was not understood.
function choice() {
  const shift = readFields('g-', AXES);
  if (!shift) return null;
  const data = { shift_mm: AXES.map((a) => shift[a]) };
  for (const name of ['program', 'dialect', 'nominal', 'material', 'loop_mode', 'operator_name']) data[name] = $(`g-${name}`).value;
  return data;
}

async function look() {
  const data = choice();
  if (!data) return;
  const mine = ++asked;
  text('g-note', 'Looking …');
  $('g-look').disabled = true;
  const answer = await post('program', data, { quiet: true, patience: 130000 });
  $('g-look').disabled = false;
  if (mine !== asked) return;
  found = answer.ok ? answer : null;
  beads = [];
  showChecks(answer);
  const slider = $('g-layer'), count = found ? found.layers.length : 0;
  slider.disabled = !count; slider.max = Math.max(1, count); slider.value = 1;
  await showLayer();
}

function showChecks(answer) {
  const checks = answer.ok ? answer.checks : [];
  $('g-checks').replaceChildren(...checks.map((c) => tableRow([`${MARKS[c.level]} ${c.name}`, c.line ? `line ${c.line}` : '', c.text], 'td', c.level)));
  if (!answer.ok) { text('g-note', answer.message); return; }
  const t = answer.totals, said = answer.good ? 'Nothing stands against a start.' : 'It cannot be started: see below.';
  const more = t.arc_time_s === undefined ? '' : ` ${t.arc_time_s < 120 ? `${Math.round(t.arc_time_s)} s` : duration(t.arc_time_s)} of arc, ${t.wire_m} m of wire.`;
  text('g-note', `${said}${t.layers ? ` ${t.layers} layers, ${t.beads} beads.` : ''}${more}`);
}

async function showLayer() {
  const number = Number($('g-layer').value), mine = asked;
  text('g-layer-number', found && found.layers.length ? `${number} of ${found.layers.length}` : '–');
  if (found && found.layers.length) {
    const answer = await post('program/layer', { ...choice(), layer: number }, { quiet: true, patience: 130000 });
    if (mine !== asked || number !== Number($('g-layer').value)) return;
    beads = answer.ok ? answer.beads : [];
    const l = found.layers[number - 1];
    text('g-layer-note', answer.ok ? `z ${l.z_mm} mm, ${l.beads} beads, ${l.length_mm} mm with the arc on, from line ${l.line}` : answer.message);
  } else { beads = []; text('g-layer-note', ''); }
  const lines = beads.slice(0, 200).map((b, i) => tableRow([i + 1, `${b.line} – ${b.last_line}`, b.length_mm, b.speed_mm_s]));
  $('g-beads').replaceChildren(...(beads.length ? [makeTable(['bead', 'lines', 'mm', 'mm/s'], lines)] : []));
  drawProgram();
}

function stroke(g, path, at) {
  g.beginPath();
  path.forEach((p, i) => (i ? g.lineTo(...at(p)) : g.moveTo(...at(p))));
  g.stroke();
}

export function drawProgram() {
  const { g, w, h } = prepare($('g-picture'));
  if (!found || found.box.length !== 4 || w < 60) return;
  const [x0, y0, x1, y1] = found.box, edge = 24;
  const scale = Math.min((w - 2 * edge) / Math.max(1, x1 - x0), (h - 2 * edge) / Math.max(1, y1 - y0));
  const at = ([x, y]) => [w / 2 + (x - (x0 + x1) / 2) * scale, h / 2 - (y - (y0 + y1) / 2) * scale];
  g.strokeStyle = colour('--soft'); g.lineWidth = 1; g.setLineDash([4, 4]);
  for (const b of beads) stroke(g, b.way, at);
  g.strokeStyle = colour('--plan'); g.lineWidth = 2; g.setLineDash([]);
  for (const b of beads) stroke(g, b.path, at);
  for (const b of beads) {
    g.fillStyle = colour('--go'); g.beginPath(); g.arc(...at(b.path[0]), 4, 0, 7); g.fill();
    const [x, y] = at(b.path[b.path.length - 1]); // square: colour alone carries no meaning
    g.fillStyle = colour('--bad'); g.fillRect(x - 3, y - 3, 6, 6);
  }
}

async function send(name, patience) {
  const data = choice();
  if (data) text('g-note', (await post(name, data, { patience })).message);
}

export function bindPrograms() {
  window.addEventListener('resize', drawProgram);
  $('g-look').addEventListener('click', look);
  $('g-layer').addEventListener('input', showLayer);
  $('g-nominal').addEventListener('change', (e) => { $('g-loop_mode').value = e.target.value ? 'closed_loop' : 'monitor'; });
  $('gcode-form').addEventListener('submit', (e) => { e.preventDefault(); look(); });
  $('g-load').addEventListener('click', () => send('program/load', 190000));
  $('g-start').addEventListener('click', async () => text('g-note', (await post('program/start', {}, { patience: 130000 })).message));
  $('g-enqueue').addEventListener('click', () => send('queue_add', 20000));
  bindUpload('g-upload', 'programs', async (name) => { await programs(); $('g-program').value = name; $('g-program').dispatchEvent(new Event('input', { bubbles: true })); look(); });
}
