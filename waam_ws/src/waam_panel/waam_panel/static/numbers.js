// Numbers as people type them, read wholly or refused: 0.2, 0,2 and 0,2 mm are the same. The rules are those of
// numbers.py, which reads every number again. A field: <input inputmode="decimal" data-number="mm" data-low="0.02"
// data-high="5">; data-whole for whole numbers; data-default says what an empty field stands for, else it is refused.
import { $, toast } from './api.js';

const EDGES = /^[ \t\u00a0\u202f]+|[ \t\u00a0\u202f]+$/g, BLANK = /[ \t\u00a0\u202f]/;
const NUMBER = /^([+\-\u2212]?)([0-9]*)(?:([.,])([0-9]+))?$/, THOUSANDS = /^[+\-\u2212]?[1-9][0-9]{0,2}[.,][0-9]{3}$/;
const UNIT = /[^0-9.,+\-\u2212 \t\u00a0\u202f][^0-9]*$/, LONGEST = 40;

// { value } or { problem }: what was understood.
export function readNumber(text, low, high, unit = '', whole = false) {
  const refuse = (why) => ({ problem: why }), said = `'${text.slice(0, LONGEST)}'`;
  let inner = text.replace(EDGES, '');
  if (!inner) return refuse('empty: a number is wanted');
  if (inner.length > LONGEST) return refuse(`${said} ... is too long for a number`);
  const found = UNIT.exec(inner);
  if (found) {
    if (!unit || found[0] !== unit) return refuse(`${said} is not understood: ${unit ? `a number in ${unit}` : 'a plain number'} is wanted`);
    inner = inner.slice(0, found.index).replace(EDGES, '');
  }
  if (BLANK.test(inner)) return refuse(`${said} has a gap: write the digits of one number without blanks`);
  if ((inner.match(/[.,]/g) || []).length > 1) return refuse(`${said} has several marks: write one, before the decimals`);
  const parts = NUMBER.exec(inner);
  if (!parts || !(parts[2] || parts[4])) return refuse(`${said} is not understood: digits with one point or comma are wanted`);
  const sign = parts[1] === '-' || parts[1] === '\u2212' ? -1 : 1, value = sign * Number(`${parts[2] || 0}.${parts[4] || 0}`);
  const grouped = THOUSANDS.test(inner) ? sign * Number(parts[2] + parts[4]) : NaN;
  if (grouped >= low && grouped <= high) return refuse(`can be read as ${value} or as ${grouped}: write ${value} or ${grouped}`);
  if (!(value >= low && value <= high)) return refuse(`${value}, must be ${low} to ${high}${unit ? ` ${unit}` : ''}`);
  if (whole && !Number.isInteger(value)) return refuse(`${value} is not a whole number`);
  return { value };
}

// { value }, null for what is left to its default, or { problem }; a field that is wrong says so under itself.
export function readField(input) {
  const d = input.dataset, empty = !input.value.replace(EDGES, '');
  const answer = empty && d.default !== undefined ? { value: null }
    : readNumber(input.value, Number(d.low), Number(d.high), d.number, d.whole !== undefined);
  input.setCustomValidity(answer.problem || '');
  input.setAttribute('aria-invalid', String(Boolean(answer.problem)));
  input.title = answer.problem || '';
  return answer;
}

// The values of number fields by name; null, once it was said what is wrong, when one of them is.
export function readFields(prefix, names) {
  const values = {}, wrong = [];
  for (const name of names) {
    const input = $(`${prefix}${name}`), answer = readField(input);
    if (answer.problem) wrong.push([input, answer.problem]); else values[name] = answer.value;
  }
  if (!wrong.length) return values;
  toast(wrong.map(([input, problem]) => `${labelOf(input)}: ${problem}`).join('; '), true);
  wrong[0][0].focus();
  return null;
}

const labelOf = (input) => input.labels[0].firstChild.textContent.trim().split(',')[0];

export function limit(input, [low, high]) { input.dataset.low = low; input.dataset.high = high; }

// Every number field says at once what it does not understand.
export function bindNumbers() {
  for (const input of document.querySelectorAll('input[data-number]')) {
    if (input.dataset.default) input.placeholder = input.dataset.default;
    input.addEventListener('change', () => { const { problem } = readField(input); if (problem) toast(`${labelOf(input)}: ${problem}`, true); });
  }
}
