// The page: binds buttons and keys, shows every frame of the stream.
import { $, duration, element, fixed, get, makeTable, post, reportLink, rows, stop, tableRow, text } from './api.js';
import { acknowledgeTop, bindAlarms, clearAlarms, showAlarms, showTable } from './alarms.js';
import { bindArchive, drawChart } from './archive.js';
import { bindPrograms, drawProgram, programs } from './programs.js';
import { bindCommission, readCommission, showCommission } from './commission.js';
import { showHeader } from './header.js';
import { bindJog, jogKeys, letGo, makeSteps } from './jog.js';
import { bindKeys } from './keys.js';
import { bindMap, draw as drawMap, hasMap, moveTorch, refresh, show as showMap } from './map.js';
import { bindNumbers } from './numbers.js';
import { addPast, addSamples, clearSamples, makePlots, setJob } from './plots.js';
import { bindSetup, choices } from './setup.js';
import { hear, known, mark, why } from './sources.js';
import { bindStandoff, drawStandoff, readStandoff, showStandoff } from './standoff.js';
import { follow } from './stream.js';
import { applyTheme, isDark, onSystemTheme, switchTheme } from './theme.js';

let sections = {}, factors = {}, running = null, last = null, again = 0, jobEnds = -1, page = 'run';
const drawPlots = makePlots($('plots'));

// ---- commands

const pause = () => (running ? post('pause') : stop());
const GAIN = 0.2; // where the buttons start when the correction server uses its own

function override(kind, percent) {
  const t = known(sections, 'telemetry');
  if (!t) return;
  const now = kind === 'speed' ? t.speed_override : t.wire_override, [low, high] = factors[kind] ?? [-Infinity, Infinity];
  post('override', { [kind]: Math.min(high, Math.max(low, Math.round(now * 100 + percent) / 100)) }, { quiet: true });
}
function gain(change) {
  const now = sections.job && sections.job.k_gain !== null ? sections.job.k_gain : GAIN;
  post('gain', { value: Math.min(0.5, Math.max(0, Math.round((now + change) * 100) / 100)) });
}

function bind() {
  $('stop-form').addEventListener('submit', (e) => { e.preventDefault(); stop(); });
  $('pause').addEventListener('click', pause);
  $('start').addEventListener('click', () => { $('f-wire_left_m').value = ''; $('f-wire_left_m').dispatchEvent(new Event('input', { bubbles: true })); }); // another job finds less
  for (const name of ['arm', 'start', 'resume', 'home', 'zero', 'disarm', 'reset', 'rescan', 'skip_layer']) $(name).addEventListener('click', () => post(name));
  document.querySelectorAll('[data-over]').forEach((b) => b.addEventListener('click', () => override(b.dataset.over, Number(b.dataset.step))));
  document.querySelectorAll('[data-gain]').forEach((b) => b.addEventListener('click', () => gain(Number(b.dataset.gain))));
  document.querySelectorAll('nav [data-page]').forEach((b) => b.addEventListener('click', () => open(b.dataset.page)));
  $('theme').addEventListener('click', () => { switchTheme(); theme(); });
  onSystemTheme(theme);
  $('jobs-again').addEventListener('click', jobs);
  for (const id of ['restart', 'said-restart']) $(id).addEventListener('click', () => post('restart_programs', {}, { patience: 60000 }));
  window.addEventListener('resize', redraw);
  $('map-tabs').addEventListener('click', redraw);
  bindKeys(keys(), stop);
  bindAlarms(open); bindArchive(); bindJog(); bindMap(); bindNumbers(); bindPrograms(); bindSetup(); bindStandoff(); bindCommission();
}

// name of a key: see keys.js
function keys() {
  const pages = [...document.querySelectorAll('nav [data-page]')].map((b, i) => [String(i + 1), () => open(b.dataset.page)]);
  const onMove = Object.entries({ h: () => $('home').click(), ...jogKeys() }).map(([k, act]) => [k, () => { if (page === 'move') act(); }]);
  return { ...Object.fromEntries([...pages, ...onMove]), Escape: pause, p: pause, a: () => $('arm').click(), 'shift+s': () => $('start').click(),
    r: () => { if (!$('resume').hidden) $('resume').click(); }, k: acknowledgeTop, t: () => $('theme').click() };
}

function open(name) {
  page = name;
  history.replaceState(null, '', `#${name}`); // a reload comes back to it
  document.querySelectorAll('.page').forEach((p) => p.classList.toggle('on', p.id === name));
  document.querySelectorAll('nav [data-page]').forEach((b) => b.classList.toggle('on', b.dataset.page === name));
  redraw();
  if (name === 'setup') choices();
  if (name === 'jobs') jobs();
  if (name === 'gcode') programs().then(drawProgram);
  if (name === 'standoff') readStandoff();
  if (name === 'commission') readCommission();
}

function theme() {
  applyTheme();
  text('theme', isDark() ? 'Light' : 'Dark');
  redraw(); drawChart(); drawProgram();
}

// ---- what is shown

function showValues(t, heat, temperature) {
  text('v-current', fixed(t && t.current, 0)); text('v-voltage', fixed(t && t.voltage, 1));
  text('v-feed', fixed(t && t.feed, 1)); text('v-feed-set', fixed(t && t.feed_commanded, 1));
  text('v-feed-state', t ? t.wire_feed : ''); $('feed-value').classList.toggle('bad', Boolean(t && t.wire_feed === 'underfeed'));
  text('v-speed', fixed(t && t.speed, 1)); text('v-speed-set', fixed(t && t.speed_commanded, 1));
  text('v-temperature', fixed(temperature && temperature.value, 0)); text('v-limit', fixed(heat && heat.limit, 0));
  const ready = !heat || why('heat') ? '' : !heat.plausible ? 'not believed' : heat.ready ? 'ready' : `wait ${heat.wait === null ? '' : duration(heat.wait)}`;
  text('v-ready', ready);
  $('heat-value').classList.toggle('bad', Boolean(heat && !heat.plausible));
  ['x', 'y', 'z'].forEach((axis, i) => text(`p-${axis}`, fixed(t && t.position[i], 2)));
  text('o-speed', t ? `${Math.round(t.speed_override * 100)} %` : '–'); text('o-wire', t ? `${Math.round(t.wire_override * 100)} %` : '–');
}

const percent = (v) => (v === null ? '–' : `${fixed(100 * v, 1)} %`);

function showProcess(p) {
  $('process-value').hidden = $('process-box').hidden = !p;
  if (!p) return;
  text('v-process-name', `held ${p.value}`); text('v-process-unit', p.unit);
  text('v-process', fixed(p.measured, 0)); text('v-process-set', fixed(p.set, 0));
  text('v-process-factor', p.limited ? 'at its limit' : '');
  $('process-value').classList.toggle('bad', Boolean(p.limited));
  rows($('process-facts'), [[`held: ${p.value}, set, ${p.unit}`, fixed(p.set, 1)], [`measured, ${p.unit}`, fixed(p.measured, 1)],
    ['correction: travel, wire', `${percent(p.speed)}, ${percent(p.wire)}`], ['operator: travel, wire', `${percent(p.operator_speed)}, ${percent(p.operator_wire)}`],
    ['state', p.frozen ? `stays: ${p.frozen}` : p.limited ? '! at its limit' : 'acts']]);
}

// Wire on the spool, as the job has written it after its last layer; nothing where nobody told.
const SPOOL_MS = 5000;
async function spool() {
  const s = running && page === 'run' ? await get('/api/spool') : null;
  if (running && page !== 'run') return;
  $('spool-value').hidden = !s;
  if (!s) return;
  text('v-spool', fixed(s.left_m, 1)); text('v-need', s.need_m === null ? '?' : fixed(s.need_m, 1));
  text('v-fits', `m: ${s.words || 'need not known'}`);
  $('spool-value').classList.toggle('bad', s.words === 'it is too little');
}

function showWidth(w, ratio) {
  $('width-box').hidden = !w;
  if (!w) return;
  rows($('width-facts'), [['planned setpoints give, mm', fixed(w.expected_mm, 2), 'height'], [`measured after layer ${w.layer}, mm`, `${fixed(w.width_mm, 2)} ± ${fixed(w.u_mm, 2)} (${w.sections} sections)`, 'height'],
    ['held by the voltage', ratio ? `yes, beads ${fixed(ratio, 3)} times as wide as the table says` : 'no', 'correction']]);
}

function showFacts(s) {
  const m = s.machine, l = s.link || {}, mm = (p) => p.map((v) => fixed(v, 1)).join(', ');
  const state = !m || why('machine') ? `not known: ${why('machine')}` : m.connected ? 'connected' : `not connected: ${m.message}`;
  const of = (from, pairs) => pairs.map(([a, b]) => [a, b, from]);
  rows($('facts'), [['connection', state, 'machine'], ...of('machine', !m || !m.connected ? [] : [
    ['port', m.port], ['identification', `${m.identity} ${m.firmware}`],
    ['capabilities', m.capabilities.join(', ') || '–'], ['work zero, mm (machine)', mm(m.work_offset)], ['range, mm', `${mm(m.limit_min)} to ${mm(m.limit_max)}`],
    ['armed for', m.armed_job || '–'], ['fault', m.fault ? `E${m.fault} ${m.fault_text}` : 'none'], ['last words', m.message || '–']]),
  ...of('link', [['round trip, ms (99 %)', fixed(l.round_trip_ms, 1)],
    ['telemetry, Hz / lost', `${fixed(l.rate, 0)} / ${l.lost ?? '–'}`], ['resent lines', String(l.resends ?? '–')]])]);
  const table = $('programs');
  rows(table, Object.values(s.programs).map((p) => [p.node, (p.level ? `! ${p.message}` : p.message) + (p.restarted ? ` (${p.restarted})` : ''), 'panel']));
  Object.values(s.programs).forEach((p, i) => table.rows[i].classList.toggle('gone', Boolean(p.gone)));
}

function showViewer(address) {
  const local = ['127.0.0.1', 'localhost', '[::1]'].includes(location.hostname);
  $('viewer-tab').hidden = !(address && local);
  const frame = $('viewer');
  if (address && local && !frame.hidden && frame.dataset.at !== address) { frame.dataset.at = address; frame.src = address; }
}

function onFrame(frame) {
  sections = frame.sections; running = frame.running; last = frame;
  const s = sections;
  hear(frame);
  if (frame.fresh) { clearSamples(); clearAlarms(); }
  setJob(s.job && s.job.id);
  addSamples(frame.samples);
  showValues(s.telemetry, s.heat, s.temperature); showProcess(s.process); showWidth(s.width, s.width_ratio);
  showStandoff(s.standoff, s.telemetry, why('standoff'), why('machine'), running); showViewer(s.viewer);
  showCommission(s.commission, page === 'commission');
  showHeader(s, running, why('panel'));
  if (page === 'machine') showFacts(s);
  moveTorch(known(s, 'telemetry'), s.cell); refresh(frame.maps);
  showAlarms(frame.alarms, frame.top);
  if (frame.job_ends !== jobEnds) { if (jobEnds >= 0) { jobs(); if (hasMap('error')) showMap('error'); } jobEnds = frame.job_ends; }
  mark();
  redraw();
}

// Nothing comes any more: all that is shown is old.
function onLost(seconds) {
  letGo();
  if (!last) return;
  const stale = { ...last.stale, panel: `the panel does not answer since ${Math.round(seconds)} s` };
  onFrame({ ...last, stale, ages: { ...last.ages, panel: seconds }, running: null, samples: [], alarms: [], fresh: false });
}

function redraw() {
  if (page === 'run') { drawPlots(); drawMap(); }
  if (page === 'standoff') drawStandoff();
}

async function jobs() {
  const list = await get('/api/jobs');
  text('jobs-note', list ? '' : 'No answer from the panel: the list is old.');
  if (!list) return;
  clearTimeout(again);
  if (page === 'jobs' && list.length && !list[0].report && !running) again = setTimeout(jobs, 1500); // the job still writes its report
  const lines = list.map((j) => {
    const link = element('td');
    if (j.report) link.append(reportLink(`/jobs/${encodeURIComponent(j.id)}/report.html`));
    if (j.can_go_on) {
      const goOn = element('button', 'Go on');
      goOn.addEventListener('click', () => post('load_job', { id: j.id }));
      link.append(' ', goOn);
    }
    return tableRow([j.id, j.state, j.verdict || '–', fixed(j.rms_mm, 3), `${j.material} ${j.loop_mode}`, duration(j.duration_s), link]);
  });
  $('job-list').replaceChildren(list.length ? makeTable(['job', 'state', 'verdict', 'RMS, mm', 'material, loop mode', 'time', ''], lines) : element('p', 'No jobs yet.', 'note'));
}

async function begin() {
  bind();
  theme();
  setInterval(spool, SPOOL_MS);
  follow(onFrame, (past) => { addPast(past); redraw(); }, onLost);
  const asked = location.hash.slice(1);
  if ([...document.querySelectorAll('nav [data-page]')].some((b) => b.dataset.page === asked)) open(asked);
  const found = await choices();
  if (found) { factors = found.override_limits; makeSteps($('steps'), found.steps_mm); showTable(found.alarms); }
}
begin();
