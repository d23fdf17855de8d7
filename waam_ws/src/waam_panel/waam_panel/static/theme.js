// Light or dark: as the system has it, unless somebody has chosen the other one with the button on this device.
const system = matchMedia('(prefers-color-scheme: dark)');
let here = null; // of this page only: a private window may keep nothing
const kept = () => { try { return localStorage.getItem('theme'); } catch { return here; } };

export const isDark = () => (kept() ?? (system.matches ? 'dark' : 'light')) === 'dark';

export function applyTheme() {
  const chosen = kept();
  for (const name of ['dark', 'light']) document.documentElement.classList.toggle(name, chosen === name);
}

// The other one; what the system has anyway is not kept, so that the page follows it again.
export function switchTheme() {
  const next = isDark() ? 'light' : 'dark';
  here = next === (system.matches ? 'dark' : 'light') ? null : next;
  try {
    if (here) localStorage.setItem('theme', here); else localStorage.removeItem('theme');
  } catch { /* kept for this page only */ }
}

export function onSystemTheme(act) { system.addEventListener('change', act); }
