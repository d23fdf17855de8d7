"""Opens recordings in the rerun viewer, in a browser."""

from __future__ import annotations

from pathlib import Path

from waam_node import job_folder

from .drawing import free_port, port_is_free
from .web_viewer import WebViewer


class ViewError(ValueError):
    """Nothing to show, or the viewer cannot show it; the text names the file."""


def find_recording(path: Path) -> Path:
    """The file to open for a folder (job, demo, record) or a file (.rrd, .mcap). Raises ViewError."""
    path = Path(path)
    if path.is_file():
        if path.suffix not in ('.rrd', '.mcap'):
            raise ViewError(f'{path}: neither .rrd nor .mcap')
        return path
    if not path.is_dir():
        raise ViewError(f'{path} does not exist')
    for pattern in (
        job_folder.viewer_recording(),
        f'{job_folder.record()}/*.mcap',
        '*.mcap',
    ):
        found = sorted(path.glob(pattern))
        if found:
            return found[0]
    inside = sorted(p.parent.name for p in path.glob(f'*/{job_folder.viewer_recording()}'))
    hint = f'; jobs inside: {", ".join(inside)}' if inside else ''
    raise ViewError(f'{path}: no job.rrd and no .mcap there{hint}')


def serve(file: Path, web_port: int) -> int:
    """Serves a recording to browsers on this machine until Ctrl-C; prints the address."""
    if not port_is_free(web_port):
        raise ViewError(f'port {web_port} is in use; choose another with --port')
    viewer = WebViewer(str(file), web_port, free_port())
    print(f'{file}\n{viewer.url}\nCtrl-C ends.', flush=True)
    try:
        return viewer.wait()
    except KeyboardInterrupt:
        return 0
    finally:
        viewer.close()
