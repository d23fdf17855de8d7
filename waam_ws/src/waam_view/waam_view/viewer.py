"""Opens recordings in the rerun viewer: in a browser, or as a picture without a screen."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from pathlib import Path

from waam_node import job_folder

from .blueprint import LAYERS, TIMELINE
from .web_viewer import binary

PLAN_RECORDING = 'preview.rrd'  # of `waam plan --rerun`


class ViewError(ValueError):
    """Nothing to show, or the viewer cannot show it; the text names the file."""


def find_recording(path: Path) -> Path:
    """The file to open for a folder (job, demo, record, plan) or a file (.rrd, .mcap, .npz). Raises ViewError."""
    path = Path(path)
    if path.is_file():
        if path.suffix not in ('.rrd', '.mcap', '.npz'):
            raise ViewError(f'{path}: neither .rrd nor .mcap, nor the .npz of a plan')
        return path
    if not path.is_dir():
        raise ViewError(f'{path} does not exist')
    for pattern in (
        job_folder.viewer_recording(),
        f'{job_folder.record()}/*.mcap',
        '*.mcap',
        PLAN_RECORDING,
        job_folder.plan(),
    ):
        found = sorted(path.glob(pattern))
        if found:
            return found[0]
    inside = sorted(p.parent.name for p in path.glob(f'*/{job_folder.viewer_recording()}'))
    hint = f'; jobs inside: {", ".join(inside)}' if inside else ''
    raise ViewError(f'{path}: no job.rrd and no .mcap there{hint}')


def screenshot(file: Path, png: Path, settle_s: float = 4.0, size: str = '1900x1100') -> None:
    """Draws the end of a recording into a PNG, without a screen (needs a software or real Vulkan driver).

    Raises ViewError when the viewer does not start or draws nothing.
    """
    from rerun.experimental import ViewerClient

    from .drawing import free_port

    port = free_port()
    command = [str(binary()), str(file), '--headless', '--bind', '127.0.0.1']
    command += ['--port', str(port), '--window-size', size]
    env = {**os.environ, 'RUST_LOG': 'error'}
    with subprocess.Popen(
        command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as viewer:
        try:
            _wait_for(port, viewer)
            client = ViewerClient.connect(f'rerun+http://127.0.0.1:{port}/proxy')
            time.sleep(settle_s)  # the viewer does not report when everything is loaded and drawn
            timeline = LAYERS if file.name == PLAN_RECORDING else TIMELINE
            client.set_time(timeline, play_state='following')  # the end
            time.sleep(1.0)
            client.save_screenshot(str(png))
        except (RuntimeError, ValueError, OSError) as e:
            raise ViewError(f'{file}: no picture ({_why(viewer, e)})') from None
        finally:
            viewer.kill()


def _why(viewer: subprocess.Popen, error: Exception) -> str:
    """Why the viewer failed: one that ended by itself had no driver to draw with."""
    try:
        viewer.wait(2.0)
    except subprocess.TimeoutExpired:
        return str(error)
    driver = 'drawing needs a Vulkan driver, in software: mesa-vulkan-drivers'
    return f'the viewer ended with status {viewer.returncode}; {driver}'


def _wait_for(port: int, viewer: subprocess.Popen, timeout: float = 15.0) -> None:
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        if viewer.poll() is not None:
            raise OSError(f'the viewer ended with status {viewer.returncode}')
        try:
            with socket.create_connection(('127.0.0.1', port), timeout=1.0):
                return
        except OSError:
            time.sleep(0.1)
    raise OSError(f'the viewer did not open port {port} within {timeout:.0f} s')


def serve(file: Path, web_port: int) -> int:
    """Serves a recording to browsers on this machine until Ctrl-C; prints the address."""
    from .drawing import free_port, port_is_free
    from .web_viewer import WebViewer

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
