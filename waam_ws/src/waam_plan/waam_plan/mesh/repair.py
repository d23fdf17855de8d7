"""Mesh repair, only on request: every change is reported with its place."""

from __future__ import annotations

import numpy as np
import trimesh

from waam_plan.mesh.bodies import turned_out

LONGEST_HOLE = 5000  # edges


def repaired(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, list[str]]:
    """A copy without double faces and holes (closed by a fan), normals out of the bodies, and what was done, for a
    person. ValueError for too many bodies."""
    done: list[str] = []
    mesh = _without_doubles(mesh, done)
    mesh = _closed(mesh, done)
    before = mesh.faces.copy()
    trimesh.repair.fix_winding(mesh)
    turned = int((before != mesh.faces).any(axis=1).sum())
    if turned:
        done.append(f'{turned} faces turned so that those of a body are wound alike')
    if mesh.is_watertight:
        done += turned_out(mesh)
    return mesh, done


def _without_doubles(mesh: trimesh.Trimesh, done: list[str]) -> trimesh.Trimesh:
    _, first = np.unique(np.sort(mesh.faces, axis=1), axis=0, return_index=True)
    surplus = len(mesh.faces) - len(first)
    if surplus:
        done.append(f'{surplus} double faces removed')
    return trimesh.Trimesh(mesh.vertices, mesh.faces[np.sort(first)], process=False)


def _closed(mesh: trimesh.Trimesh, done: list[str]) -> trimesh.Trimesh:
    vertices, faces = [mesh.vertices], [mesh.faces]
    count = len(mesh.vertices)
    for loop in boundary_loops(mesh):
        if len(loop) > LONGEST_HOLE:
            continue
        rim = mesh.vertices[loop]
        vertices.append(rim.mean(axis=0)[None])
        ahead = np.roll(loop, -1)
        faces.append(np.column_stack([ahead, loop, np.full(len(loop), count)]))
        count += 1
        x, y, z = rim.mean(axis=0) * 1e3
        size = float(np.ptp(rim, axis=0).max()) * 1e3
        done.append(
            f'hole of {len(loop)} edges, {size:.1f} mm wide, closed around ({x:.1f}, {y:.1f}, {z:.1f}) mm'
        )
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)


def boundary_loops(mesh: trimesh.Trimesh) -> list[np.ndarray]:
    """Numbers of the vertices around every hole, in the order of the faces' edges; open chains are left out."""
    key = np.sort(mesh.edges, axis=1)
    _, inverse, use = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    open_edges = mesh.edges[use[inverse.ravel()] == 1]
    follows: dict[int, list[int]] = {}
    for a, b in open_edges.tolist():
        follows.setdefault(a, []).append(b)
    loops = []
    while follows:
        first = next(iter(follows))
        loop, here = [], first
        while here in follows:
            loop.append(here)
            ahead = follows[here].pop()
            if not follows[here]:
                del follows[here]
            here = ahead
        if here == first and len(loop) > 2:
            loops.append(np.array(loop))
    return loops
