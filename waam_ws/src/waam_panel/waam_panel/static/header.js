// What stands on every page: tiles of machine, job and arc, the line below them, and which buttons are alive.
import { $, countdown, fixed, text } from './api.js';
import { ageOf, known, why } from './sources.js';

const UNKNOWN = 'not known';

function tile(name, state, detail, classes = {}) {
  text(`${name}-state`, state); text(`${name}-detail`, detail);
  $(`${name}-detail`).title = detail;
  for (const style of ['bad', 'held', 'lit']) $(`${name}-tile`).classList.toggle(style, Boolean(classes[style]));
}

function showMachine(m, t) {
  const state = !m ? UNKNOWN : !m.connected ? 'NOT CONNECTED' : t ? t.state : m.state;
  const detail = !m ? why('machine') : !m.connected ? m.message || 'no controller answers' : `${m.homed ? 'homed' : 'not homed'}, ${m.armed ? 'ARMED' : 'not armed'}`;
  tile('machine', state, detail, { bad: state === 'ALARM' || state === 'NOT CONNECTED', held: state === 'HOLD' });
  const lost = Boolean(m && !(m.connected && m.homed)); // after safe torque off or power-up nobody knows where the axes stand
  $('position').classList.toggle('unknown', lost || !m);
  text('p-note', !m ? `not known: ${why('machine')}` : !m.connected ? 'not connected: where it stands is not known'
    : lost ? 'not homed: where it stands is not known' : 'mm from the work zero');
}

function showArc(t) {
  tile('arc', !t ? '–' : t.arc ? 'ON' : t.arc_enabled ? 'strikes' : 'off', !t ? UNKNOWN : t.gas ? 'gas on' : 'gas off', { lit: t && t.arc_enabled });
}

// What is left counts down between two words of the job, and the end as a time of day. It is an estimate: when it is
// over and the job is not, it says so.
let said = null, told = '';
function left(j) {
  if (j.time_left === null) { told = ''; return 'time left not known'; }
  if (j.state === 'PAUSED') return `left ${countdown(j.time_left)}`; // it stands still
  const key = `${j.id} ${j.time_left} ${j.progress}`;
  if (key !== told) { told = key; said = { end: Date.now() + 1000 * (j.time_left - ageOf('job')) }; }
  const seconds = (said.end - Date.now()) / 1000;
  if (seconds < -1) return 'longer than estimated';
  return `left ${countdown(seconds)}, done at ${new Date(said.end).toLocaleTimeString([], { hour: '2-digit', minute: '2-digit' })}`;
}

function showJob(j, setup, running, lost) {
  const state = j ? j.state : UNKNOWN, loaded = setup ? `loaded: ${setup.part}` : 'no part loaded';
  if (state === 'PAUSED') told = '';  // the end moves on
  text('job-name', j && j.id && running ? j.id : loaded);
  const error = j && j.rms_mm !== null ? `, error ${fixed(j.rms_mm, 2)} mm` : '', bead = j && j.beads ? `bead ${j.bead}/${j.beads}, ` : '';
  const now = () => `${bead}${Math.round(100 * j.progress)} %, ${left(j)}${error}`;
  const detail = !j ? why('job') : state === 'PAUSED' ? j.message || now() : running ? now()
    : lost ? `${lost.id} ${lost.why}` : j.message || error.slice(2);
  tile('job', !j ? UNKNOWN : state === 'IDLE' ? 'no job' : running && j.layers ? `${state} ${j.layer}/${j.layers}` : state, detail, { held: state === 'PAUSED' });
  $('job-progress').value = j && running ? j.progress : 0;
  text('o-gain', j && j.k_gain !== null && j.k_gain !== undefined ? fixed(j.k_gain, 2) : j ? 'auto' : '–');
}

// One line below the tiles: what is not known and what leads out, why a job waits, or what was loaded, in words.
function showLine(s, m, t, j, running, lostPage) {
  const gone = Object.entries(s.programs || {}).filter(([, p]) => p.gone).map(([node]) => node);
  const machine = `The machine: ${m && m.connected ? `${t ? t.state : m.state}, ${m.armed ? 'ARMED' : 'not armed'}` : UNKNOWN}, arc ${t ? (t.arc ? 'ON' : 'off') : UNKNOWN}.`;
  let said = '';
  if (lostPage) said = '';
  else if (!j && s.job) said = `What the job does is not known: ${why('job')}. ${machine} Press STOP, then Restart programs.`;
  else if (gone.length) said = `No answer from ${gone.join(', ')}. ${machine} Restart programs when the machine stands.`;
  else if (j && j.state === 'PAUSED') said = `PAUSED: ${j.message || 'the job waits for Resume'}`;
  else if (!running && s.setup) said = `Loaded: ${s.setup.words || s.setup.part}`;
  $('said').hidden = !said;
  text('said-text', said);
  $('said').classList.toggle('warn', Boolean(gone.length || (!j && s.job) || (j && j.state === 'PAUSED')));
  $('said-restart').hidden = !gone.length;
}

function showButtons(m, t, j, setup, running, adjustable) {
  const ready = Boolean(m && m.connected), idle = ready && m.state === 'IDLE' && (!t || t.state === 'IDLE');
  const still = idle && running === false, paused = (j && j.state === 'PAUSED') || (running === false && m && m.state === 'HOLD');
  $('arm').disabled = !still || !j || !setup || m.armed;
  $('start').disabled = !still || !j || !setup || !m.armed;
  $('pause').hidden = Boolean(paused); $('resume').hidden = !paused;
  $('pause').disabled = running === false && Boolean(t) && t.state !== 'RUN';
  for (const id of ['home', 'zero']) $(id).disabled = !still;
  $('load').disabled = running !== false;
  $('disarm').disabled = Boolean(running) || !(m && m.armed);
  $('reset').disabled = !(m && (m.state === 'ALARM' || m.state === 'HOLD')) || Boolean(running);
  const jogs = running === false && ready && Boolean(t) && (t.state === 'IDLE' || t.state === 'RUN');
  document.querySelectorAll('[data-jog], [data-wire]').forEach((b) => { b.disabled = !jogs; });
  document.querySelectorAll('[data-over]').forEach((b) => { b.disabled = !ready; });
  document.querySelectorAll('[data-gain], .wishes button').forEach((b) => { b.disabled = !(running && adjustable); });
}

export function showHeader(s, running, lostPage) {
  const [m, t, j] = ['machine', 'telemetry', 'job'].map((name) => known(s, name));
  showMachine(m, t); showArc(m && m.connected === false ? undefined : t); showJob(j, s.setup, running, s.lost_job);
  showLine(s, m, t, j, running, lostPage);
  showButtons(m, t, j, s.setup, running, s.cell && s.cell.adjustable);
}
