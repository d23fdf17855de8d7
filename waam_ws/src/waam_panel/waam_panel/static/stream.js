// The live stream. Says at once when nothing comes any more: a socket can hang long before the browser notices.
const SILENT_MS = 1500;
const boot = document.querySelector('meta[name=boot]').content;

export function follow(onFrame) {
  let last = 0, socket = null;
  const show = () => document.body.classList.toggle('lost', performance.now() - last > SILENT_MS);
  function open() {
    socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/stream`);
    socket.onmessage = (event) => {
      const frame = JSON.parse(event.data);
      if (frame.boot !== boot) { location.reload(); return; } // the panel started again: fresh rights, fresh page
      last = performance.now();
      show();
      onFrame(frame);
    };
    socket.onclose = () => { last = 0; show(); setTimeout(open, 1000); };
  }
  open();
  setInterval(() => {
    show();
    if (last && performance.now() - last > 4000) socket.close();
  }, 250);
}
