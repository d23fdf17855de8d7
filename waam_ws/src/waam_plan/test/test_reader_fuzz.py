"""Damaged files of every format: what is read is a mesh, a cloud or a program; all else is a named error."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))
import reader_clouds
import reader_meshes
import reader_packages
import reader_programs
from reader_case import NAMED

from waam_plan.import_gcode.files import is_program, load_program
from waam_plan.mesh.clouds import is_cloud, read_cloud
from waam_plan.mesh.part import load_part
from waam_plan.mesh.pcd import unpacked

SMALL = np.round(reader_clouds.surface()[::20], 2)
N = len(SMALL)


def pcd(kind: str, body: bytes) -> bytes:
    return reader_clouds.pcd_head('x y z', '4 4 4', 'F F F', kind, N) + body


def lzf() -> bytes:
    raw = SMALL.astype('<f4').T.tobytes()
    body = reader_clouds.packed(raw)
    return len(body).to_bytes(4, 'little') + len(raw).to_bytes(4, 'little') + body


SEEDS = {
    'a.xyz': reader_clouds.text(SMALL).encode(),
    'a.csv': reader_clouds.text(SMALL, ';', 'X [mm];Y [mm];Z [mm]', True).encode(),
    'a.txt': reader_clouds.text(SMALL, '\t', 'z\ty\tx').encode('utf-16'),
    'text.pcd': pcd('ascii', reader_clouds.text(SMALL).encode()),
    'binary.pcd': pcd('binary', SMALL.astype('<f4').tobytes()),
    'packed.pcd': pcd('binary_compressed', lzf()),
    'cloud.ply': reader_clouds.ply(
        'float x, float y, float z', SMALL.astype('<f4').tobytes(), 'binary_little_endian', N
    ),
    'a.npy': reader_clouds.npy(SMALL.reshape(1, N, 3)),
    'a.npz': reader_clouds.npz(points=SMALL),
    'text.stl': reader_meshes.ascii_stl().encode(),
    'binary.stl': reader_meshes.stl(reader_meshes.box()),
    'mesh.ply': reader_meshes.box().export(file_type='ply'),
    'text.ply': reader_meshes.box().export(file_type='ply', encoding='ascii'),
    'a.obj': reader_meshes.OBJ.encode(),
    'a.off': reader_meshes.box().export(file_type='off').encode(),
    'prusa.3mf': reader_packages.prusa('ParameterModifier'),
    'orca.3mf': reader_packages.bambu('normal_part'),
    'split.3mf': reader_packages.split(2),
    'a.gcode': f'{reader_programs.WAAM}G2 X50 I25 F600\nG1 Y5\nM5\nM30\n'.encode(),
    'extruder.gcode': (reader_programs.HEAD + 'M221 S90\n' + reader_programs.rows()).encode(),
}  # fmt: skip


def looked_at(path: Path) -> None:
    """Reads a file as `waam plan` would. Every other error than a named one goes on."""
    try:
        if is_program(path):
            program = load_program(path, 'slicer' if path.name.startswith('extruder') else '')
            assert all(m.speed > 0 for m in program.burning)
        elif is_cloud(path):
            points = read_cloud(path).points
            assert np.isfinite(points).all() and points.shape[1] == 3
        else:
            mesh = load_part(path, repair=path.name.startswith('text')).mesh
            assert np.isfinite(mesh.vertices).all() and mesh.faces.max() < len(mesh.vertices)
    except NAMED as error:
        assert path.name in str(error) or is_program(path), error


@st.composite
def damaged(draw, data: bytes) -> bytes:
    """Bytes changed, a piece cut out, a piece repeated, digits made large, or the end cut off."""
    out = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(0, len(out) - 1)))
        how = draw(st.sampled_from(['change', 'cut', 'repeat', 'number', 'end']))
        if how == 'change' and out:
            out[at] = draw(st.integers(0, 255))
        elif how == 'cut':
            del out[at : at + draw(st.integers(1, 60))]
        elif how == 'repeat':
            out[at:at] = out[at : at + draw(st.integers(1, 200))]
        elif how == 'number':
            out[at : at + 1] = draw(
                st.sampled_from([b'999999999999', b'-1', b'1e999', b'nan', b',', b'\r', b'\0\0'])
            )
        elif how == 'end':
            del out[at:]
    return bytes(out)


@pytest.mark.parametrize('name', SEEDS)
@given(data=st.data())
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_damaged_file_is_read_or_refused_by_name(tmp_path_factory, name, data):
    path = tmp_path_factory.getbasetemp() / name
    path.write_bytes(data.draw(damaged(SEEDS[name])))
    looked_at(path)


@pytest.mark.parametrize('name', SEEDS)
def test_the_undamaged_file_is_read(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(SEEDS[name])
    if is_program(path):
        load_program(path, 'slicer' if path.name.startswith('extruder') else '')
    elif is_cloud(path):
        assert len(read_cloud(path).points) == N
    else:
        load_part(path)


@given(st.binary(max_size=400), st.sampled_from([*SEEDS, 'b.txt']))
@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
def test_any_bytes_are_refused_by_name(tmp_path_factory, data, name):
    path = tmp_path_factory.getbasetemp() / name
    path.write_bytes(data)
    looked_at(path)


@given(st.binary(max_size=3000), st.integers(0, 7))
@settings(max_examples=100, deadline=None)
def test_what_was_packed_comes_back(data, repeat):
    data = data * (1 + repeat)
    assert unpacked(reader_clouds.packed(data), len(data)) == data


@given(st.binary(max_size=300), st.integers(0, 5000))
@settings(max_examples=200, deadline=None)
def test_any_packed_bytes_make_so_many_or_are_refused(data, size):
    try:
        assert len(unpacked(data, size)) == size
    except ValueError:
        return
