// Maps of the part (height, error, psi) with path and torch from above, and the path in three dimensions.
import { $, get, text } from './api.js';
import { colour, prepare, trail } from './plots.js';

const DIVERGING = [[5, 48, 97], [67, 147, 195], [209, 229, 240], [247, 247, 247], [253, 219, 199], [214, 96, 77], [103, 0, 31]];
const SEQUENTIAL = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
const UNKNOWN = -32768;
const UNITS = { height: ['mm', 1e3], error: ['mm', 1e3], psi: ['', 1] };
const FROM = { height: 'height', error: 'height', psi: 'correction', path: 'plan', viewer: 'viewer' };
const maps = {}, wanted = {};
let shown = 'height', torch = null, arc = false, unrolled = false, latest = {};
const SEAM = 30; // mm between two samples with the arc on: over the seam of an unrolled shaft
const view = { turn: -0.6, tilt: 0.9, zoom: 1 };

function blend(table, share) {
  const at = Math.min(Math.max(share, 0), 1) * (table.length - 1), i = Math.min(Math.floor(at), table.length - 2);
  return table[i].map((v, k) => v + (table[i + 1][k] - v) * (at - i));
}

function decode(map, name) {
  const bytes = Uint8Array.from(atob(map.data), (c) => c.charCodeAt(0));
  const values = new Int16Array(bytes.buffer), table = name === 'height' ? SEQUENTIAL : DIVERGING;
  const picture = document.createElement('canvas');
  picture.width = map.cols; picture.height = map.rows;
  const g = picture.getContext('2d'), image = g.createImageData(map.cols, map.rows);
  values.forEach((v, i) => {
    const row = map.rows - 1 - Math.floor(i / map.cols), at = 4 * (row * map.cols + i % map.cols);
    const c = v === UNKNOWN ? [128, 132, 138] : blend(table, (v / map.scale - map.low) / (map.high - map.low));
    image.data.set([c[0], c[1], c[2], v === UNKNOWN ? 60 : 255], at);
  });
  g.putImageData(image, 0, 0);
  return { ...map, values, picture, table };
}

// Fetches what changed of what is shown (a map is large); several changes while one is on its way count as one.
export async function refresh(versions) {
  latest = versions;
  for (const [name, version] of Object.entries(versions)) {
    if (wanted[name] === version) continue;
    if (name !== shown && name !== 'path') { delete maps[name]; delete wanted[name]; continue; } // an old one is not shown later
    wanted[name] = version;
    const map = await get(`/api/map/${name}`);
    if (!map) { delete wanted[name]; continue; }
    maps[name] = name === 'path' ? map : decode(map, name);
    note();
  }
}

export function moveTorch(telemetry, cell) {
  torch = telemetry ? telemetry.place : null; arc = telemetry ? telemetry.arc : false;
  if (unrolled !== Boolean(cell && cell.unrolled)) { unrolled = !unrolled; note(); }
}
export const hasMap = (name) => Boolean(latest[name]);

export function show(name) {
  shown = name;
  document.querySelectorAll('[data-map]').forEach((b) => b.classList.toggle('on', b.dataset.map === name));
  $('viewer').hidden = name !== 'viewer';
  $('run-split').classList.toggle('viewing', name === 'viewer'); // it brings its own plots
  $('map-frame').dataset.from = $('map-note').dataset.from = FROM[name];
  note();
}

// Where the error is largest: a numbered list under the map, the same numbers on it.
function listPlaces() {
  const places = shown === 'error' && maps.error ? maps.error.places : [];
  const list = $('map-places'), items = places.map((p) => Object.assign(document.createElement('li'), { textContent: p.words }));
  list.hidden = !items.length;
  list.replaceChildren(...items);
}

function drawPlaces(g, to) {
  (maps.error ? maps.error.places : []).forEach((p, i) => {
    const [x, y] = to(...p.at);
    g.beginPath(); g.arc(x, y, 10, 0, 7); g.fillStyle = '#fff'; g.fill();
    g.lineWidth = 2; g.strokeStyle = '#b0009b'; g.stroke();
    g.fillStyle = '#b0009b'; g.font = 'bold 13px system-ui, sans-serif'; g.textAlign = 'center';
    g.fillText(i + 1, x, y + 5);
    g.textAlign = 'start';
  });
}

function note() {
  listPlaces();
  const map = maps[shown];
  if (shown === 'viewer') text('map-note', 'the same viewer as `waam view`; turn with the mouse');
  else if (shown === 'path') text('map-note', map ? `layer ${map.layer}: solid = arc on, dashed = idle, red = torch; drag to turn` : 'no path yet');
  else text('map-note', map ? `${map.title}. ${unrolled ? 'Shaft, unrolled: x goes around it, y is along its axis. ' : ''}Touch for the value.` : 'no map yet');
}

export function draw() {
  if (shown === 'viewer') return;
  const { g, w, h } = prepare($('map'));
  if (shown === 'path') { drawSpace(g, w, h); return; }
  const map = maps[shown];
  if (!map) return;
  const scale = Math.min((w - 84) / (map.cols * map.cell), (h - 16) / (map.rows * map.cell));
  const left = 8 + (w - 84 - scale * map.cols * map.cell) / 2, bottom = h - 8 - (h - 16 - scale * map.rows * map.cell) / 2;
  const place = { x: (mm) => left + (mm * 1e-3 - map.x) * scale, y: (mm) => bottom - (mm * 1e-3 - map.y) * scale };
  g.imageSmoothingEnabled = false;
  g.drawImage(map.picture, left, bottom - scale * map.rows * map.cell, scale * map.cols * map.cell, scale * map.rows * map.cell);
  map.at = (px, py) => [Math.floor((bottom - py) / scale / map.cell), Math.floor((px - left) / scale / map.cell)];
  drawPath(g, (x, y) => [place.x(x), place.y(y)], 1);
  if (shown === 'error') drawPlaces(g, (x, y) => [place.x(x), place.y(y)]);
  drawBar(g, map, w, h);
}

function drawPath(g, to, width) {
  for (const strip of maps.path ? maps.path.strips : []) {
    g.setLineDash(strip.arc ? [] : [6, 5]);
    g.strokeStyle = strip.arc ? colour('--plan') : '#666';
    g.lineWidth = strip.arc ? width * 1.6 : width;
    line(g, strip.points, 3, to);
  }
  g.setLineDash([]);
  g.strokeStyle = '#ff8a00'; g.lineWidth = 2.5;
  let piece = [];
  for (const s of [...trail(), null]) {
    if (s && s[12] && !(piece.length && Math.abs(s[9] - piece[piece.length - 3]) > SEAM)) piece.push(s[9], s[10], s[11]);
    else { line(g, piece, 3, to); piece = s && s[12] ? [s[9], s[10], s[11]] : []; }
  }
  if (!torch) return;
  const [x, y] = to(...torch);
  g.beginPath(); g.arc(x, y, 7, 0, 7); g.fillStyle = arc ? '#ff8a00' : '#d00018'; g.fill();
  g.lineWidth = 2; g.strokeStyle = '#fff'; g.stroke();
}

function line(g, points, width, to) {
  if (points.length < 2 * width) return;
  g.beginPath();
  for (let i = 0; i < points.length; i += width) g.lineTo(...to(points[i], points[i + 1], points[i + 2]));
  g.stroke();
}

function drawBar(g, map, w, h) {
  const [unit, factor] = UNITS[shown], top = 24, bottom = h - 24;
  for (let y = top; y < bottom; y++) {
    g.fillStyle = `rgb(${blend(map.table, (bottom - y) / (bottom - top)).map(Math.round)})`;
    g.fillRect(w - 66, y, 16, 1);
  }
  g.fillStyle = colour('--fore'); g.font = '14px system-ui, sans-serif';
  const say = (v) => `${shown === 'height' ? '' : v > 0 ? '+' : ''}${(v * factor).toFixed(1)}`;
  g.fillText(say(map.high), w - 46, top + 6);
  g.fillText(say(map.low), w - 46, bottom);
  g.fillText(unit, w - 46, (top + bottom) / 2);
}

function drawSpace(g, w, h) {
  const strips = maps.path ? maps.path.strips : [];
  if (!strips.length) return;
  let low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (const s of strips) s.points.forEach((v, i) => { const k = i % 3; low[k] = Math.min(low[k], v); high[k] = Math.max(high[k], v); });
  const middle = low.map((v, k) => (v + high[k]) / 2), size = Math.hypot(...low.map((v, k) => high[k] - v)) || 1;
  const scale = 0.9 * Math.min(w, h) / size * view.zoom, { sin, cos } = Math;
  drawPath(g, (x, y, z) => {
    const dx = x - middle[0], dy = y - middle[1], dz = z - middle[2];
    const across = dx * cos(view.turn) - dy * sin(view.turn), away = dx * sin(view.turn) + dy * cos(view.turn);
    return [w / 2 + scale * across, h / 2 - scale * (away * sin(view.tilt) + dz * cos(view.tilt))];
  }, 1.2);
}

export function bindMap() {
  const canvas = $('map');
  let drag = null;
  canvas.addEventListener('pointerdown', (e) => { drag = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); read(e); });
  canvas.addEventListener('pointermove', (e) => {
    if (drag && shown === 'path') {
      view.turn += (e.clientX - drag[0]) * 0.01;
      view.tilt = Math.min(1.57, Math.max(0.05, view.tilt + (e.clientY - drag[1]) * 0.01));
      drag = [e.clientX, e.clientY];
    } else read(e);
  });
  canvas.addEventListener('pointerup', () => { drag = null; });
  canvas.addEventListener('wheel', (e) => {
    if (shown === 'path') { view.zoom = Math.min(8, Math.max(0.5, view.zoom * (e.deltaY < 0 ? 1.15 : 0.87))); e.preventDefault(); }
  }, { passive: false });
  document.querySelectorAll('[data-map]').forEach((b) => b.addEventListener('click', () => show(b.dataset.map)));
}

function read(event) {
  const map = maps[shown];
  if (!map || !map.at) return;
  const [row, col] = map.at(event.offsetX, event.offsetY), [unit, factor] = UNITS[shown];
  if (row < 0 || col < 0 || row >= map.rows || col >= map.cols) return;
  const v = map.values[row * map.cols + col];
  const mm = (n, o) => ((o + (n + 0.5) * map.cell) * 1e3).toFixed(1);
  const value = v === UNKNOWN ? 'not measured' : `${(v / map.scale * factor).toFixed(2)} ${unit}`;
  text('map-note', `x ${mm(col, map.x)} mm, y ${mm(row, map.y)} mm: ${value}`);
}
