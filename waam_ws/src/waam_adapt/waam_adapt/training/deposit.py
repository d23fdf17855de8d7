"""Deposition that gradients go through: parabolic beads that overlap, fill hollows first, and
level while they are liquid.

Only the network's training uses it. It is neither the simulator's model nor that of the
benchmarks. Lengths in cells of the
training grid, heights in planned layer heights; flat arrays hold all scenes of a batch one after the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

REACH = 4  # cells on each side of a station that its metal can touch


@dataclass(frozen=True)
class Stations:
    """n points along the beads of one layer, one cell apart, of all scenes of a batch."""

    scene: torch.Tensor  # (n,) number of the scene
    bead: torch.Tensor  # (n,) number of the bead, unique in the batch
    where: torch.Tensor  # (n, 2) row and column
    cells: torch.Tensor  # (n, k) flat index into (scenes, rows, cols)
    outside: torch.Tensor  # (n, k) bool, not in the footprint
    share: torch.Tensor  # (n, k) of the metal, that a flat surface gives to the cell; sum 1
    metal: torch.Tensor  # (n,) planned volume
    from_start: torch.Tensor  # (n,) cells along the bead, from arc on
    to_end: torch.Tensor  # (n,) cells along the bead, to arc off


@dataclass(frozen=True)
class Pool:
    """The process, one value per scene (b,)."""

    efficiency: torch.Tensor  # share of the wire that arrives
    # of the metal on the height that is asked for; 1 = mass balance, a single bead gets wider as well
    exponent: torch.Tensor
    hump: torch.Tensor  # relative excess at the start of a bead
    hump_length: torch.Tensor  # cells
    crater: torch.Tensor  # relative lack at the end of a bead
    crater_length: torch.Tensor  # cells
    filling: torch.Tensor  # preference for hollows, per layer height
    levelling: torch.Tensor  # 0..0.2 per step
    lag: torch.Tensor  # 0..1, cells by which the metal comes late
    cliff: torch.Tensor  # layer heights; a step that metal hangs over instead of flowing down
    conserved: torch.Tensor  # 0..1, whether humps and craters keep the metal of their bead
    # 0..1, of the metal beside the footprint that goes there; surface tension holds the rest on the edge
    spill: torch.Tensor
    run_over: torch.Tensor  # 0..1, how much the depth beside the part draws it


def shares(
    where: torch.Tensor, tangent: torch.Tensor, width: torch.Tensor, length: torch.Tensor, rows: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Offsets' cells (n, k) as row*rows + col of a square grid and their shares (n, k), which sum to 1.

    Across the bead a parabola of `width` (n,), along it a Gaussian of `length` (n,): the pool. where, tangent (n, 2).
    """
    step = torch.arange(-REACH, REACH + 1)
    offsets = torch.stack(torch.meshgrid(step, step, indexing='ij'), -1).reshape(-1, 2)
    centre = where.round().long()
    cells = centre[:, None, :] + offsets
    d = cells - where[:, None, :]
    along = (d * tangent[:, None, :]).sum(-1)
    across2 = (d**2).sum(-1) - along**2
    section = (1 - 4 * across2 / width[:, None] ** 2).clamp_min(0)
    weight = section * torch.exp(-0.5 * (along / length[:, None]) ** 2)
    inside = ((cells >= 0) & (cells < rows)).all(-1)
    weight = weight * inside + 1e-12
    cells = cells.clamp(0, rows - 1)
    return cells[..., 0] * rows + cells[..., 1], weight / weight.sum(1, keepdim=True)


def driven(pool: Pool, s: Stations, wanted: torch.Tensor) -> torch.Tensor:
    """What reaches the metal of the wanted ratio (n,) per station: means over segments of about two cells, late by the
    lag of the wire.
    """
    first = torch.ones_like(s.bead, dtype=torch.bool)
    first[1:] = s.bead[1:] != s.bead[:-1]
    last = torch.roll(first, -1)
    before = torch.where(first, wanted, torch.roll(wanted, 1))
    after = torch.where(last, wanted, torch.roll(wanted, -1))
    mean = 0.25 * before + 0.5 * wanted + 0.25 * after
    late = pool.lag[s.scene]
    return (1 - late) * mean + late * torch.where(first, mean, torch.roll(mean, 1))


def along_bead(pool: Pool, s: Stations, wanted: torch.Tensor, noise: torch.Tensor) -> torch.Tensor:
    """Volume (n,) that really lies at every station. wanted (n,): relative layer height; noise (n,): relative.

    `conserved` 1: what is too much at the start of a bead is missing elsewhere along it, for the metal of a bead is
    what was fed; 0: it is not.
    """
    b = s.scene
    fed = pool.efficiency[b] * s.metal * wanted ** pool.exponent[b] * (1 + noise)
    shape = (
        1
        + pool.hump[b] * torch.exp(-s.from_start / pool.hump_length[b])
        - pool.crater[b] * torch.exp(-s.to_end / pool.crater_length[b])
    ).clamp_min(0.05)
    beads = int(s.bead.max()) + 1
    total = torch.zeros(beads, dtype=fed.dtype).index_add(0, s.bead, fed)
    shaped = torch.zeros(beads, dtype=fed.dtype).index_add(0, s.bead, fed * shape)
    level = (total / shaped.clamp_min(1e-9))[s.bead]
    return fed * shape * level.clamp_min(1e-3) ** pool.conserved[b]


def deposit(z: torch.Tensor, pool: Pool, s: Stations, volume: torch.Tensor) -> torch.Tensor:
    """Surface (scenes, rows, cols) after the beads; the sum over the cells grows by exactly the
    sum of `volume` (n,).
    """
    ground = z.reshape(-1)[s.cells]
    mean = (s.share * ground).sum(1, keepdim=True)
    cliff = pool.cliff[s.scene][:, None]
    deeper = torch.minimum(torch.maximum(mean - ground, -cliff), cliff)
    drawn, let_go = (
        torch.where(s.outside, p[s.scene][:, None], 1.0) for p in (pool.run_over, pool.spill)
    )
    prefer = let_go * torch.exp(pool.filling[s.scene][:, None] * drawn * deeper)
    share = s.share * prefer
    share = share / share.sum(1, keepdim=True)
    laid = torch.zeros(z.numel(), dtype=z.dtype)
    laid = laid.index_add(0, s.cells.reshape(-1), (volume[:, None] * share).reshape(-1))
    laid = laid.reshape(z.shape)
    return level(z + laid, laid.detach() > 0.05, pool)


def level(z: torch.Tensor, liquid: torch.Tensor, pool: Pool, steps: int = 3) -> torch.Tensor:
    """Flow between neighbouring cells that are both liquid, proportional to their difference; conserves the sum.

    Over a step of more than the pool's cliff nothing flows: surface tension holds the edge of the part.
    """
    rate, cliff = pool.levelling, pool.cliff[:, None, None]
    down = (liquid[:, 1:] & liquid[:, :-1]) * rate[:, None, None]
    right = (liquid[:, :, 1:] & liquid[:, :, :-1]) * rate[:, None, None]
    for _ in range(steps):
        fall_down, fall_right = z[:, 1:] - z[:, :-1], z[:, :, 1:] - z[:, :, :-1]
        flow_down = down * fall_down * (fall_down.detach().abs() < cliff)
        flow_right = right * fall_right * (fall_right.detach().abs() < cliff)
        z = (
            z
            + torch.nn.functional.pad(flow_down, (0, 0, 0, 1))
            - torch.nn.functional.pad(flow_down, (0, 0, 1, 0))
            + torch.nn.functional.pad(flow_right, (0, 1))
            - torch.nn.functional.pad(flow_right, (1, 0))
        )
    return z


def sample(values: torch.Tensor, s: Stations) -> torch.Tensor:
    """Maps (scenes, rows, cols) at the stations (n,), bilinear."""
    rows, cols = values.shape[1:]
    low = s.where.floor().clamp(min=0)
    low = torch.minimum(low, torch.tensor([rows - 2, cols - 2], dtype=low.dtype))
    f = (s.where - low).clamp(0, 1).to(values.dtype)
    base = s.scene * rows * cols + low[:, 0].long() * cols + low[:, 1].long()
    flat = values.reshape(-1)
    top = flat[base] * (1 - f[:, 1]) + flat[base + 1] * f[:, 1]
    bottom = flat[base + cols] * (1 - f[:, 1]) + flat[base + cols + 1] * f[:, 1]
    return top * (1 - f[:, 0]) + bottom * f[:, 0]
