"""Bodies of a closed mesh, each by itself: which is inside out, which lies in another, which is a cavity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

FLAT = 1e-15  # m3; less is no body
TOUCHING = 1e-9  # m
MAX_BODIES = 2000
FEWEST, ASKED = 3, 40  # rays, from the middles of so many faces of a body
PAIR = 2000  # faces that a pair costs beside its own
MAX_WORK = 100_000_000  # rays times faces, in all
WAY = np.array([0.137, 0.071, 0.988])  # of the rays, along no edge that a CAD system draws


@dataclass(frozen=True, eq=False)
class Body:
    """faces: numbers of its faces. volume: m3, below 0 where its normals point inwards. around: bodies it lies in."""

    faces: np.ndarray
    volume: float
    around: tuple[int, ...]
    place: np.ndarray  # (3,) m, its middle

    @property
    def wrong(self) -> bool:
        """Whether the normals point the other way than its depth in other bodies asks for."""
        return (self.volume > 0) == bool(len(self.around) % 2)


def bodies_of(mesh: trimesh.Trimesh) -> list[Body]:
    """Of a closed mesh with consistent winding, largest first. ValueError for more than MAX_BODIES."""
    label = trimesh.graph.connected_component_labels(
        mesh.face_adjacency, node_count=len(mesh.faces)
    )
    count = int(label.max()) + 1
    if count > MAX_BODIES:
        raise ValueError(
            f'{count} bodies are more than {MAX_BODIES}; leave out what is not to be built'
        )
    triangles = np.asarray(mesh.triangles)
    corners = triangles - mesh.bounds.mean(axis=0)
    six = np.einsum('ij,ij->i', corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    volume = np.bincount(label, six) / 6
    order = np.argsort(-np.abs(volume), kind='stable')
    by_label = np.split(np.argsort(label, kind='stable'), np.cumsum(np.bincount(label))[:-1])
    faces = [by_label[i] for i in order]
    low = np.array([triangles[f].min(axis=(0, 1)) for f in faces]) - TOUCHING
    high = np.array([triangles[f].max(axis=(0, 1)) for f in faces]) + TOUCHING
    pairs = [
        np.flatnonzero(
            (low[:i] <= low[i] + TOUCHING).all(axis=1)
            & (high[:i] >= high[i] - TOUCHING).all(axis=1)
        ).tolist()
        for i in range(count)
    ]
    work = sum(FEWEST * (len(faces[j]) + PAIR) for inside in pairs for j in inside)
    if work > MAX_WORK:
        raise ValueError(
            f'{count} bodies lie within the boxes of too many others; leave out what is not to be built'
        )
    rays = min(ASKED, FEWEST * MAX_WORK // max(1, work))
    out: list[Body] = []
    for i, own in enumerate(faces):
        around = tuple(j for j in pairs[i] if _within(triangles[own], triangles[faces[j]], rays))
        out.append(Body(own, float(volume[order[i]]), around, (low[i] + high[i]) / 2))
    return out


def _within(inner: np.ndarray, outer: np.ndarray, rays: int) -> bool:
    """Whether a body lies in another, by rays from the middles of its faces; both (n, 3, 3) m."""
    count = min(len(inner), rays)
    some = inner[np.linspace(0, len(inner) - 1, count).astype(int)]
    a, u, v = outer[:, 0], outer[:, 1] - outer[:, 0], outer[:, 2] - outer[:, 0]
    h = np.cross(WAY, v)
    det = np.einsum('ij,ij->i', u, h)
    usable = np.abs(det) > 1e-30
    a, u, v, h, inverse = a[usable], u[usable], v[usable], h[usable], 1 / det[usable]
    hits = 0
    for middle in some.mean(axis=1):
        s = middle - a
        q = np.cross(s, u)
        b = np.einsum('ij,ij->i', s, h) * inverse
        c = np.einsum('ij,j->i', q, WAY) * inverse
        t = np.einsum('ij,ij->i', v, q) * inverse
        hits += int(((b >= 0) & (c >= 0) & (b + c <= 1) & (t > 1e-9)).sum()) % 2
    return hits > 0.9 * count


def fault(mesh: trimesh.Trimesh, bodies: list[Body]) -> str:
    """What is wrong with the bodies, with place and remedy; '' if nothing."""
    bad = [b for b in bodies if abs(b.volume) < FLAT]
    if bad:
        return f'zero volume, {_one(bodies, bad[0])} is flat; give it a thickness or leave it out'
    if all(b.volume < 0 for b in bodies if not b.around):
        return 'inverted normals, they point into the part; flip them and export again, or --repair'
    for b in bodies:
        if b.wrong and not b.around:
            return (
                f'{_one(bodies, b)} is inside out: its inverted normals point into it; '
                'flip them and export again, or --repair'
            )
        if b.wrong and len(b.around) % 2:
            return (
                f'{_one(bodies, b)} lies within another one and the normals of both point outwards: a cavity whose '
                'normals must point into it, or a body to leave out; it cannot be known which'
            )
        if b.wrong:
            return f'{_one(bodies, b)} in a cavity is inside out; flip its normals and export again'
    return ''


def _one(bodies: list[Body], body: Body) -> str:
    x, y, z = body.place * 1e3
    number = bodies.index(body) + 1
    return f'body {number} of {len(bodies)} ({len(body.faces)} faces around ({x:.1f}, {y:.1f}, {z:.1f}) mm)'


def turned_out(mesh: trimesh.Trimesh) -> list[str]:
    """Turns the faces of outer bodies that are inside out, with all that lies in them; what was done, for a person.

    Bodies within bodies are left as they are to each other: which of them is a cavity is not known here.
    """
    bodies = bodies_of(mesh)
    roots = [min(b.around, default=i) for i, b in enumerate(bodies)]
    wrong = {i for i, b in enumerate(bodies) if not b.around and b.volume < 0}
    turn = [b for b, root in zip(bodies, roots, strict=True) if root in wrong]
    if not turn:
        return []
    faces = mesh.faces.copy()
    which = np.concatenate([b.faces for b in turn])
    faces[which] = faces[which][:, ::-1]
    mesh.faces = faces
    return [f'{_one(bodies, b)} was inside out and is turned' for b in turn]
