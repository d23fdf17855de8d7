// The live stream. Says at once when nothing comes any more: a socket can hang long before the browser notices.
const SILENT_MS = 1500;
const boot = document.querySelector('meta[name=boot]').content;

// onFrame gets frames with all sections, `fresh` with the first one of a connection; onPast samples of before, the
// newest first; onLost the silence in s, some times a second while nothing comes.
export function follow(onFrame, onPast, onLost) {
  let last = 0, opened = performance.now(), socket = null, sections = {}, fresh = true;
  const silence = () => performance.now() - (last || opened);
  function show() {
    const lost = silence() > SILENT_MS || !last;
    document.body.classList.toggle('lost', lost);
    if (lost) onLost(silence() / 1000);
  }
  function open() {
    socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/stream`);
    sections = {}; fresh = true;
    socket.onmessage = (event) => {
      const frame = JSON.parse(event.data);
      if (frame.boot !== boot) { location.reload(); return; } // the panel started again: fresh rights, fresh page
      last = performance.now();
      show();
      if (frame.history) { onPast(frame.history); return; }
      Object.assign(sections, frame.sections); // only what has changed comes
      onFrame({ ...frame, sections, fresh });
      fresh = false;
    };
    socket.onclose = () => { if (last) opened = last; last = 0; show(); setTimeout(open, 1000); };
  }
  open();
  setInterval(() => {
    show();
    if (last && performance.now() - last > 4000) socket.close();
  }, 250);
}
