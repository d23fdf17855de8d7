// What is typed into a form stays over a reload of this tab, and no longer: a wire lot of last week is not today's.
const at = (form) => `form:${form.id}`;
const fieldsOf = (form) => [...form.elements].filter((e) => e.id && e.matches('input:not([type=file]):not([type=password]):not([type=range]), select'));

// Call when the choices of its selects are there. What is no choice any more stays as the page has it.
export function keepForm(form) {
  if (form.dataset.kept) return;
  form.dataset.kept = 'yes';
  let kept = {};
  try { kept = JSON.parse(sessionStorage.getItem(at(form))) || {}; } catch { /* nothing is kept here */ }
  for (const e of fieldsOf(form)) {
    const value = kept[e.id];
    if (typeof value !== 'string' || (e.tagName === 'SELECT' && ![...e.options].some((o) => o.value === value))) continue;
    e.value = value;
  }
  const keep = () => {
    try { sessionStorage.setItem(at(form), JSON.stringify(Object.fromEntries(fieldsOf(form).map((e) => [e.id, e.value])))); } catch { /* the same */ }
  };
  form.addEventListener('input', keep);
  form.addEventListener('change', keep);
}
