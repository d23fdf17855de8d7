// What must hold of every page whatever it shows; see page_checks.py. Answers sentences, none = no violation.
() => {
  const bad = [], root = document.documentElement;
  const name = (e) => `${e.tagName.toLowerCase()}${e.id ? '#' + e.id : ''}${e.className && e.className.baseVal === undefined ? '.' + String(e.className).trim().replace(/\s+/g, '.') : ''}`;
  const shown = (e) => e.checkVisibility({ opacityProperty: true, visibilityProperty: true }) && e.getClientRects().length > 0;
  const unseen = (e) => Boolean(e.closest('.unseen')); // for readers of the screen only

  // ---- colours: rgba in 0..1, laid over each other
  const probe = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
  const parse = (css) => {
    const m = /^rgba?\(([\d.]+)[, ]+([\d.]+)[, ]+([\d.]+)(?:[,/ ]+([\d.]+))?\)$/.exec(css);
    if (m) return [m[1] / 255, m[2] / 255, m[3] / 255, m[4] === undefined ? 1 : Number(m[4])];
    probe.clearRect(0, 0, 1, 1); probe.fillStyle = css; probe.fillRect(0, 0, 1, 1);
    return [...probe.getImageData(0, 0, 1, 1).data].map((v) => v / 255);
  };
  const over = (top, under) => [0, 1, 2].map((k) => top[k] * top[3] + under[k] * (1 - top[3])).concat(1);
  const light = (c) => { const [r, g, b] = c.map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const ratio = (a, b) => { const [x, y] = [light(a), light(b)].sort((p, q) => q - p); return (x + 0.05) / (y + 0.05); };
  // every colour that may lie behind an element: of a gradient all of its colours
  const behind = (e) => {
    if (!e) return [parse(getComputedStyle(root).colorScheme === 'dark' ? '#121212' : '#fff')];
    const style = getComputedStyle(e), fill = parse(style.backgroundColor), gradient = style.backgroundImage.match(/rgba?\([^)]*\)/g) || [];
    if (fill[3] === 1 && !gradient.length) return [fill];
    const under = behind(e.parentElement).map((c) => over(fill, c));
    return gradient.length ? under.flatMap((c) => gradient.map((g) => over(parse(g), c))) : under;
  };
  const opacity = (e) => { let o = 1; for (; e; e = e.parentElement) o *= Number(getComputedStyle(e).opacity); return o; };
  const worst = (e, css) => {
    const ink = parse(css);
    ink[3] *= opacity(e);
    return Math.min(...behind(e).map((c) => ratio(over(ink, c), c)));
  };

  // ---- contrast of every text that is seen (1.4.3); what is disabled is exempt there
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), done = new Set();
  while (texts.nextNode()) {
    const e = texts.currentNode.parentElement;
    if (!texts.currentNode.data.trim() || done.has(e) || !shown(e) || unseen(e) || e.closest(':disabled, script, style, option')) continue;
    done.add(e);
    const style = getComputedStyle(e), size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    const found = worst(e, style.color);
    if (found < (large ? 3 : 4.5)) bad.push(`contrast ${found.toFixed(2)}: ${name(e)} '${e.textContent.trim().slice(0, 40)}'`);
  }
  for (const e of document.querySelectorAll('*')) {
    for (const part of ['::before', '::after']) {
      const style = getComputedStyle(e, part);
      if (!shown(e) || ['none', 'normal', '""'].includes(style.content)) continue;
      if (worst(e, style.color) < 4.5) bad.push(`contrast ${worst(e, style.color).toFixed(2)}: ${name(e)}${part}`);
    }
    if (e.placeholder && shown(e) && worst(e, getComputedStyle(e, '::placeholder').color) < 4.5) bad.push(`contrast of the placeholder: ${name(e)}`);
  }

  // ---- names (4.1.2, 1.1.1), headings (1.3.1, 2.4.6), language (3.1.1), title (2.4.2), ids, a way past (2.4.1)
  const spoken = (e) => (e.getAttribute('aria-label') || (e.getAttribute('aria-labelledby') || '').split(' ').map((i) => document.getElementById(i)?.textContent || '').join('')
    || [...(e.labels || [])].map((l) => l.textContent).join('') || e.textContent || e.alt || e.title || '').trim();
  for (const e of document.querySelectorAll('button, a[href], input:not([type=hidden]), select, textarea, iframe, img, canvas, [role]')) {
    const own = ['SELECT', 'INPUT', 'TEXTAREA'].includes(e.tagName) ? [...(e.labels || [])].map((l) => l.firstChild.textContent).join('').trim() || e.getAttribute('aria-label') : spoken(e);
    if (shown(e) && !own && !['alert', 'status'].includes(e.getAttribute('role'))) bad.push(`no name: ${name(e)}`);
    if (e.tagName === 'IMG' && !e.hasAttribute('alt')) bad.push(`no alt: ${name(e)}`);
  }
  const heads = [...document.querySelectorAll('h1, h2, h3, h4, h5, h6')].filter(shown);
  if (heads.filter((h) => h.tagName === 'H1').length !== 1) bad.push('not one h1');
  heads.forEach((h, i) => { const now = Number(h.tagName[1]), before = i ? Number(heads[i - 1].tagName[1]) : 0; if (now > before + 1) bad.push(`heading skips a level: ${name(h)} '${h.textContent.trim()}'`); });
  if (!root.lang) bad.push('no language');
  if (!document.title.trim()) bad.push('no title');
  if (document.querySelectorAll('main').length !== 1) bad.push('not one main');
  const ids = [...document.querySelectorAll('[id]')].map((e) => e.id);
  for (const id of new Set(ids.filter((i, k) => ids.indexOf(i) !== k))) bad.push(`two of #${id}`);
  for (const e of document.querySelectorAll('[aria-labelledby], [aria-describedby], [aria-controls], label[for]')) {
    for (const a of ['aria-labelledby', 'aria-describedby', 'aria-controls', 'for']) for (const id of (e.getAttribute(a) || '').split(' ').filter(Boolean)) if (!document.getElementById(id)) bad.push(`${a} of ${name(e)}: no #${id}`);
  }
  for (const e of document.querySelectorAll('[tabindex]')) if (e.tabIndex > 0) bad.push(`order of the keyboard is forced: ${name(e)}`);
  const zoom = document.querySelector('meta[name=viewport]')?.content || '';
  if (/user-scalable\s*=\s*no|maximum-scale/.test(zoom)) bad.push('zooming is forbidden');

  // ---- nothing cut: no text that is longer than its box, nothing beyond the sides, unless one can scroll there
  const scrolls = (e) => { for (; e; e = e.parentElement) if (/auto|scroll/.test(getComputedStyle(e).overflowX) && e.scrollWidth > e.clientWidth + 1) return true; return false; };
  if (root.scrollWidth > innerWidth + 1) bad.push(`the page is ${root.scrollWidth} px wide of ${innerWidth}`);
  for (const e of document.querySelectorAll('nav')) if (e.scrollHeight > e.clientHeight + 1) bad.push(`${name(e)} is cut below: ${e.scrollHeight} px of ${e.clientHeight}`);
  for (const e of document.querySelectorAll('select')) {
    if (!shown(e) || !e.selectedOptions.length) continue;
    const style = getComputedStyle(e), room = e.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight) - 18; // the arrow
    probe.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
    if (probe.measureText(e.selectedOptions[0].textContent.trim()).width > room) bad.push(`cut: ${name(e)} '${e.selectedOptions[0].textContent.trim()}'`);
  }
  for (const e of document.querySelectorAll('body *')) {
    if (!shown(e) || unseen(e) || ['OPTION', 'CANVAS'].includes(e.tagName)) continue;
    const box = e.getBoundingClientRect(), style = getComputedStyle(e);
    if (box.width && (box.right > innerWidth + 1 || box.left < -1) && !scrolls(e.parentElement)) bad.push(`leaves the screen: ${name(e)}`);
    const own = [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim());
    const tight = ['BUTTON'].includes(e.tagName) || style.overflowX === 'hidden' || style.textOverflow === 'ellipsis';
    if (own && tight && style.display !== 'inline' && e.scrollWidth > e.clientWidth + 1) bad.push(`cut: ${name(e)} '${e.textContent.trim().slice(0, 60)}'`);
  }
  return [...new Set(bad)];
}
