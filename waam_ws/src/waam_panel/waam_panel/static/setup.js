// Set up: choose or upload a part, load, preview.
import { $, bindUpload, fill, get, post, text } from './api.js';
import { keepForm } from './keep.js';
import { limit, readFields } from './numbers.js';

const WORDS = ['part', 'as_found', 'mode', 'material', 'loop_mode', 'finish', 'operator_name', 'wire_lot', 'gas', 'name'];
const NUMBERS = ['layers', 'tolerance_mm', 'layer_height_mm', 'bead_width_mm', 'passes', 'allowance_mm', 'wire_left_m'];
let simulated = false;

export async function choices() {
  const found = await get('/api/choices');
  if (!found) return null;
  simulated = found.simulated;
  const parts = found.parts.map((p) => [p.name, `${p.name} (${p.kb} kB)`]);
  fill($('f-part'), parts.length ? parts : [['', 'no part yet: upload one']]);
  const first = simulated ? ['', 'what lies there?'] : ['', 'by a scan'];
  fill($('f-as_found'), [first, ['(last scan)', 'last scan'], ...parts]);
  fill($('f-loop_mode'), found.loop_modes);
  fill($('f-material'), found.materials);
  for (const name of NUMBERS) limit($(`f-${name}`), found.limits[name]);
  keepForm($('setup-form'));
  return found;
}

// All fields, or null when a number was not understood.
function form() {
  const data = readFields('f-', NUMBERS);
  if (data) for (const name of WORDS) data[name] = $(`f-${name}`).value;
  return data;
}

async function load() {
  const data = form();
  if (!data) return;
  const answer = await post('load', data, { patience: 70000 });
  if (answer.ok) $('preview').focus();
}

async function preview() {
  const button = $('preview');
  button.disabled = true;
  text('preview-note', 'Planning …');
  const answer = await post('preview', {}, { quiet: true, patience: 130000 });
  button.disabled = false;
  text('preview-note', answer.ok ? 'Blue: path with the arc on, dashed: idle, green: start, red: end. Touch the picture to enlarge it.' : answer.message);
  $('preview-picture').hidden = $('preview-table').hidden = !answer.ok;
  if (!answer.ok) return;
  $('preview-picture').src = `/api/preview.png?${Date.now()}`;
  text('preview-table', answer.table);
}

export function bindSetup() {
  $('load').addEventListener('click', load);
  $('preview').addEventListener('click', preview);
  $('enqueue').addEventListener('click', () => { const data = form(); if (data) post('queue_add', { ...data, wire_left_m: null }); }); // what will be on it then is not known
  $('setup-form').addEventListener('submit', (e) => { e.preventDefault(); load(); });
  bindUpload('f-upload', 'parts', async (name) => { await choices(); $('f-part').value = name; $('f-part').dispatchEvent(new Event('input', { bubbles: true })); });
}
