"""A plan as one .npz file: maps and segments, readable by numpy alone."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from waam_plan.plan import Plan, PlanError, PlannedLayer
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec, HeightGrid
from waam_process.safe_files import parse_json, read_npz
from waam_process.segment import Kind, Segment

VERSION = 1
_FLOATS = ('speed', 'dwell', 'height', 'width', 'speed_programmed', 'wire_feed_speed', 'voltage')
_INTS = ('index', 'layer', 'bead')
GONE = {  # settings of older files that only told how the stored path came about
    'scanner_trails', 'scanner_overlap', 'judged_rim', 'max_layer_ratio', 'min_share', 'feed_floor', 'lead_in',
    'lead_out', 'idle_pieces', 'adaptive_min', 'teardrop', 'stiffener_spacing', 'stiffener_length', 'tangent_in',
    'tangent_out', 'overhang_passes', 'multi_level', 'growth_step', 'finish_growth',
}  # fmt: skip


def save_plan(plan: Plan, path: Path | str) -> None:
    """Keys of the file, SI:

    as_found, nominal: surfaces (rows, cols) on the grid of origin, resolution
    region, interior: bool (rows, cols)
    planned, target_before, target_after: (layers, rows, cols), float32
    footprint: bool (layers, rows, cols)
    direction (layers, 3), beside (layers; m3)
    start, end (segments, 3), kind, arc, layer and the other fields of a segment, one column each
    about: JSON, everything else
    """
    segments = [s for layer in plan.layers for s in layer.segments]
    about = {
        'version': VERSION,
        'mode': plan.mode,
        'name': plan.name,
        'offset': plan.offset,
        'safe_z': plan.safe_z,
        'warnings': plan.warnings,
        'remarks': plan.remarks,
        'settings': asdict(plan.settings),
    }
    shape = (0, *plan.spec.shape)
    maps = {
        name: np.array([getattr(p, name) for p in plan.layers], np.float32).reshape(-1, *shape[1:])
        for name in ('planned', 'target_before', 'target_after')
    }
    arrays: dict[str, Any] = dict(
        about=np.array(json.dumps(about)),
        origin=np.array([plan.spec.origin_x, plan.spec.origin_y]),
        resolution=np.array(plan.spec.resolution),
        as_found=plan.as_found.z,
        nominal=plan.nominal.z,
        region=plan.region,
        interior=plan.interior,
        footprint=np.array([p.footprint for p in plan.layers], bool).reshape(-1, *shape[1:]),
        beside=np.array([p.beside for p in plan.layers], float),
        direction=np.array([p.direction for p in plan.layers], float).reshape(-1, 3),
        start=np.array([s.start for s in segments], float).reshape(-1, 3),
        end=np.array([s.end for s in segments], float).reshape(-1, 3),
        kind=np.array([s.kind for s in segments], np.uint8),
        arc=np.array([s.arc for s in segments], bool),
        **{k: np.array([getattr(s, k) for s in segments], np.int64) for k in _INTS},
        **{k: np.array([getattr(s, k) for s in segments], float) for k in _FLOATS},
        **maps,
    )
    np.savez_compressed(path, **arrays)


def load_plan(path: Path | str) -> Plan:
    """The plan of `save_plan` (maps of layers to float32). Raises PlanError when the file is not one."""
    try:
        data = read_npz(Path(path))
        about = parse_json(str(data['about']), 'about')
        version = about['version']
        plan = _plan(data, about) if version == VERSION else None
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, MemoryError) as error:
        raise PlanError(f'{path}: not a stored plan ({error})') from error
    if plan is None:
        raise PlanError(f'{path}: plan of version {version}, this program reads {VERSION}')
    return plan


def _plan(data: dict[str, np.ndarray], about: dict) -> Plan:
    rows, cols = data['nominal'].shape
    x, y = data['origin'].tolist()
    spec = GridSpec(x, y, float(data['resolution']), rows, cols)
    settings: dict[str, Any] = {
        k: tuple(v) if isinstance(v, list) else v
        for k, v in about['settings'].items()
        if k not in GONE
    }
    segments = _segments(data)
    count = len(data['planned'])
    beside = data.get('beside', np.zeros(count)).tolist()  # not in files of 0.2.0
    layers = [
        PlannedLayer(
            number=i + 1,
            planned=data['planned'][i].astype(float),
            target_before=data['target_before'][i].astype(float),
            target_after=data['target_after'][i].astype(float),
            segments=[s for s in segments if s.layer == i + 1],
            direction=tuple(data['direction'][i].tolist()),
            footprint=data['footprint'][i],
            beside=beside[i],
        )
        for i in range(count)
    ]
    return Plan(
        spec=spec,
        as_found=HeightGrid(spec, data['as_found']),
        nominal=HeightGrid(spec, data['nominal']),
        region=data['region'],
        interior=data['interior'],
        layers=layers,
        safe_z=about['safe_z'],
        settings=PlanSettings(**settings),
        mode=about['mode'],
        name=about['name'],
        offset=tuple(about['offset']),
        warnings=about['warnings'],
        remarks=about.get('remarks', []),
    )


def _segments(data: dict[str, np.ndarray]) -> list[Segment]:
    columns = {k: data[k].tolist() for k in ('start', 'end', 'kind', 'arc', *_INTS, *_FLOATS)}
    out = []
    for values in zip(*columns.values(), strict=True):
        row = dict(zip(columns, values, strict=True))
        row.update(start=tuple(row['start']), end=tuple(row['end']), kind=Kind(row['kind']))
        out.append(Segment(**row))
    return out
