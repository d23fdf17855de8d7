// All jobs together: filters, the chart of a figure with its limits, the newest rows.
import { $, element, fill, fixed, makeTable, reportLink, tableRow, text } from './api.js';
import { colour, prepare } from './plots.js';

const FILTERS = ['part', 'material', 'wire_lot', 'operator', 'verdict', 'since'];
let chart = null, figures = [], asked = 0;

function query() {
  const q = new URLSearchParams({ figure: $('a-figure').value });
  for (const name of FILTERS) if ($(`a-${name}`).value) q.set(name, $(`a-${name}`).value);
  return q;
}

async function ask() {
  const mine = ++asked;
  text('archive-note', 'Looking …');
  let found = null;
  try {
    found = await (await fetch(`/api/archive?${query()}`, { credentials: 'same-origin' })).json();
  } catch { found = { ok: false, message: 'no answer' }; }
  if (mine !== asked) return; // a newer question is under way
  if (!found.ok) { text('archive-note', found.message); return; }
  if (!figures.length) fillFigures(found.figures);
  chart = found.chart;
  showRows(found);
  drawChart();
}

function fillFigures(list) {
  figures = list;
  fill($('a-figure'), list.map(([name, said, unit]) => [name, unit ? `${said}, ${unit}` : said]), $('a-figure').value || 'rms');
}

function showRows(found) {
  const broken = (found.chart.signals || []).map((s) => `${s.rule}: ${s.text} (${s.points.length} points)`);
  const shown = found.count > found.jobs.length ? `, the newest ${found.jobs.length} are shown` : '';
  text('archive-note', [`${found.count} jobs${shown}.`, found.chart.message || broken.join('; ') || 'No rule is broken.', ...found.said].join(' '));
  const table = makeTable(['when (UTC)', 'part', 'verdict', 'RMS, mm', 'in tolerance', 'operator, lot', ''], found.jobs.map(row));
  $('archive-list').replaceChildren(found.jobs.length ? table : element('p', 'No job fits.', 'note'));
}

function row(j) {
  const link = element('td'), share = j.share_in_tolerance;
  const cells = [(j.created || '–').slice(0, 16).replace('T', ' '), `${j.part || '–'} ${j.material || ''}`, j.verdict || '–', fixed(j.rms_mm, 3),
    share === null ? '–' : `${fixed(100 * share, 1)} %`, [j.operator, j.wire_lot].filter(Boolean).join(', ') || '–'];
  if (j.report) link.append(reportLink(encodeURI(j.report)));
  const r = tableRow([...cells, link]);
  r.title = j.job;
  return r;
}

export function drawChart() {
  if ($('archive-box').hidden) return;
  const { g, w, h } = prepare($('archive-chart'));
  if (!chart || !chart.means || w < 60) return;
  const all = [...chart.means, chart.lower, chart.upper].filter((v) => v !== null);
  const low = Math.min(...all), high = Math.max(...all), span = high - low || 1, right = 64;
  const x = (i) => 8 + (w - right - 16) * i / Math.max(1, chart.means.length - 1), y = (v) => h - 12 - (h - 24) * (v - low) / span;
  const line = (v, style, dash, name) => {
    g.strokeStyle = colour(style); g.setLineDash(dash); g.lineWidth = 1.5;
    g.beginPath(); g.moveTo(8, y(v)); g.lineTo(w - right, y(v)); g.stroke();
    g.fillStyle = colour('--fore'); g.fillText(`${name} ${v.toPrecision(3)}`, w - right + 4, y(v) + 4);
  };
  g.font = '12px system-ui, sans-serif';
  line(chart.center, '--soft', [], '');
  if (chart.upper > chart.lower) { line(chart.upper, '--bad', [7, 4], '↑'); line(chart.lower, '--bad', [7, 4], '↓'); }
  g.setLineDash([]); g.strokeStyle = colour('--plan'); g.lineWidth = 2;
  g.beginPath(); chart.means.forEach((v, i) => (i ? g.lineTo(x(i), y(v)) : g.moveTo(x(i), y(v)))); g.stroke();
  const broken = new Set(chart.signals.flatMap((s) => s.points));
  chart.means.forEach((v, i) => {
    const r = broken.has(i) ? 6 : 3; // larger and square: colour alone carries no meaning
    g.fillStyle = colour(broken.has(i) ? '--bad' : '--plan');
    if (broken.has(i)) g.fillRect(x(i) - r, y(v) - r, 2 * r, 2 * r); else { g.beginPath(); g.arc(x(i), y(v), r, 0, 7); g.fill(); }
  });
}

function show(all) {
  $('archive-box').hidden = !all; $('job-list').hidden = all;
  $('jobs-all').classList.toggle('on', all); $('jobs-newest').classList.toggle('on', !all);
  if (all) ask();
}

export function bindArchive() {
  $('jobs-newest').addEventListener('click', () => show(false));
  $('jobs-all').addEventListener('click', () => show(true));
  $('jobs-again').addEventListener('click', () => { if (!$('archive-box').hidden) ask(); });
  $('archive-form').addEventListener('submit', (e) => { e.preventDefault(); ask(); });
  $('archive-form').addEventListener('change', ask);
  window.addEventListener('resize', drawChart);
}
