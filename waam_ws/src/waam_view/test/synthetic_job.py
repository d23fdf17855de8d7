"""Makes job folders as docs/job_folder.md describes them: a worn plate, restored in a few layers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import yaml
from scipy.ndimage import gaussian_filter

ROWS, COLS, CELL = 80, 140, 0.5e-3
ORIGIN = (0.01, 0.02)
PITCH, LAYER = 4.4e-3, 2.0e-3


def write_job(
    folder: Path, loop_mode: str = 'closed_loop', layers: int = 3, seed: int = 1, name: str = 'anvil',
    failed: bool = False, layer_error: float | None = None,
) -> dict:  # fmt: skip
    """Writes the folder and returns the content of its report.json."""
    rng = np.random.default_rng(seed)
    folder = Path(folder)
    (folder / 'layers').mkdir(parents=True)
    gain = {'closed_loop': 0.25, 'open_loop': 1.0, 'monitor': 1.0}[loop_mode]
    gain = layer_error if layer_error is not None else gain
    wear = gaussian_filter(rng.normal(size=(ROWS, COLS)), 9)
    wear *= 0.55e-3 / wear.std()
    y, x = np.mgrid[0:ROWS, 0:COLS] * CELL
    margin = 12
    region = np.zeros((ROWS, COLS), bool)
    region[margin:-margin, margin:-margin] = True
    interior = np.zeros_like(region)
    interior[margin + 6 : -margin - 6, margin + 6 : -margin - 6] = True
    nominal = np.where(region, layers * LAYER, np.nan)
    surface = np.where(region, wear, wear * 0.1)
    rms = []
    for k in range(layers + 1):
        target = np.where(region, k * LAYER, np.nan)
        error = (surface - target)[interior]
        rms.append(float(np.sqrt(np.mean(error**2))))
        save_scan(
            folder=folder, k=k, surface=surface, target=target, nominal=nominal, region=region, interior=interior,
            rng=rng, has_next=k < layers,
        )  # fmt: skip
        ripple = 0.04e-3 * np.cos(2 * np.pi * y / PITCH)
        noise = gaussian_filter(rng.normal(size=surface.shape), 3) * 0.12e-3
        deviation = surface - k * LAYER
        surface = np.where(region, (k + 1) * LAYER + gain * deviation + ripple + noise, surface)
    report = make_report(loop_mode, layers, rms, name, failed)
    (folder / 'report.json').write_text(json.dumps(report))
    write_telemetry(folder, layers, rng)
    (folder / 'job.yaml').write_text(yaml.safe_dump(job_yaml(loop_mode)))
    return report


def save_scan(folder, k, surface, target, nominal, region, interior, rng, has_next) -> None:
    z = surface + rng.normal(size=surface.shape) * 0.02e-3
    z[rng.random(z.shape) < 0.01] = np.nan
    z[:, -3:] = np.nan
    maps = {
        'z': z, 'sigma': np.full(z.shape, 3e-5), 'count': np.full(z.shape, 9), 'target': target,
        'nominal': nominal, 'planned': np.where(region, LAYER, 0.0),
    }  # fmt: skip
    if has_next:
        psi = np.clip((surface - target) / 0.3e-3, -1, 1)
        maps |= {
            'psi': np.nan_to_num(psi), 'confidence': np.isfinite(z) * 0.9,
            'residual_height': np.nan_to_num(psi) * 1e-4,
        }  # fmt: skip
    np.savez_compressed(
        folder / f'layers/scan_{k:03d}.npz',
        origin=np.array(ORIGIN),
        resolution=CELL,
        region=region,
        interior=interior,
        layer=k,
        **{n: v.astype(np.float32) for n, v in maps.items()},
    )


def make_report(loop_mode, layers, rms, name, failed) -> dict:
    reports = []
    for k in range(layers + 1):
        final = k == layers
        reports.append(
            {
                'layer': k + (not final), 'final': final, 'duration': 182.0, 'wait': 30.0 * k,
                'temperature': 21.0 + 55 * k, 'current_mean': 181.0 - k, 'voltage_mean': 22.1,
                'wire_feed_mean': 0.0833, 'travel_speed_mean': 0.0101, 'heat_input': 396e3,
                'arc_on_time': 150.0, 'energy': 6e5, 'wire_used': 12.5,
                'height_error_rms': rms[k], 'height_error_max': 3.1 * rms[k],
                'height_error_mean': 0.1 * rms[k], 'coverage': 0.988, 'psi_min': -1.0,
                'psi_mean': -0.03, 'psi_max': 0.92, 'k_gain': 0.3, 'heat_factor': 0.97,
                'flow_factor': 1.02, 'law': 'damped_inverse', 'fallback': k == 1,
                'correction_applied': loop_mode == 'closed_loop', 'clamps_speed': 4 + k,
                'reasons': ['map older than the layer'] if k == 1 else [],
                'clamps_feed': 1, 'clamps_voltage': 0, 'clamps_psi': 17, 'faults': 0,
            }
        )  # fmt: skip
    good = rms[-1] < 0.2e-3
    run = {
        'rms_mm': rms[-1] * 1e3, 'max_mm': 3.1e3 * rms[-1], 'mean_mm': 0.02, 'rms_all_mm': 0.311,
        'share_in_tolerance': 0.873, 'as_found_rms_mm': rms[0] * 1e3, 'error_code': 0, 'message': '',
        'verdict': 'in tolerance' if good else 'out of tolerance', 'layers': reports,
        'anomalies': [
            {'time': 1.8e9 + 61.5, 'severity': 2, 'class': 'arc', 'text': 'arc lost <b>twice</b>',
             'reaction': 'retry', 'layer': 1, 'bead': 4, 'position': [0.031, 0.042, 0.002]},
            {'time': 1.8e9 + 99.0, 'severity': 'WARNING', 'class': 'scan', 'text': '3 % drop-outs',
             'reaction': 'none', 'layer': 2, 'bead': 0, 'position': None},
        ],
        'clamps': {'speed': 37, 'feed': 5, 'voltage': 0, 'psi': 211}, 'points_dropped': 48213,
        'profiles_rejected': 12, 'telemetry_lost': 0, 'faults': 1, 'wire_m': 37.42,
        'deposition_kg_h': 2.437, 'energy_J': 1.83e6,
        'duration_s': 812.0, 'arc_on_s': 451.0, 'cost': 0.01432, 'folder': '.',
    }  # fmt: skip
    if failed:
        run |= {
            'verdict': 'failed',
            'error_code': 108,
            'message': 'arc did not strike after 3 tries',
        }
    return {
        'job_id': '20261121T093000_' + name, 'name': name, 'part': 'parts/anvil.stl',
        'material': 'ER70S-6_1.2', 'created': '2026-11-21T09:30:00Z', 'tolerance_mm': 0.2,
        'verdict': run['verdict'], loop_mode: run,
    }  # fmt: skip


def write_telemetry(folder: Path, layers: int, rng) -> None:
    per_layer = 1800
    n = per_layer * layers
    t = 1.8e9 + np.arange(n) * 0.1
    layer = np.arange(n) // per_layer + 1
    phase = np.arange(n) % per_layer
    arc = (phase > 200) & (phase < 1500)
    temperature = 25 + 55 * (layer - 1) + 40 * np.clip((phase - 200) / 1300, 0, 1)
    temperature[n // 2 : n // 2 + 50] = np.nan
    np.savez_compressed(
        folder / 'telemetry.npz', t=t, x=0.05 + 0.02 * np.sin(phase / 50), y=np.full(n, 0.03),
        z=layer * 0.002, current=np.where(arc, 180 + rng.normal(size=n) * 3, 0),
        voltage=np.where(arc, 22 + rng.normal(size=n) * 0.2, 0),
        wire_feed=np.where(arc, 0.0833 + rng.normal(size=n) * 2e-3, 0),
        wire_feed_commanded=np.where(arc, 0.0833, 0), speed=np.where(arc, 0.0101, 0.05),
        temperature=temperature, arc=arc, layer=layer,
    )  # fmt: skip


def job_yaml(loop_mode: str) -> dict:
    return {
        'goal': {
            'part': 'parts/anvil.stl',
            'loop_mode': loop_mode,
            'layers': 3,
            'operator': 'A & B <x>',
        },
        'parameters': {'thermal_compensator': {'interpass_limit': 150.0}},
        'part_sha256': '0123abcd',
        'packages': {'numpy': '2.3.1'},
    }


def write_demo(folder: Path) -> dict:
    """Open and closed loop of one part, and the report.json above them."""
    folder = Path(folder)
    runs = {}
    for loop_mode in ('open_loop', 'closed_loop'):
        report = write_job(folder / loop_mode, loop_mode)
        runs[loop_mode] = report[loop_mode] | {'folder': loop_mode}
    whole = {
        k: report[k] for k in ('job_id', 'name', 'part', 'material', 'created', 'tolerance_mm')
    }
    whole |= runs | {'verdict': runs['closed_loop']['verdict']}
    whole['ratio'] = runs['closed_loop']['rms_mm'] / runs['open_loop']['rms_mm']
    (folder / 'report.json').write_text(json.dumps(whole))
    return whole
