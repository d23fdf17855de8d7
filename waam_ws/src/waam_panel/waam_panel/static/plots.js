// Time plots: the newest minutes of machine time, commanded thin and grey, actual strong.
const KEEP = 7200, SPAN = 120; // samples, s of machine time
const ROWS = [ // title, unit, columns of a sample (see state.py), lowest span of the axis, sections
  { name: 'current', unit: 'A', columns: [1], span: 20, from: 'telemetry' },
  { name: 'voltage', unit: 'V', columns: [2], span: 4, from: 'telemetry' },
  { name: 'wire', unit: 'm/min', columns: [3, 4], span: 1, from: 'telemetry' },
  { name: 'travel', unit: 'mm/s', columns: [5, 6], span: 2, from: 'telemetry' },
  { name: 'interpass, limit', unit: '°C', columns: [8, 7], span: 20, from: 'temperature heat' },
];
const data = [];

export function addSamples(samples) {
  for (const s of samples) {
    if (data.length && s[0] < data[data.length - 1][0] - 5) data.length = 0; // time went back: another run
    data.push(s);
  }
  if (data.length > KEEP) data.splice(0, data.length - KEEP);
}
// Samples from before those that are there; those of another run have another time.
export function addPast(samples) {
  const first = data.length ? data[0][0] : Infinity;
  if (samples.every((s) => s[0] <= first)) data.unshift(...samples);
}
export function clearSamples() { data.length = 0; }
// Samples of the present job, for the path that was welded.
let job = '', since = 0;
export function setJob(id) {
  if (id && id !== job) { job = id; since = data.length ? data[data.length - 1][0] : 0; }
}
export const trail = () => data.filter((s) => s[0] >= since);

export function makePlots(box) {
  const canvases = ROWS.map((row) => {
    const canvas = document.createElement('canvas');
    canvas.dataset.from = row.from;
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', `${row.name}, ${row.unit}, over time`);
    box.append(canvas);
    return canvas;
  });
  return () => ROWS.forEach((row, i) => draw(canvases[i], row));
}

// Fits the picture to its box in device pixels; returns the context and the size in CSS pixels.
export function prepare(canvas) {
  const scale = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  const w = Math.max(1, Math.round(box.width)), h = Math.max(1, Math.round(box.height));
  if (canvas.width !== w * scale || canvas.height !== h * scale) { canvas.width = w * scale; canvas.height = h * scale; }
  const g = canvas.getContext('2d');
  g.setTransform(scale, 0, 0, scale, 0, 0);
  g.clearRect(0, 0, w, h);
  return { g, w, h };
}
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function limits(row, from, samples) {
  let low = Infinity, high = -Infinity;
  for (const s of samples) {
    if (s[0] < from) continue;
    for (const c of row.columns) if (s[c] !== null) { low = Math.min(low, s[c]); high = Math.max(high, s[c]); }
  }
  if (low > high) { low = 0; high = row.span; }
  const middle = (low + high) / 2, half = Math.max(high - low, row.span) / 2 * 1.1;
  return low >= 0 && low < half ? [0, Math.max(high * 1.1, row.span)] : [middle - half, middle + half];
}

// A row over time: row.columns of samples whose first column is the time, s.
export function draw(canvas, row, samples = data) {
  const { g, w, h } = prepare(canvas);
  if (w < 20 || h < 20) return;
  const last = samples.length ? samples[samples.length - 1] : null;
  const now = last ? last[0] : 0, from = now - SPAN, [low, high] = limits(row, from, samples);
  const x = (t) => 4 + (w - 60) * (t - from) / SPAN, y = (v) => h - 4 - (h - 8) * (v - low) / (high - low);
  g.font = '13px system-ui, sans-serif';
  row.columns.forEach((column, k) => {
    const first = row.columns.length > 1 && k === 0;
    g.strokeStyle = first ? colour('--hold') : colour('--plan');
    g.setLineDash(first ? [7, 4] : []);
    g.lineWidth = 2;
    g.beginPath();
    let pen = false, skipped = 0;
    for (const s of samples) {
      if (s[0] < from) continue;
      if (s[column] === null || s[0] - skipped > 10 && skipped) pen = false;
      skipped = s[0];
      if (s[column] === null) continue;
      if (pen) g.lineTo(x(s[0]), y(s[column])); else g.moveTo(x(s[0]), y(s[column]));
      pen = true;
    }
    g.stroke();
  });
  g.setLineDash([]);
  g.fillStyle = colour('--back');
  g.globalAlpha = 0.8;
  g.fillRect(2, 2, g.measureText(`${row.name}, ${row.unit}`).width + 8, 18);
  g.globalAlpha = 1;
  g.fillStyle = colour('--fore');
  g.fillText(`${row.name}, ${row.unit}`, 6, 15);
  g.textAlign = 'right';
  g.fillText(high.toFixed(high < 100 ? 1 : 0), w - 4, 14);
  g.fillText(low.toFixed(low < 100 ? 1 : 0), w - 4, h - 5);
  g.textAlign = 'left';
}
