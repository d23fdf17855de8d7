'use strict';
const canvas = document.getElementById('path'), ink = canvas.getContext('2d');
const ask = id => document.getElementById(id);
const layers = PLAN.layers, count = layers.length;
let turn = -0.6, tilt = 0.95, zoom = 1, shift = [0, 0], box = null;

function bounds() {
  const low = [1e12, 1e12, 1e12], high = [-1e12, -1e12, -1e12];
  for (const runs of layers) for (const [arc, p] of runs) if (arc)
    for (let i = 0; i < p.length; i++) {
      low[i % 3] = Math.min(low[i % 3], p[i]);
      high[i % 3] = Math.max(high[i % 3], p[i]);
    }
  return {middle: low.map((v, i) => (v + high[i]) / 2),
          size: Math.max(1, Math.hypot(...low.map((v, i) => high[i] - v)))};
}

function project(p, i, scale, cx, cy) {
  const x = p[i] - box.middle[0], y = p[i + 1] - box.middle[1], z = p[i + 2] - box.middle[2];
  const c = Math.cos(turn), s = Math.sin(turn);
  const right = x * c - y * s, away = x * s + y * c;
  return [cx + right * scale, cy - (away * Math.cos(tilt) + z * Math.sin(tilt)) * scale];
}

function colour(layer, metal) {
  if (ask('metal').checked) return `hsl(${Math.max(0, Math.min(240, 240 - 1.5 * (metal - 20)))},80%,45%)`;
  return `hsl(${205 + 60 * (layer / Math.max(1, count - 1))},75%,42%)`;
}

function drawRun(layer, [arc, p, metal], place) {
  if (!arc && !ask('idle').checked) return;
  ink.setLineDash(arc ? [] : [3, 4]);
  ink.lineWidth = arc ? 1.4 : 0.7;
  ink.strokeStyle = arc ? colour(layer, metal[0]) : '#aab';
  let now = ink.strokeStyle;
  ink.beginPath();
  ink.moveTo(...place(p, 0));
  for (let i = 3, k = 0; i < p.length; i += 3, k++) {
    if (arc && ask('metal').checked) {
      const next = colour(layer, metal[k]);
      if (next !== now) {
        ink.stroke(); ink.beginPath(); ink.moveTo(...place(p, i - 3));
        ink.strokeStyle = now = next;
      }
    }
    ink.lineTo(...place(p, i));
  }
  ink.stroke();
  if (!arc) return;
  for (const [i, c] of [[0, '#1a9641'], [p.length - 3, '#d7191c']]) {
    const [x, y] = place(p, i);
    ink.fillStyle = c;
    ink.fillRect(x - 2, y - 2, 4, 4);
  }
}

function draw() {
  const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  canvas.width = w * ratio; canvas.height = h * ratio;
  ink.setTransform(ratio, 0, 0, ratio, 0, 0);
  ink.clearRect(0, 0, w, h);
  const scale = 0.95 * Math.min(w, h * 1.15) / box.size * zoom;
  const place = (p, i) => project(p, i, scale, w / 2 + shift[0], h / 2 + shift[1]);
  const first = Number(ask('first').value), last = Number(ask('last').value);
  for (let k = first - 1; k < last && k < count; k++)
    for (const run of layers[k]) drawRun(k, run, place);

  axes();
  document.querySelectorAll('.layers tbody tr').forEach(
    (row, k) => row.classList.toggle('on', k >= first - 1 && k < last));
}

function axes() {
  const h = canvas.clientHeight, c = Math.cos(turn), s = Math.sin(turn), from = [45, h - 45];
  const ways = {x: [c, s * Math.cos(tilt)], y: [-s, c * Math.cos(tilt)], z: [0, Math.sin(tilt)]};
  ink.setLineDash([]); ink.lineWidth = 1; ink.strokeStyle = ink.fillStyle = '#445';
  for (const [name, [dx, dy]] of Object.entries(ways)) {
    ink.beginPath(); ink.moveTo(...from); ink.lineTo(from[0] + 28 * dx, from[1] - 28 * dy); ink.stroke();
    ink.fillText(name, from[0] + 36 * dx - 3, from[1] - 36 * dy + 3);
  }
}

function look(a, b) { turn = a; tilt = b; zoom = 1; shift = [0, 0]; draw(); }
canvas.addEventListener('pointerdown', e => canvas.setPointerCapture(e.pointerId));
canvas.addEventListener('pointermove', e => {
  if (!e.buttons) return;
  if (e.shiftKey) { shift[0] += e.movementX; shift[1] += e.movementY; }
  else {
    turn -= e.movementX * 0.008;
    tilt = Math.max(0, Math.min(Math.PI / 2, tilt - e.movementY * 0.008));
  }
  draw();
});
canvas.addEventListener('wheel', e => { e.preventDefault(); zoom *= Math.exp(-e.deltaY * 0.001); draw(); },
  {passive: false});
ask('slider').max = ask('last').max = ask('first').max = count;
ask('slider').value = ask('last').value = count;
ask('slider').addEventListener('input', e => { ask('last').value = e.target.value; draw(); });
for (const id of ['first', 'last', 'idle', 'metal']) ask(id).addEventListener('input', draw);
ask('top').onclick = () => look(0, 0);
ask('side').onclick = () => look(0, Math.PI / 2);
ask('iso').onclick = () => look(-0.6, 0.95);
window.addEventListener('resize', draw);
box = bounds();
draw();
