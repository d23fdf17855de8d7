// The page Standoff: set, measured and correction as they are, and what the next jobs are held by.
import { $, fill, fixed, get, post, rows, text } from './api.js';
import { limit, readFields } from './numbers.js';
import { draw } from './plots.js';

const NAMES = ['source', 'law', 'set_mm', 'up_mm', 'down_mm', 'wander_mm'];
const KEEP = 3000;
const DISTANCE = { name: 'distance', unit: 'mm', columns: [1, 2], span: 1 };
const CORRECTION = { name: 'correction of Z', unit: 'mm', columns: [3], span: 1 };
const samples = [];
const signed = (v) => (v === null ? '–' : `${v < 0 ? '−' : '+'}${fixed(Math.abs(v), 2)}`);

export function bindStandoff() {
  $('s-apply').addEventListener('click', apply);
  $('standoff-form').addEventListener('submit', (e) => { e.preventDefault(); apply(); });
  // the distance of one source means nothing to another one
  $('s-source').addEventListener('change', () => { $('s-set_mm').value = ''; ofTheArc(); });
}

export async function readStandoff() {
  const found = await get('/api/standoff');
  if (!found) return;
  fill($('s-source'), found.sources); fill($('s-law'), found.laws);
  for (const [name, limits] of Object.entries(found.limits_mm)) limit($(`s-${name}`), limits);
  if (found.ok) for (const name of NAMES) $(`s-${name}`).value = found[name] ?? '';
  ofTheArc();
  text('standoff-note', found.ok ? 'Set between jobs; it holds until the bridge is started again.' : found.message);
}

// what only the arc has is shown with the arc
function ofTheArc() {
  for (const e of document.querySelectorAll('#standoff .of-the-arc')) e.hidden = $('s-source').value !== 'arc';
}

async function apply() {
  const mm = readFields('s-', ['set_mm', 'up_mm', 'down_mm', 'wander_mm']);
  if (!mm) return;
  const answer = await post('standoff', { source: $('s-source').value, law: $('s-law').value, ...mm });
  if (answer.ok) readStandoff();
}

// old, machineOld: why they cannot be believed; running: null = not known
export function showStandoff(s, telemetry, old, machineOld, running) {
  $('s-apply').disabled = running !== false;
  $('standoff-value').hidden = !s || Boolean(old && !machineOld && running === false);
  if (!s) { rows($('standoff-facts'), [['state', machineOld ? `not known: ${machineOld}` : 'off']]); return; }
  text('v-standoff', fixed(s.measured_mm, 1)); text('v-standoff-set', fixed(s.set_mm, 1));
  text('v-standoff-z', s.alarm ? 'alarm' : `Z ${signed(s.correction_mm)}`);
  $('standoff-value').classList.toggle('bad', Boolean(s.alarm));
  rows($('standoff-facts'), [['measured by', s.source], ['set, mm', fixed(s.set_mm, 2)], ['measured, mm', fixed(s.measured_mm, 2)],
    ['correction of the programmed Z, mm', signed(s.correction_mm)], ['state', s.alarm ? `! ${s.alarm}: ${s.correction_mm ? 'on its way to the programmed Z, or kept above metal that is too high' : 'programmed Z until the next arc'}` : machineOld ? `not known: ${machineOld}` : old ? 'off' : 'ok']]);
  if (telemetry && !old) keep([telemetry.t, s.set_mm, s.measured_mm, s.correction_mm]);
}

function keep(sample) {
  const last = samples[samples.length - 1];
  if (last && sample[0] === last[0]) return;
  if (last && sample[0] < last[0]) samples.length = 0; // another run
  samples.push(sample);
  if (samples.length > KEEP) samples.shift();
}

export function drawStandoff() { draw($('standoff-distance'), DISTANCE, samples); draw($('standoff-correction'), CORRECTION, samples); }
